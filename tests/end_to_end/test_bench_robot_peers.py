"""The second table of `make bench-peers`: contestants answer in turns, and those that cannot run are named."""

import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
sys.path[:0] = [str(BENCHMARKS)]

import bench_robot_peers  # noqa: E402 - a script beside this folder

# Answers as `peers/robots.py` does, two robot-seconds for each second that it is asked for, after a line of its own.
_TWICE = """#!/bin/sh
echo "a package says hello"
echo '{"version": "twice 1.0"}'
while read -r seconds; do echo '{"robot_s": 6.0, "cpu_s": 3.0}'; done
"""


def bench(*words):
    call = [sys.executable, BENCHMARKS / "bench_robot_peers.py", *map(str, words)]
    return subprocess.run(call, capture_output=True, text=True, timeout=PROCESS_S)


def python_that_runs(tmp_path, text):
    python = tmp_path / "python"
    python.write_text(text)
    python.chmod(0o700)
    return python


def test_each_takes_part_in_each_round(tmp_path):
    done = bench("--only", "crazyflow", "mosaik", "--n", 2, "--peers-python", python_that_runs(tmp_path, _TWICE))
    assert done.returncode == 0, done.stderr
    first, _, *rows = done.stdout.splitlines()
    assert first == "twice 1.0: medians of 2 rounds of 3 s in turns"
    assert [row.split(",")[0] for row in rows] == ["crazyflow", "mosaik"]
    assert all(" 2        2        2    1.00  " in row for row in rows)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("#!/bin/sh\necho 'no module named mosaik' >&2\nexit 1\n", "it cannot run here (no module named mosaik)."),
        ("#!/bin/sh\nexit 1\n", "it cannot run here (without a message)."),
        (None, "its Python cannot be started (No such file or directory)."),
    ],
)
def test_a_peer_that_is_not_there_is_named_in_a_line(text, reason, tmp_path):
    python = tmp_path / "none" if text is None else python_that_runs(tmp_path, text)
    done = bench("--only", "mosaik", "--n", 1, "--peers-python", python)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"mosaik, point masses: left out, {reason}"


def test_ratios_are_paired_with_the_reference():
    paces = {"crazyflow": [1.0, 4.0, 2.0], "rigid-plume": [2.0, 4.0, 6.0]}
    assert bench_robot_peers.ratios("rigid-plume", paces) == [2.0, 1.0, 3.0]
    assert bench_robot_peers.ratios("mosaik", paces) is None
    assert "2.00  rigid body, rotors" in bench_robot_peers.table(paces)
