"""Families of cases: their files read into frozen models, and the values that each seed of a split draws."""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from gslcosim.base.bundled import bundled_families
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem, broken_rule_error
from gslcosim.base.rng import stream
from gslcosim.base.yaml_core import without_editor_header
from gslcosim.scenario.models.base import Fraction, Name, Positive, Spec
from gslcosim.scenario.problems import did_you_mean
from gslcosim_bench.cases.models import SPLITS, Split, Values, check_lengths
from gslcosim_bench.cases.spec_files import find_scenario_beside, read_spec_file

_DIGITS = 6


class DrawnSpec(Spec):
    """Variation of a value: one of a list, a number `between` two others, or the seed of a room.

    Numbers are drawn evenly, or with `log` by their logarithm. `rooms: N` is one of the first N seeds of the split, so
    that no split has a room of another. A list alone stands for `values`.
    """

    values: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None
    between: tuple[float, float] | None = None
    log: bool = False
    rooms: Annotated[int, Field(ge=1, le=10_000)] | None = None

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        given = [name for name in ("values", "between", "rooms") if getattr(self, name) is not None]
        if len(given) != 1 or (self.log and self.between is None):
            raise broken_rule_error(
                expected="a list of values, {between: [LEAST, MOST]} or {rooms: N}",
                found=", ".join(sorted(self.model_fields_set)) or "an empty block",
                remedy="For example {between: [0.5, 2], log: true}.",
            )
        low, high = self.between or (1.0, 2.0)
        if not low < high or (self.log and low <= 0):
            raise broken_rule_error(
                key="between",
                expected="a least number above 0 and a larger one" if self.log else "a number and a larger one",
                found=f"{low:g} and {high:g}",
                remedy="For example between: [0.5, 2].",
            )
        return self


# Strict models take tuples; lists are what JSON has.
def _drawn_of_list(value: Any) -> Any:
    block = {"values": value} if isinstance(value, list) else value
    if not isinstance(block, dict):
        return block
    return {key: tuple(inner) if isinstance(inner, list) else inner for key, inner in block.items()}


Axis = dict[str, Annotated[DrawnSpec, BeforeValidator(_drawn_of_list, json_schema_input_type=list[Any] | DrawnSpec)]]


class SeedsSpec(Spec):
    """Seeds that follow each other: `count` of them from `first` on; each makes a case."""

    first: Annotated[int, Field(ge=0, lt=2**31)]
    count: Annotated[int, Field(ge=1, le=1_000_000)]

    @property
    def last(self) -> int:
        """The last seed."""
        return self.first + self.count - 1

    def __contains__(self, seed: int) -> bool:
        return self.first <= seed <= self.last


class SplitsSpec(Spec):
    """The seeds of the three splits, which share none."""

    training: SeedsSpec
    validation: SeedsSpec
    test: SeedsSpec

    def of(self, split: Split) -> SeedsSpec:
        """Return the seeds of a split."""
        return getattr(self, split)

    @model_validator(mode="after")
    def _check_apart(self) -> Self:
        ranges = sorted(((self.of(split), split) for split in SPLITS), key=lambda each: each[0].first)
        for (lower, name), (upper, other) in itertools.pairwise(ranges):
            if upper.first <= lower.last:
                raise broken_rule_error(
                    key=other,
                    expected=f"seeds apart from those of {name}, which are {lower.first} to {lower.last}",
                    found=f"{upper.first} to {upper.last}",
                    remedy=f"Let {other} begin at {lower.last + 1} or later.",
                )
        last = ranges[-1][0].last
        if last >= 2**31:
            raise broken_rule_error(
                key=ranges[-1][1], expected="seeds below 2^31", found=f"up to {last}", remedy="Begin lower."
            )
        return self


class PrioritisedSamplingSpec(Spec):
    """Hard cases come more often in training.

    A case's weight is `floor` and the rest by its mean cost to the power `power`; one that has not been flown yet
    counts as the hardest.
    """

    power: Positive = 1.0
    floor: Fraction = 0.1

    @model_validator(mode="after")
    def _check_floor(self) -> Self:
        if self.floor == 1.0:
            raise broken_rule_error(
                key="floor",
                expected="a share below 1: with 1 all cases come equally often, whatever they cost",
                found="1",
                remedy="Lower it, or leave doping out.",
            )
        return self


