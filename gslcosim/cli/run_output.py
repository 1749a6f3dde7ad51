"""Output of `gslcosim up`: the live line of a run, and its summary at the end."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.cli.run_paths import RECORDING
from gslcosim.cli.terminal import plain_text, table, write_note

if TYPE_CHECKING:
    from rich.table import Table

    from gslcosim.runtime.status import RunResult, RunStatus

Report = Callable[["RunStatus"], None]

REFRESH_HZ = 10
BAR_WIDTH = 24
STATUS_COLUMN = 2

_ENDINGS = {
    "success": "The source was found",
    "time_limit": "The time was up",
    "collision": "A vehicle collided",
    "agent_failed": "The agent failed",
    "declared": "The agent declared the source",
    "out_of_bounds": "A vehicle left the room",
    "interrupted": "Interrupted",
    "cut": "The replay ended as asked",
    "timeout": "Nothing moved any more",
    "simulation_fault": "The simulation failed",
}


@contextlib.contextmanager
def show_run_progress(title: str, *, is_quiet: bool) -> Iterator[Report]:
    """Yield what a run reports to: a live line on a terminal, a few plain lines in a pipe, or nothing.

    Args:
        title: What flies, at the beginning of the live line.
        is_quiet: Whether to show nothing.
    """
    if is_quiet:
        yield lambda _: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.live import Live

        line = LiveLine(title)
        console = Console(stderr=True)
        with Live(get_renderable=line.render, console=console, refresh_per_second=REFRESH_HZ, transient=True):
            yield line
    else:
        yield PlainLines(title)


class LiveLine:
    """One line that is drawn again and again; taking a report costs nothing but an assignment."""

    def __init__(self, title: str) -> None:
        from rich.spinner import Spinner

        self._title = title
        self._status: RunStatus | None = None
        self._spinner = Spinner("dots")

    def __call__(self, status: "RunStatus") -> None:
        """Take what to show from now on."""
        self._status = status

    def render(self) -> "Table":
        """Return the line as it is now."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        status = self._status
        line = Table.grid(padding=(0, 1))
        cells: list[Any] = [self._spinner, plain_text(self._title), plain_text(format_status(status) if status else "")]
        if status is not None and status.fraction is not None:
            cells += [ProgressBar(total=1.0, completed=status.fraction, width=BAR_WIDTH)]
            cells += [f"{100 * status.fraction:3.0f} %"]
        for i in range(len(cells)):
            line.add_column(no_wrap=True, overflow="ellipsis" if i == STATUS_COLUMN else "crop")
        line.add_row(*cells)
        return line


class PlainLines:
    """One line for each piece of preparation, each state of the run, and what takes too long: for logs and pipes."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._last = ""

    def __call__(self, status: "RunStatus") -> None:
        """Write the status when it is a new one."""
        is_told = status.state == "preparing" or (status.state == "flying" and status.text)
        other = f"{status.state} {status.is_late} {status.is_compiling}"
        piece = (status.text or format_status(status)) if is_told else other
        if piece == self._last:
            return
        self._last = piece
        write_note(f"{self._title}: {format_status(status)}")


def format_status(status: "RunStatus") -> str:
    """Return the status in words: `flying, 84.3 s simulated, 212 x real time`."""
    parts = [] if status.state == "preparing" and status.text else [status.state]
    if status.sim_time_s > 0:
        parts += [f"{status.sim_time_s:.1f} s simulated", f"{status.real_time_factor:.0f} x real time"]
    if status.text:
        parts.append(status.text)
    return ", ".join(parts)


def format_summary(flight: "RunResult") -> str:
    """Return the end of a run for a person: what happened, each agent's figures, and where everything is."""
    result = flight.result
    reason = str(result.get("end_reason", ""))
    lines = [f"{_ENDINGS.get(reason, reason)} after {result.get('sim_time_s', 0.0):.1f} s of simulated time.", ""]
    if agents := result.get("agents"):
        lines += [format_agents_table(agents, result.get("sandboxes", {})), ""]
    agent_faults = [fault for fault in result.get("faults", []) if result.get("valid")]
    lines += [f"{fault['participant']}, tick {fault['tick']}: {fault['text']}" for fault in agent_faults]
    return "\n".join([*lines, *_paths(flight.run_dir, result)])


def format_agents_table(agents: list[dict[str, Any]], sandboxes: dict[str, str]) -> str:
    """Return one row an agent with the figures that matter, and what its process was confined by."""
    headings = ("agent", "outcome", "time to source", "commands", "path", "overhead", "distance at the end", "sandbox")
    rows = [
        (
            str(agent["name"]),
            str(agent["outcome"]).replace("_", " "),
            _figure(agent["time_to_source_s"], "{:.1f} s"),
            _figure(agent["steps"], "{}"),
            _figure(agent["path_length_m"], "{:.1f} m"),
            _figure(agent["movement_overhead"], "{:.2f}"),
            _figure(agent["final_distance_m"], "{:.2f} m"),
            sandboxes.get(agent["name"], "-"),
        )
        for agent in agents
    ]
    return table(headings, rows)


def _paths(run_dir: Path, result: dict[str, Any]) -> list[str]:
    seconds, factor = result.get("flight_wall_s", 0.0), result.get("real_time_factor", 0.0)
    lines = [f"speed      {factor:g} x real time ({seconds:g} s of flight)"] if factor else []
    if pace := result.get("pace"):
        lines.append(f"pace       {_pace_text(pace)}")
    lines.append(f"run        {run_dir}")
    if (recording := run_dir / RECORDING).exists():
        lines += [f"recording  {recording}", f"open it    gslcosim view {run_dir}"]
    if not result.get("valid") or result.get("faults"):
        lines.append(f"logs       {run_dir / 'logs'}")
    return lines


def _pace_text(pace: dict[str, float]) -> str:
    text = f"{pace['factor']:g} x real time, at worst {pace['worst_lag_s']:g} s late"
    if pace["late_share"]:
        text += f"; {100 * pace['late_share']:.1f} % of the ticks late"
    return f"{text}, {pace['lost_s']:g} s lost" if pace["lost_s"] else text


def _figure(value: object, pattern: str) -> str:
    return "-" if value is None else pattern.format(value)
