"""What a plan is made of: cases, what was left out, and trials."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gslcosim.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class Case:
    """One scenario of a suite with one combination of what varies; without entry and repetition.

    `varied` holds values by path; `set_in` says, for problems, which file sets them. `is_sandboxed` is whether its
    suite, or one that includes it, demands a sandbox for agents.
    """

    name: str
    scenario: str
    family: str
    source: Path
    varied: Mapping[str, Any]
    overrides: tuple[str, ...]
    suite_seed: int
    repetitions: int
    gas_seeds: int
    no_source_frac: float
    is_sandboxed: bool
    set_in: str

    @property
    def n_controls(self) -> int:
        """How many of the repetitions are flown without gas too."""
        return round(self.no_source_frac * self.repetitions)


@dataclass(frozen=True, kw_only=True)
class Dropped:
    """A combination that is no case, and why."""

    case: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Moved:
    """A start that was not free and has been moved, world frame [m]."""

    case: str
    agent: str
    from_m: tuple[float, float, float]
    to_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One flight of one entry in one case: everything that a worker needs, as plain data.

    `scenario_json` is the scenario as resolved, `directory` where its relative paths start, `room` the key of its
    environment, `tape` that of its gas where it is on tape. `sources` are the suites and scenarios of its plan.
    """

    id: str
    index: int
    case: str
    scenario: str
    family: str
    varied: str
    repetition: int
    entry: str
    is_control: bool
    scenario_json: str
    directory: Path
    room: str
    tape: str | None
    case_hash: str
    sources: tuple[Path, ...] = ()

    @cached_property
    def resolved(self) -> Scenario:
        """The scenario that is flown."""
        return Scenario.model_validate_json(self.scenario_json)
