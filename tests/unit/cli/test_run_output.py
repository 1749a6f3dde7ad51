"""What is shown while a run goes on."""

import io

import pytest
from rich.console import Console

from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.run_output import (
    format_agents_table,
    format_status,
    show_run_progress,
)
from gslcosim.runtime.status import RunStatus


class TerminalText(io.StringIO):
    """A terminal that keeps what it was given."""

    def isatty(self):
        return True


def on_terminal(monkeypatch):
    stream = TerminalText()
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    return stream


def drawn(monkeypatch, *statuses, title="hall", width=120):
    """Return the live line after reports as a terminal shows it, without its colours."""
    on_terminal(monkeypatch)
    console = Console(file=io.StringIO(), width=width, force_terminal=False)
    with ProgressLine(title, is_quiet=False) as line:
        for status in statuses:
            line.show(lambda status=status: format_status(status), fraction=status.fraction)
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


def test_the_live_line_has_a_bar_while_the_fraction_is_known(monkeypatch):
    preparing = RunStatus(state="preparing", text="Solving the wind", fraction=0.25)
    assert "━" in drawn(monkeypatch, preparing)
    assert " 25 %" in drawn(monkeypatch, preparing)
    assert "━" not in drawn(monkeypatch, preparing, RunStatus(state="flying", sim_time_s=3.0))


def test_the_live_line_stays_one_line(monkeypatch):
    waiting = "waiting for world, fields, sensing, referee, recorder, agent_beetle"
    text = drawn(
        monkeypatch, RunStatus(state="starting", text=waiting, fraction=0.5), title="warehouse_empty, seed 7", width=80
    )
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
    terminal = on_terminal(monkeypatch)
    with show_run_progress("hall", is_quiet=False) as report:
        report(RunStatus(state="preparing", text="Solving the wind", fraction=0.25))
    shown = terminal.getvalue()
    assert "Solving the wind" in shown
    # The last it does is to empty the line.
    assert shown.rindex("\x1b[2K") > shown.rindex("Solving the wind")


def test_a_pipe_gets_lines_of_each_phase_some_seconds_apart_and_notes(capsys):
    with ProgressLine("suite", is_quiet=False) as line:
        for i in range(3):
            line.count(i, 3, phase="rooms")
            line.count(i, 0)
        line.note("a worker was lost")
        line.show("done", plain="[###] done", is_last=True)
    expected = "suite, rooms: 0 of 3\nsuite: 0 trials\na worker was lost\nsuite: [###] done\n"
    assert capsys.readouterr().err == expected


def test_who_asked_for_quiet_gets_nothing(capsys):
    with ProgressLine("suite", is_quiet=True) as line:
        line.count(1, 3)
        line.note("a worker was lost")
    assert capsys.readouterr().err == ""


def test_figures_that_have_no_meaning_are_dashes():
    agent = dict.fromkeys(("time_to_source_s", "steps", "path_length_m", "movement_overhead", "final_distance_m"), None)
    row = format_agents_table([{**agent, "name": "moth", "outcome": "time_limit"}], {"moth": "none"}).splitlines()[1]
    assert row.split("   ")[0] == "moth"
    assert row.count("-") == 6
