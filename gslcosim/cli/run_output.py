"""Output of runs: live lines, progress and summaries."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.cli.arguments import RECORDING
from gslcosim.cli.progress import ProgressLine, RemainingTime
from gslcosim.cli.terminal import table, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.status import RunResult, RunStatus

Report = Callable[["RunStatus"], None]

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
_AGENT_HEADINGS = (
    "agent", "method", "outcome", "time to source", "commands", "path", "overhead", "distance at the end", "sandbox",
)  # fmt: skip
# Interval of lines in a pipe with the time left of one piece of work [s].
_REMINDER_EVERY_S = 30.0


@contextlib.contextmanager
def show_run_progress(title: str, *, is_quiet: bool) -> Iterator[Report]:
    """Yield the report function of a run: a live line on a terminal, a few plain lines in a pipe, or nothing."""
    if is_quiet:
        yield lambda _: None
    elif sys.stderr.isatty():
        with ProgressLine(title, is_quiet=False) as line:
            remaining = RemainingTime()

            # The fraction done has a bar of its own.
            def draw(status: "RunStatus") -> str:
                left = remaining.estimate(status.text, status.fraction)
                return ", ".join(filter(None, (format_status(status), left)))

            yield lambda status: line.show(lambda: draw(status), fraction=status.fraction)
    else:
        yield PlainLines(title)


class PlainLines:
    """One line for each piece of preparation, each state of the run, and each delay: for logs and pipes.

    A long piece of preparation has a further line now and then with the time left.
    """

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        """Set the beginning of each line, and the clock [s]."""
        self._title = title
        self._last = ""
        self._clock = clock
        self._written_at_s = 0.0
        self._remaining = RemainingTime(clock)

    def __call__(self, status: "RunStatus") -> None:
        """Write the status if it has changed."""
        has_own_line = status.state == "preparing" or (status.state == "flying" and status.text)
        other = f"{status.state} {status.is_late} {status.is_compiling}"
        piece = (status.text or format_status(status)) if has_own_line else other
        left = self._remaining.describe(piece, status.fraction)
        is_due = bool(left) and self._clock() - self._written_at_s >= _REMINDER_EVERY_S
        if piece == self._last and not is_due:
            return
        self._last, self._written_at_s = piece, self._clock()
        write_note(f"{self._title}: {', '.join(filter(None, (format_status(status), left)))}")


def format_status(status: "RunStatus") -> str:
    """Return the status in words: `flying, 84.3 s simulated, 212 x real time`."""
    parts = [] if status.state == "preparing" and status.text else [status.state]
    if status.sim_time_s > 0:
        parts += [f"{status.sim_time_s:.1f} s simulated", f"{status.real_time_factor:.0f} x real time"]
    if status.text:
        parts.append(status.text)
    return ", ".join(parts)


def format_summary(flight: "RunResult") -> str:
    """Return the end of a run for a person: reason, figures of the agents, and paths."""
    result = flight.result
    reason = str(result.get("end_reason", ""))
    lines = [f"{_ENDINGS.get(reason, reason)} after {result.get('sim_time_s', 0.0):.1f} s of simulated time.", ""]
    if agents := result.get("agents"):
        lines += [format_agents_table(agents, result.get("sandboxes", {})), ""]
    from gslcosim.validity.findings import format_validity

    agent_faults = [fault for fault in result.get("faults", []) if result.get("valid")]
    lines += [f"{fault['participant']}, tick {fault['tick']}: {fault['text']}" for fault in agent_faults]
    if "validity" in result:
        lines += [*format_validity(result["validity"]), ""]
    return "\n".join([*lines, *_paths(flight.run_dir, result)])


def note_faults(flight: "RunResult") -> None:
    """Write the faults of a run that is not valid to stderr."""
    for fault in () if flight.result.get("valid") else flight.result.get("faults", ()):
        write_note(f"{fault['participant']}: {fault['text']}")


def format_agents_table(agents: list[dict[str, Any]], sandboxes: dict[str, str]) -> str:
    """Return a table with one row per agent: its main figures, and the sandbox of its process."""
    rows = [
        (
            str(agent["name"]),
            str(agent.get("method", "-")),
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
    return table(_AGENT_HEADINGS, rows)


def _paths(run_dir: Path, result: dict[str, Any]) -> list[str]:
    seconds, factor = result.get("flight_wall_s", 0.0), result.get("real_time_factor", 0.0)
    lines = [f"speed      {factor:g} x real time"] if factor else []
    if factor and (whole := result.get("wall_time_s", 0.0)):
        preparation = result.get("preparation_s", 0.0)
        rest = max(whole - preparation - seconds, 0.0)
        lines.append(
            f"time       {whole:.1f} s: {preparation:.1f} s room and wind, {seconds:.1f} s run, "
            f"{rest:.1f} s start and end"
        )
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
