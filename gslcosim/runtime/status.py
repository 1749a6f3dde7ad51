"""What a flight tells while it goes on, and what it leaves behind."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class FlightStatus:
    """One moment of a flight, for a person to watch.

    `state` is `preparing`, `starting`, `flying`, `closing` or `ended`; `fraction` is the share done of the present
    piece of work (absent where nobody knows it); `text` is one short sentence; `is_late` says that this takes longer
    than it should.
    """

    state: str
    text: str = ""
    fraction: float | None = None
    sim_time_s: float = 0.0
    real_time_factor: float = 0.0
    is_late: bool = False


@dataclass(frozen=True, kw_only=True)
class FlightResult:
    """The end of a flight: exit code, run directory, and the content of its `result.json`."""

    exit_code: int
    run_dir: Path
    result: dict[str, Any] = field(default_factory=dict[str, Any])
