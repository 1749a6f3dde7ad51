"""Cases and trials of a plan, and the seeds they run with."""

import hashlib
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
        """Number of repetitions that also run without gas."""
        return round(self.no_source_frac * self.repetitions)


@dataclass(frozen=True, kw_only=True)
class DroppedCase:
    """A combination that is no case, and why."""

    case: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class MovedStart:
    """A start that was not free and has been moved, world frame [m]."""

    case: str
    agent: str
    from_m: tuple[float, float, float]
    to_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of one entry in one case: everything that a worker needs, as plain data.

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
        """The scenario that is run."""
        return Scenario.model_validate_json(self.scenario_json)


_BITS = 31


def derive_seed(suite_seed: int, *words: str | int) -> int:
    """Return a seed from 0 to 2^31 - 1 for what the words name, as good as independent of all others.

    seed = blake2b(suite_seed / word / word ...), its first 31 bits

    Args:
        suite_seed: The suite's, which an organiser may keep until the results are in.
        words: What it is for, for example the case and the repetition.
    """
    text = "/".join(str(word) for word in (suite_seed, *words))
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") >> (64 - _BITS)


def commitment(suite_seed: int) -> str:
    """Return the SHA-256 of a seed: published before, it proves afterwards that the seed was not chosen to please."""
    return hashlib.sha256(str(suite_seed).encode()).hexdigest()
