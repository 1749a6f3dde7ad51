"""The frozen models of a family file: every field with its meaning, default and range."""

import itertools
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Fraction, Name, Positive, Spec

SCHEMA = "gslcosim/family/1"
SPLITS = ("training", "validation", "test")
Split = Literal["training", "validation", "test"]

# As `set` of suites: values of a scenario by their paths.
Values = dict[str, Any]


class DrawnSpec(Spec):
    """How a value varies: one of a list, a number `between` two others, or the seed of a room.

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
            raise broken_rule(
                expected="a list of values, {between: [LEAST, MOST]} or {rooms: N}",
                found=", ".join(sorted(self.model_fields_set)) or "an empty block",
                remedy="For example {between: [0.5, 2], log: true}.",
            )
        low, high = self.between or (1.0, 2.0)
        if not low < high or (self.log and low <= 0):
            raise broken_rule(
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


Axis = dict[str, Annotated[DrawnSpec, BeforeValidator(_drawn_of_list)]]


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
                raise broken_rule(
                    key=other,
                    expected=f"seeds apart from those of {name}, which are {lower.first} to {lower.last}",
                    found=f"{upper.first} to {upper.last}",
                    remedy=f"Let {other} begin at {lower.last + 1} or later.",
                )
        last = ranges[-1][0].last
        if last >= 2**31:
            raise broken_rule(
                key=ranges[-1][1], expected="seeds below 2^31", found=f"up to {last}", remedy="Begin lower."
            )
        return self


class DopingSpec(Spec):
    """Hard cases come more often in training.

    A case's weight is `floor` and the rest by its mean cost to the power `power`; one that has not been flown yet
    counts as the hardest.
    """

    power: Positive = 1.0
    floor: Fraction = 0.1

    @model_validator(mode="after")
    def _check_floor(self) -> Self:
        if self.floor == 1.0:
            raise broken_rule(
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
    doping: DopingSpec | None = None

    @model_validator(mode="after")
    def _check_vary(self) -> Self:
        for i, axis in enumerate(self.vary):
            if not axis:
                raise broken_rule(
                    key=f"vary[{i}]",
                    expected="at least one path of a value that varies",
                    found="an empty block",
                    remedy="Leave it out.",
                )
            lengths = {key: len(drawn.values) for key, drawn in axis.items() if drawn.values is not None}
            if len(set(lengths.values())) > 1:
                raise broken_rule(
                    key=f"vary[{i}]",
                    expected="lists of one length: within an item they go together",
                    found=", ".join(f"{key} with {n}" for key, n in lengths.items()),
                    remedy="Write what varies by itself as items of their own.",
                )
        paths = [path for axis in self.vary for path in axis]
        if twice := next((path for path in paths if paths.count(path) > 1 or path in self.set), None):
            raise broken_rule(key="vary", expected="each value once", found=f"{twice} twice", remedy="Leave one out.")
        return self
