"""What is shown while a run goes on."""

import io

import pytest
from rich.console import Console

from gslcosim.cli.run_output import LiveLine, format_agents_table, format_status, show_run_progress
from gslcosim.runtime.status import RunStatus


def drawn(line):
    """Return the live line as a terminal of 120 columns shows it."""
    console = Console(file=io.StringIO(), width=120, force_terminal=False)
    console.print(line.render())
    return console.file.getvalue()


@pytest.mark.parametrize(
    ("status", "text"),
    [
        (RunStatus(state="starting"), "starting"),
        (RunStatus(state="preparing", text="Solving the wind", fraction=0.2), "Solving the wind"),
        (RunStatus(state="flying", sim_time_s=84.26, real_time_factor=211.7), "flying, 84.3 s simulated, 212 x "
         "real time"),
    ],
)  # fmt: skip
def test_a_status_is_said_in_words(status, text):
    assert format_status(status) == text


def test_the_live_line_shows_the_last_report():
    line = LiveLine("hall, seed 7")
    assert "hall, seed 7" in drawn(line)
    line(RunStatus(state="starting"))
    line(RunStatus(state="flying", sim_time_s=3.0, real_time_factor=150.0))
    assert "hall, seed 7 flying, 3.0 s simulated, 150 x real time" in drawn(line)


def test_the_live_line_has_a_bar_while_the_share_is_known():
    line = LiveLine("hall")
    line(RunStatus(state="preparing", text="Solving the wind", fraction=0.25))
    assert "━" in drawn(line)
    assert " 25 %" in drawn(line)
    line(RunStatus(state="flying", sim_time_s=3.0))
    assert "━" not in drawn(line)


def test_the_live_line_stays_one_line():
    line = LiveLine("warehouse_empty, seed 7")
    line(
        RunStatus(
            state="starting", text="waiting for world, fields, sensing, referee, recorder, agent_beetle", fraction=0.5
        )
    )
    console = Console(file=io.StringIO(), width=80, force_terminal=False)
    console.print(line.render())
    text = console.file.getvalue()
    assert text.count("\n") == 1
    assert "starting, waiting" in text
    assert "…" in text


def test_a_pipe_is_reported_once_who_is_late(capsys):
    """The first time, so that a log says for whom a run has waited; a terminal shows it all the time."""
    with show_run_progress("hall", is_quiet=False) as report:
        report(RunStatus(state="starting", text="waiting for world"))
        for waited_s in (5, 6, 7):
            text = f"waiting for world, not here after {waited_s} s"
            report(RunStatus(state="starting", text=text, is_late=True))
    assert capsys.readouterr().err.splitlines() == [
        "hall: starting, waiting for world",
        "hall: starting, waiting for world, not here after 5 s",
    ]


def test_a_terminal_gets_the_live_line_and_keeps_nothing_of_it(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stderr", terminal)
    with show_run_progress("hall", is_quiet=False) as report:
        assert isinstance(report, LiveLine)
        report(RunStatus(state="starting"))


def test_figures_that_have_no_meaning_are_dashes():
    agent = dict.fromkeys(("time_to_source_s", "steps", "path_length_m", "movement_overhead", "final_distance_m"), None)
    row = format_agents_table([{**agent, "name": "moth", "outcome": "time_limit"}], {"moth": "none"}).splitlines()[1]
    assert row.split("   ")[0] == "moth"
    assert row.count("-") == 5
