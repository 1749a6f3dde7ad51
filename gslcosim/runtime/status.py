"""What a flight tells while it goes on, and what it leaves behind."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

ParticipantState = Literal["joining", "working", "waiting", "deciding", "done", "silent"]


@dataclass(frozen=True, kw_only=True)
class ParticipantStatus:
    """One moment of a participant, for a person to watch.

    `tick` is the last one finished, -1 before the first; `waits_for` names the ports, readers or agents without which
    it cannot go on; `queued_ticks` counts the ticks of its inputs that are here already. A participant that is `silent`
    has not answered. Of its process: `pid`, CPU time so far, and the memory that it alone holds with its share of what
    it has in common with others; absent where nobody knows them. `n_resends` counts messages it had to ask for again.
    """

    name: str
    state: ParticipantState
    tick: int
    waits_for: tuple[str, ...] = ()
    queued_ticks: int = 0
    pid: int | None = None
    cpu_s: float | None = None
    memory_bytes: int | None = None
    n_resends: int = 0


def no_participants() -> list[ParticipantStatus]:
    """Return none: there are none yet, or any more."""
    return []


@dataclass(frozen=True, kw_only=True)
class FlightStatus:
    """One moment of a flight, for a person to watch.

    `state` is `preparing`, `starting`, `flying`, `closing` or `ended`; `fraction` is the share done of the present
    piece of work (absent where nobody knows it); `text` is one short sentence; `is_late` says that this takes longer
    than it should, `is_compiling` that kernels are compiled, which takes a minute in the first run of a version.
    `participants` may be called on any thread while the flight goes on, and looks then. `run_dir` is told once there is
    one, with the state `starting`.
    """

    state: str
    text: str = ""
    fraction: float | None = None
    sim_time_s: float = 0.0
    real_time_factor: float = 0.0
    is_late: bool = False
    is_compiling: bool = False
    participants: Callable[[], list[ParticipantStatus]] = no_participants
    run_dir: Path | None = None


@dataclass(frozen=True, kw_only=True)
class FlightResult:
    """The end of a flight: exit code, run directory, and the content of its `result.json`."""

    exit_code: int
    run_dir: Path
    result: dict[str, Any] = field(default_factory=dict[str, Any])
