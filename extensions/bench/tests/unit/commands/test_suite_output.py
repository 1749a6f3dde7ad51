"""What `gslcosim bench` shows."""

import argparse
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.commands.suite_output import format_merge, format_progress
from gslcosim_bench.commands.workers import confirm_put_aside
from gslcosim_bench.execution.runner import Progress, StaleRows
from gslcosim_bench.merge import MergeSummary
from gslcosim_bench.report.writer import WrittenReport


def test_progress_has_the_time_left_and_that_of_processors():
    rooms = Progress(phase="rooms", done=1, total=3, elapsed_s=40, cpu_s=75)
    assert format_progress(rooms) == "rooms 1/3, 40 s, 80 s left, 75 s of processor time"
    some = Progress(
        phase="trials", done=30, total=90, elapsed_s=60, cpu_s=118, flown={"moth": 30}, successes={"moth": 7}
    )
    assert format_progress(some) == "30/90 trials, 30.0/min, 2 min left, 2 min of processor time | found: moth 7/30"
    counts = {f"m_{i}": 2 for i in range(20)}
    many = Progress(phase="trials", done=0, total=9, elapsed_s=0, flown=counts, successes={"m_1": 2})
    assert format_progress(many) == "0/9 trials, 0.0/min | found: 2 of 40"


def test_who_has_nobody_to_ask_refuses_to_move_rows_of_another_version():
    stale = StaleRows(folder=Path("results/mine"), n_stale=8, n_rows=12, changes=("program of mine",))
    with pytest.raises(UsageError, match=r"^results/mine: expected .* 8 of 12 .*\(program of mine changed\). .* --yes"):
        confirm_put_aside(argparse.Namespace(yes=False))(stale)
    assert confirm_put_aside(argparse.Namespace(yes=True))(stale)


def test_a_long_leaderboard_is_cut_to_what_a_terminal_shows():
    summary = MergeSummary(folder=Path("out"), n_shards=1, missing=(), n_trials=4, n_chosen=4)
    rows = [[str(i), f"m_{i}", "0.5", "0.4", "9"] for i in range(30)]
    report = WrittenReport(page=Path("out/report.html"), leaderboard=(["#", "Entry", "Score", "SPL", "n"], rows))
    lines = format_merge(summary, report).splitlines()
    assert lines[2].split() == ["#", "Entry", "Score", "n"]
    assert lines[22:24] == ["19   m_19    0.5     9", "10 more entries are in out/summary.md."]