class FamilySpec(Spec):
    """A whole family file.

    Each seed makes a case of `scenario`: places that are `random` there are drawn by it, as are the values of `vary`.
    Within an item of `vary` lists go together. `set` replaces values in all cases.
    """

    schema_: Literal["gslcosim/family/1"] = Field(alias="schema")
    name: Name
    title: str = ""
    scenario: str
    set: Values = {}  # noqa: RUF012 - pydantic copies it
    vary: tuple[Axis, ...] = ()
    seeds: SplitsSpec
    doping: PrioritisedSamplingSpec | None = None

    @model_validator(mode="after")
    def _check_vary(self) -> Self:
        for i, axis in enumerate(self.vary):
            if not axis:
                raise broken_rule_error(
                    key=f"vary[{i}]",
                    expected="at least one path of a value that varies",
                    found="an empty block",
                    remedy="Leave it out.",
                )
            lengths = {key: len(drawn.values) for key, drawn in axis.items() if drawn.values is not None}
            check_lengths(f"vary[{i}]", lengths, remedy="Write what varies by itself as items of their own.")
        paths = [path for axis in self.vary for path in axis]
        if twice := next((path for path in paths if paths.count(path) > 1 or path in self.set), None):
            raise broken_rule_error(
                key="vary", expected="each value once", found=f"{twice} twice", remedy="Leave one out."
            )
        return self


@dataclass(frozen=True, kw_only=True)
class CaseFamily:
    """A valid family and where it came from; `directory` is where its relative paths start.

    Suites and trainings take their cases from it.
    """

    spec: FamilySpec
    path: Path
    directory: Path

    @property
    def name(self) -> str:
        """The family's name."""
        return self.spec.name

    @cached_property
    def scenario(self) -> Path:
        """The file of the scenario that varies."""
        try:
            return find_scenario_beside(self.spec.scenario, self.directory)
        except ScenarioError as error:
            raise ScenarioError(f"{self.path}: scenario: {error}") from error

    @property
    def identity(self) -> str:
        """A hash of all that decides the cases: the family as resolved, and its scenario."""
        scenario = without_editor_header(read_regular_file(self.scenario)).decode("utf-8-sig")
        text = f"{self.spec.model_dump_json()}\n{scenario}"
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def seeds_of(self, split: Split, n: int) -> list[int]:
        """Return the seeds of the first n cases of a split."""
        if split not in SPLITS:
            raise UsageError(f"{self.name}: expected one of the splits {', '.join(SPLITS)}, was {split!r}.")
        seeds = self.spec.seeds.of(split)
        if not 1 <= n <= seeds.count:
            raise UsageError(
                f"{self.name}: expected 1 to {seeds.count} cases for {split}, as many as seeds.{split} has, was {n}."
            )
        return [seeds.first + i for i in range(n)]

    def values_of(self, split: Split, i: int) -> dict[str, Any]:
        """Return the values that the i-th case of a split sets, by their paths."""
        seeds = self.spec.seeds.of(split)
        values = dict(self.spec.set)
        for axis in self.spec.vary:
            values |= _drawn(axis, seed=seeds.first + i, first=seeds.first)
        return values


def read_family(source: str | Path, *, check: Callable[[FamilySpec], Iterable[Problem]] = lambda _: ()) -> CaseFamily:
    """Read and check a family."""
    path = find_family(source)
    shown_path = str(source) if Path(source).is_file() else str(path)
    spec = read_spec_file(path, FamilySpec, shown_path=shown_path, keys="scenario and seeds", check=check)
    return CaseFamily(spec=spec, path=path, directory=path.parent.resolve())


def find_family_beside(source: str, directory: Path) -> CaseFamily:
    """Return the family that a file in a folder names: one beside it, or a bundled one; see `read_family`."""
    beside = directory / source
    return read_family(beside if beside.is_file() else source)


def find_family(source: str | Path) -> Path:
    """Return the file of a family that is named by path, or by name when it is bundled."""
    path, bundled = Path(source), bundled_families()
    if path.is_file():
        return path
    if str(source) in bundled:
        return bundled[str(source)]
    raise ScenarioError(
        f"{source}: expected a family file or a bundled family ({', '.join(bundled)}), found neither. "
        f"{did_you_mean(str(source), list(bundled))}".rstrip()
    )


def _drawn(axis: Axis, *, seed: int, first: int) -> Iterator[tuple[str, Any]]:
    together = "+".join(path for path, drawn in axis.items() if drawn.values is not None)
    for path, drawn in axis.items():
        if drawn.values is not None:
            yield path, drawn.values[int(stream(seed, f"family.{together}").integers(len(drawn.values)))]
        elif drawn.rooms is not None:
            yield path, first + int(stream(seed, f"family.{path}").integers(drawn.rooms))
        elif drawn.between is not None:
            yield path, _between(*drawn.between, stream(seed, f"family.{path}").random(), is_log=drawn.log)


def _between(low: float, high: float, share: float, *, is_log: bool) -> float:
    value = low * (high / low) ** share if is_log else low + (high - low) * share
    return float(f"{value:.{_DIGITS}g}")
