"""A pipe or a device in place of a file that a person gives: refused at once, for it would be waited for, for ever."""

import contextlib
import os
import socket
import sys
from pathlib import Path

import pytest
from real_runs import TINY_ROOM, fly_here

from gslcosim.cli.main import main

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
    "table of a robot": ("runs", "import", "{pipe}.csv", "--scenario", "tiny_room"),
    "bag of ROS 1": ("runs", "import", "{pipe}.bag", "--scenario", "tiny_room"),
    "bag of another name": ("runs", "import", "{pipe}.db3", "--scenario", "tiny_room"),
    "log of PX4": ("runs", "import", "{pipe}.ulg", "--scenario", "tiny_room"),
    "bag of ROS 2": ("runs", "import", "{folder}", "--scenario", "tiny_room"),
    "unit of FMI": ("validate", "tiny_room", "--set",
                    "participants=[{name: fan, start: {fmu: {pipe}.fmu}, outputs: {state: {a: b}}, writes: [state]}]"),
    "mesh of a model": ("validate", "tiny_room", "--set", "environment={geometry: {files: [{pipe}_model.xml]}}"),
    "bundle": ("bench", "run", "smoke", "--bundle", "{pipe}.tar"),
    "public log": ("bench", "log", "{pipe}.json"),
    "secret": ("bench", "run", "smoke", "--sealed", "{pipe}.json"),
    "points": ("environment", "sample", "tiny_room", "--points", "{pipe}.csv", "--out", "out.csv", "--time", "0"),
    "run": ("view", "{pipe}.rrd"),
}  # fmt: skip


ENDINGS = ("yaml", "json", "stl", "csv", "npz", "py", "pem", "mcap", "rrd", "bag", "db3", "ulg", "fmu", "tar")
MODEL = """<mujoco><asset><mesh name="m" file="x.stl"/></asset>
  <worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>"""


def bind_socket(path):
    with socket.socket(socket.AF_UNIX) as unix, contextlib.chdir(path.parent):
        unix.bind(path.name)


ODD_FILES = {
    "pipe": os.mkfifo,
    "endless device": lambda path: path.symlink_to("/dev/zero"),
    "socket": bind_socket,
    "folder": Path.mkdir,
}
ALL = [(kind, "pipe") for kind in KINDS]
# Their readers are those of libraries, which open what they are given.
READ_BY_LIBRARIES = ("table of a robot", "bag of ROS 1", "bag of ROS 2", "unit of FMI", "mesh of a model")
ALL += [(kind, odd) for kind in READ_BY_LIBRARIES for odd in ODD_FILES if odd != "pipe"]
# Of a folder MuJoCo has its own words, and a bag of ROS 2 is one.
ALL = [pytest.param(kind, odd, marks=pytest.mark.extras) if kind == "unit of FMI" else (kind, odd) for kind, odd in ALL]


@pytest.mark.parametrize(("kind", "odd"), ALL)
def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path, monkeypatch, capfd, kind, odd):
    monkeypatch.chdir(tmp_path)
    pipe, folder = tmp_path / "x", tmp_path / "bag"
    folder.mkdir()
    for path in (*(pipe.with_suffix(f".{ending}") for ending in ENDINGS), folder / "x.db3"):
        ODD_FILES[odd](path)
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5, relative_file_paths: [x.db3]}\n")
    (tmp_path / "x_model.xml").write_text(MODEL)
    words = [word.replace("{pipe}", str(pipe)).replace("{folder}", str(folder)) for word in KINDS[kind]]
    exit_code, errors = main(words), capfd.readouterr().err
    assert exit_code == 2, errors
    assert "Traceback" not in errors
    assert "expected" in errors


@pytest.mark.parametrize("sandbox", ["auto", "landlock"])
def test_a_pipe_beside_an_agents_program_is_passed_over(tmp_path, sandbox):
    """It is searched for scenarios, which the agent must not see."""
    os.mkfifo(tmp_path / "x.yaml")
    (tmp_path / "agent.py").write_text("raise SystemExit(3)\n")
    start = f"agents[0].start={{command: [{sys.executable}, {tmp_path}/agent.py], door: stdio}}"
    ended = fly_here(TINY_ROOM, tmp_path / "runs", "--set", start, "--set", f"agents[0].sandbox={sandbox}")
    assert ended.exit_code == 1, ended.errors
    assert "ended with exit code 3" in str(ended.result["faults"])
