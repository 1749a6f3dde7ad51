"""Value tables of tabular Q-learning: the value of each choice in each of a few states."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim_search import elementary
from gslcosim_search.learned.encoding import N_HEADINGS
from gslcosim_search.learned.policy import (
    Actions,
    ActionSettings,
    ArrayPolicy,
    Floats,
    PolicyError,
    check_arrays,
    check_number,
    even_numbers,
)

States = NDArray[np.int64]
_REFUSED = 0.5


@dataclass(frozen=True, kw_only=True)
class StateFeature(ABC):
    """One digit of a state: a class of what is observed, from 0 to below `n_classes`.

    `start` is the one number that it remembers at the beginning, absent where it remembers nothing.
    """

    start: ClassVar[float | None] = None

    @property
    @abstractmethod
    def n_classes(self) -> int:
        """Number of classes."""

    @property
    @abstractmethod
    def observed(self) -> tuple[str, ...]:
        """The observations that it reads."""

    @abstractmethod
    def classes(self, seen: Sequence[Floats], memory: Floats) -> tuple[States, Floats]:
        """Return the classes, (n,), and what to remember, upon the observations `observed`, each (n,)."""


@dataclass(frozen=True, kw_only=True)
class LevelFeature(StateFeature):
    """Level of an observation: as many classes as `cuts`, and one more."""

    observation: str
    cuts: tuple[float, ...]

    @property
    @override
    def n_classes(self) -> int:
        return len(self.cuts) + 1

    @property
    @override
    def observed(self) -> tuple[str, ...]:
        return (self.observation,)

    @override
    def classes(self, seen: Sequence[Floats], memory: Floats) -> tuple[States, Floats]:
        return np.searchsorted(np.array(self.cuts), seen[0], side="right").astype(np.int64), memory


@dataclass(frozen=True, kw_only=True)
class ChangeFeature(LevelFeature):
    """By how much an observation has grown since the last question; 0 at the first."""

    start = math.inf

    @override
    def classes(self, seen: Sequence[Floats], memory: Floats) -> tuple[States, Floats]:
        grown = np.where(np.isinf(memory), np.float32(0.0), seen[0] - memory)
        return np.searchsorted(np.array(self.cuts), grown, side="right").astype(np.int64), seen[0].copy()


@dataclass(frozen=True, kw_only=True)
class SinceFeature(LevelFeature):
    """For how many questions an observation has not been above `above`; endless before the first time."""

    above: float
    start = math.inf

    @override
    def classes(self, seen: Sequence[Floats], memory: Floats) -> tuple[States, Floats]:
        n_since = np.where(seen[0] > self.above, np.float32(0.0), memory + np.float32(1.0))
        return np.searchsorted(np.array(self.cuts), n_since, side="right").astype(np.int64), n_since


@dataclass(frozen=True, kw_only=True)
class SectorFeature(StateFeature):
    """Into which of `n_sectors` equal sectors a direction points; the first is centred on world x."""

    sin: str
    cos: str
    n_sectors: int

    @property
    @override
    def n_classes(self) -> int:
        return self.n_sectors

    @property
    @override
    def observed(self) -> tuple[str, ...]:
        return (self.sin, self.cos)

    @override
    def classes(self, seen: Sequence[Floats], memory: Floats) -> tuple[States, Floats]:
        return find_sectors(seen[0], seen[1], self.n_sectors), memory


@dataclass(frozen=True, kw_only=True)
class WindPositionFeature(StateFeature):
    """Position in the room seen upwind: classes along and across the wind, both between the same `cuts`.

    along = x cos a + y sin a, across = y cos a - x sin a, with a the nearest of eight directions to the one that the
    wind comes from, and x, y between -1 at one wall and 1 at the other.
    """

    x: str
    y: str
    sin: str
    cos: str
    cuts: tuple[float, ...]

    @property
    @override
    def n_classes(self) -> int:
        return (len(self.cuts) + 1) * (len(self.cuts) + 1)

    @property
    @override
    def observed(self) -> tuple[str, ...]:
        return (self.x, self.y, self.sin, self.cos)

    @override
    def classes(self, seen: Sequence[Floats], memory: Floats) -> tuple[States, Floats]:
        x, y, sines, cosines = seen
        angles = 2 * math.pi * find_sectors(sines, cosines, N_HEADINGS) / N_HEADINGS
        sin, cos = elementary.sin_each(angles), elementary.cos_each(angles)
        along, across = (
            np.searchsorted(np.array(self.cuts), part, side="right") for part in (x * cos + y * sin, y * cos - x * sin)
        )
        return (along * (len(self.cuts) + 1) + across).astype(np.int64), memory


DIGITS: dict[str, type[StateFeature]] = {
    "level": LevelFeature,
    "change": ChangeFeature,
    "since": SinceFeature,
    "sector": SectorFeature,
    "wind_place": WindPositionFeature,
}


def find_sectors(sines: Floats, cosines: Floats, n_sectors: int) -> States:
    """Return the nearest of `n_sectors` directions, counter-clockwise from world x, (n,)."""
    turns = elementary.atan2_each(sines, cosines) / (2 * math.pi)
    return np.floor(turns * n_sectors + 0.5).astype(np.int64) % n_sectors


def nth_best_choices(values: Floats, ranks: Floats) -> States:
    """Return the best choices, (n,), of values (n, choices), but for so many better ones, ranks (n,); the first wins.

    Ranks begin again when all choices are through.
    """
    if not ranks.any():
        return np.argmax(values, axis=1)
    order = np.argsort(-values, axis=1, kind="stable")
    return order[np.arange(len(values)), ranks.astype(np.int64) % values.shape[1]]


class ValueTable(ArrayPolicy):
    """Takes the choice that a table values most in the state that digits make of the observations.

    The state is the number that the digits make, the first one counting most. With `turns_with`, the names of the sine
    and the cosine of a direction, headings are counted from the nearest of the eight directions to that one: upwind,
    where that is where the wind comes from. With `yields_with`, the name of what is above a half after a command that
    was refused, the next best choice follows each refusal. A share `explores` of the choices is any of them, as the
    bits of the observation say (`even_numbers`), so that no state holds it for ever.

    Args:
        observation_names: See `Policy`.
        action: See `Policy`; of a kind with choices.
        digits: What makes a state.
        values: (states, choices); of equal values the first wins.
        turns_with: Names of sine and cosine, or nothing.
        yields_with: Name of an observation, or nothing.
        explores: Share of choices that are drawn, from 0 to 1.

    Raises:
        PolicyError: a digit reads what is not observed, or the action has no choices.
    """

    kind: ClassVar[str] = "table"

    def __init__(
        self,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        *,
        digits: Sequence[StateFeature],
        values: Floats,
        turns_with: tuple[str, str] | None = None,
        yields_with: str | None = None,
        explores: float = 0.0,
    ) -> None:
        super().__init__(observation_names, action)
        if not action.n_choices:
            raise PolicyError(f"action.kind: expected one with choices (heading) for a table, was {action.kind!r}.")
        self.digits, self.values, self.arrays = tuple(digits), values, {"values": values}
        self.turns_with, self.yields_with, self.explores = turns_with, yields_with, explores
        read = [name for digit in self.digits for name in digit.observed] + list(turns_with or ())
        read += [] if yields_with is None else [yields_with]
        if strange := sorted(set(read).difference(self.observation_names)):
            raise PolicyError(f"settings: expected names among observation_names, was {', '.join(strange)}.")
        self._places = [[self.observation_names.index(name) for name in digit.observed] for digit in self.digits]
        starts = [0.0 if digit.start is None else digit.start for digit in self.digits]
        self._starts = np.array([*starts, 0.0], np.float32)

    @property
    def n_states(self) -> int:
        """Number of states that the features make."""
        return math.prod(digit.n_classes for digit in self.digits)

    @override
    def memory(self, n: int) -> Floats:
        return np.tile(self._starts, (n, 1))

    def states(self, observations: Floats, memory: Floats) -> tuple[States, Floats]:
        """Return the states upon observations (n, k), (n,), and the next memory."""
        states, after = np.zeros(len(observations), np.int64), memory.copy()
        for i, (digit, places) in enumerate(zip(self.digits, self._places)):
            classes, after[:, i] = digit.classes([observations[:, place] for place in places], memory[:, i])
            states = states * digit.n_classes + classes
        if self.yields_with is not None:
            is_refused = observations[:, self.observation_names.index(self.yields_with)] > _REFUSED
            after[:, -1] = np.where(is_refused, memory[:, -1] + 1, 0)
        return states, after

    def turned(self, choices: States, observations: Floats) -> States:
        """Return the choices of the table as actions: headings turned with the direction, to hold as it is."""
        if self.turns_with is None:
            return choices
        sine, cosine = (observations[:, self.observation_names.index(name)] for name in self.turns_with)
        return np.where(choices < N_HEADINGS, (choices + find_sectors(sine, cosine, N_HEADINGS)) % N_HEADINGS, choices)

    @override
    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        states, after = self.states(observations, memory)
        choices = nth_best_choices(self.values[states], after[:, -1])
        if self.explores:
            shares, n_choices = even_numbers(observations, 2), self.values.shape[1]
            choices = np.where(shares[:, 0] < self.explores, (shares[:, 1] * n_choices).astype(np.int64), choices)
        return self.turned(choices, observations), after

    @property
    @override
    def settings(self) -> dict[str, Any]:
        names = {kind: name for name, kind in DIGITS.items()}
        digits = [{"digit": names[type(digit)], **asdict(digit)} for digit in self.digits]
        return {
            "digits": digits, "turns_with": self.turns_with, "yields_with": self.yields_with, "explores": self.explores,
        }  # fmt: skip

    @classmethod
    @override
    def of_arrays(
        cls,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        arrays: Mapping[str, NDArray[Any]],
        settings: Mapping[str, Any],
    ) -> Self:
        listed, turns_with = settings.get("digits"), settings.get("turns_with")
        if not isinstance(listed, list | tuple) or not listed:
            raise PolicyError(f"settings.digits: expected a list of digits, was {listed!r}.")
        if turns_with is not None and (not isinstance(turns_with, list | tuple) or len(turns_with) != 2):
            raise PolicyError(f"settings.turns_with: expected the names of sine and cosine, was {turns_with!r}.")
        yields_with = settings.get("yields_with")
        if yields_with is not None and not isinstance(yields_with, str):
            raise PolicyError(f"settings.yields_with: expected the name of an observation, was {yields_with!r}.")
        explores = check_number(settings, "explores", is_above=False, default=0.0)
        if explores > 1:
            raise PolicyError(f"settings.explores: expected a share from 0 to 1, was {explores:g}.")
        digits = [_digit_of(one, i) for i, one in enumerate(listed)]
        n_states = math.prod(digit.n_classes for digit in digits)
        values = check_arrays(arrays, {"values": (n_states, action.n_choices or None)})["values"]
        pair = None if turns_with is None else (str(turns_with[0]), str(turns_with[1]))
        return cls(
            observation_names, action, digits=digits, values=values, turns_with=pair, yields_with=yields_with,
            explores=explores,
        )  # fmt: skip


def _digit_of(listed: Any, i: int) -> StateFeature:
    if not isinstance(listed, Mapping) or listed.get("digit") not in DIGITS:
        raise PolicyError(f"settings.digits[{i}]: expected a digit among {', '.join(DIGITS)}, was {listed!r}.")
    values = {name: value for name, value in listed.items() if name != "digit"}
    try:
        if "cuts" in values:
            values["cuts"] = tuple(float(cut) for cut in values["cuts"])
        return DIGITS[listed["digit"]](**values)
    except (TypeError, ValueError) as error:
        raise PolicyError(f"settings.digits[{i}]: expected settings of {listed['digit']}, got: {error}.") from error
