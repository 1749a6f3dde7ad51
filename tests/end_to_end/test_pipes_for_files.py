"""A pipe or a device in place of a file that a person gives: refused at once, for it would be waited for, for ever."""

import os
import subprocess
import sys

import pytest
from deadlines import PROCESS_S
from real_runs import COMMAND, TINY_ROOM

KINDS = {
    "scenario": ("up", "{pipe}.yaml"),
    "validated scenario": ("validate", "{pipe}.yaml"),
    "suite": ("bench", "run", "{pipe}.yaml"),
    "tuned suite": ("bench", "tune", "{pipe}.yaml", "--entry", "dung_beetle", "--budget", "1", "--parameter",
                    "agents[0].vehicle.hold_s=0..1"),
    "family": ("train", "{pipe}.yaml"),
    "join file": ("join", "{pipe}.json"),
    "layout": ("environment", "generate", "{pipe}.yaml"),
    "geometry": ("up", "tiny_room", "--set", "environment={geometry: {files: [{pipe}.stl]}}"),
    "wind": ("up", "tiny_room", "--set", "wind={solver: {file: {pipe}.csv}}"),
    "stored gas": ("up", "tiny_room", "--set", "gas={model: playback, playback: {folder: {pipe}.npz}, sources: "
                   "[{position_m: [1, 1, 1]}]}"),
    "agent": ("up", "tiny_room", "--set", "agents[0].start={python: {pipe}.py}"),
    "certificate": (
        "up", "tiny_room", "--listen", "tls/127.0.0.1:0", "--tls-certificate", "{pipe}.pem", "--tls-key", "{pipe}.pem",
        "--elsewhere", "all",
    ),
    "log of a robot": ("runs", "import", "{pipe}.mcap", "--scenario", "tiny_room"),
    "points": ("environment", "sample", "tiny_room", "--points", "{pipe}.csv", "--out", "out.csv", "--time", "0"),
    "run": ("view", "{pipe}.rrd"),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path, kind):
    pipe = tmp_path / "x"
    for ending in ("yaml", "json", "stl", "csv", "npz", "py", "pem", "mcap", "rrd"):
        os.mkfifo(pipe.with_suffix(f".{ending}"))
    words = [word.replace("{pipe}", str(pipe)) for word in KINDS[kind]]
    ended = subprocess.run(
        [*COMMAND, *words], cwd=tmp_path, capture_output=True, text=True, timeout=PROCESS_S, check=False
    )
    assert ended.returncode in (2, 3), ended.stderr
    assert "Traceback" not in ended.stderr
    assert "expected" in ended.stderr


@pytest.mark.parametrize("sandbox", ["auto", "landlock"])
def test_a_pipe_beside_an_agents_program_is_passed_over(tmp_path, sandbox):
    """It is searched for scenarios, which the agent must not see."""
    os.mkfifo(tmp_path / "x.yaml")
    (tmp_path / "agent.py").write_text("raise SystemExit(3)\n")
    start = f"agents[0].start={{command: [{sys.executable}, {tmp_path}/agent.py], door: stdio}}"
    words = ["up", str(TINY_ROOM), "--in-process", "--set", start, "--set", f"agents[0].sandbox={sandbox}"]
    ended = subprocess.run(
        [*COMMAND, *words, "--runs-dir", str(tmp_path / "runs")],
        cwd=tmp_path, capture_output=True, text=True, timeout=PROCESS_S, check=False,
    )  # fmt: skip
    assert ended.returncode == 1, ended.stderr
    (result,) = (tmp_path / "runs").glob("*/result.json")
    assert "ended with exit code 3" in result.read_text()
