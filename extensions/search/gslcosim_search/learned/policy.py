"""Interface of learned policies: from vectors of observations and a memory to actions, for one agent or a thousand."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import MethodError
from gslcosim_search import elementary
from gslcosim_search.learned.encoding import ACTIONS, N_HEADINGS, WORLD, find_frame_problem, find_shield_problem

# float32 throughout; what numpy calls the types of intermediate results is wider.
Floats = NDArray[np.floating[Any]]
# Numbers between -1 and 1, (n, n_numbers), or choices, (n,).
Actions = NDArray[Any]

_KINDS_WITH_CHOICES = ("heading",)
SCRAMBLE_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = (np.uint64(n) for n in (30, 27, 31, 11))


class PolicyError(MethodError):
    """The file of a policy is wrong, or a policy does not fit an agent; the user corrects the file or the scenario."""


@dataclass(frozen=True, kw_only=True)
class ActionSettings:
    """Meaning of an action's numbers: the settings of `gslcosim_search.learned.encoding.action_kind`.

    `hold_s` absent is the briefing's. `frame` is `world`, or `wind` for numbers upwind and to the left of it.
    `shield_m` is the distance that velocities keep from what range finders see [m], see `shield`; absent: none.
    """

    kind: str
    step_m: float = 1.0
    speed_m_s: float = 1.0
    hold_s: float | None = None
    frame: str = WORLD
    shield_m: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in ACTIONS:
            raise PolicyError(f"action.kind: expected one of {', '.join(ACTIONS)}, was {self.kind!r}.")
        if (problem := find_frame_problem(self.kind, self.frame)) is not None:
            raise PolicyError(f"action.frame: {problem}")
        if (problem := find_shield_problem(self.kind, self.shield_m)) is not None:
            raise PolicyError(f"action.shield_m: {problem}")
        for name in ("step_m", "speed_m_s", "hold_s"):
            value = getattr(self, name)
            if value is None and name == "hold_s":
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < float("inf"):
                raise PolicyError(f"action.{name}: expected a number from 0, was {value!r}.")

    @classmethod
    def of(cls, values: Any) -> Self:
        """Return settings from plain values.

        Raises:
            PolicyError: a value is missing, unknown or wrong.
        """
        if not isinstance(values, Mapping) or "kind" not in values:
            raise PolicyError(f"action: expected a map with kind, was {values!r}.")
        known = [item.name for item in fields(cls)]
        if unknown := sorted(set(values).difference(known)):
            raise PolicyError(f"action: expected {', '.join(known)}, was {', '.join(map(str, unknown))}.")
        return cls(**values)

    @property
    def plain(self) -> dict[str, Any]:
        """The settings as plain values."""
        return asdict(self)

    @property
    def n_choices(self) -> int:
        """Number of choices; 0 where actions are numbers."""
        return N_HEADINGS + 1 if self.kind in _KINDS_WITH_CHOICES else 0

    @property
    def n_outputs(self) -> int:
        """Number of outputs of a network: those of an action, or one for each choice."""
        return self.n_choices or ACTIONS[self.kind].n_numbers  # type: ignore[attr-defined]

    def chosen(self, outputs: Floats) -> Actions:
        """Return the actions of a network's outputs, (n, n_outputs): tanh of numbers, the largest of choices."""
        if self.n_choices:
            return np.argmax(outputs, axis=1)
        return elementary.tanh_each(outputs).astype(outputs.dtype)


class Policy(ABC):
    """A policy that has been learned: what it observes, what its actions mean, and how it acts.

    The same code flies one agent and steps a thousand: `act` takes a row for each.

    Args:
        observation_names: Of each number that it observes, as `ObservationVector` names them.
        action: What its actions mean.
    """

    kind: ClassVar[str]

    def __init__(self, observation_names: tuple[str, ...], action: ActionSettings) -> None:
        self.observation_names = tuple(observation_names)
        self.action = action

    @abstractmethod
    def memory(self, n: int) -> Floats:
        """Return the initial memory, (n, size); a policy without a memory has size 0."""

    @abstractmethod
    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        """Return actions, (n, numbers) or (n,), and the next memory, upon observations (n, k); nothing is changed."""


class ArrayPolicy(Policy):
    """A policy whose learned numbers are arrays by name, which `of_arrays` takes: those that files of ours hold."""

    arrays: dict[str, NDArray[Any]]

    @property
    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """Settings that `of_arrays` needs besides the arrays, as plain values."""

    @classmethod
    @abstractmethod
    def of_arrays(
        cls,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        arrays: Mapping[str, NDArray[Any]],
        settings: Mapping[str, Any],
    ) -> Self:
        """Return the policy with these arrays.

        Raises:
            PolicyError: an array is missing, or has another shape than the others ask for.
        """


def check_arrays(arrays: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int | None, ...]]) -> dict[str, Floats]:
    """Return arrays of these names as float32, each of its shape; None stands for any number from 1.

    Raises:
        PolicyError: one is missing, has another shape, or numbers that are not finite.
    """
    return {name: _checked(arrays, name, shape) for name, shape in shapes.items()}


def check_number(settings: Mapping[str, Any], name: str, *, is_above: bool, default: float | None = None) -> float:
    """Return a number of the settings: finite, and from 0, or above it.

    Raises:
        PolicyError: it is missing without a default, or is none.
    """
    value = settings.get(name, default)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 <= value < math.inf or (is_above and value == 0):
        raise PolicyError(f"settings.{name}: expected a number {'above' if is_above else 'from'} 0, was {value!r}.")
    return float(value)


def _checked(arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int | None, ...]) -> Floats:
    if name not in arrays:
        raise PolicyError(f"{name}: expected an array, was missing. It has {', '.join(sorted(arrays)) or 'none'}.")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(b is None or a == b for a, b in zip(array.shape, shape, strict=True))
    if not fits or array.size == 0 or array.dtype.kind not in "fiu":
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise PolicyError(f"{name}: expected numbers of shape ({wanted}), was {array.dtype} of shape {array.shape}.")
    found = np.ascontiguousarray(array, dtype=np.float32)
    if not np.isfinite(found).all():
        raise PolicyError(f"{name}: expected finite numbers, was {int((~np.isfinite(found)).sum())} that are not.")
    return found


def normal_numbers(observations: Floats, n: int) -> NDArray[np.float32]:
    """Return n numbers for each observation (rows, k), as if drawn from the standard normal distribution, (rows, n).

    A policy that was trained with noise leaves by it what the mean of the policy circles in. Sensors are noisy, so
    that the last bits of an observation are as good as a stream of chance, and a policy needs none of its own: what
    flies is a function of what it sees.

    z = sqrt(-2 ln u) cos(2 pi v), u and v from the bits of the observation and the number's index by SplitMix64

    Source:
        Box and Muller 1958; Steele, Lea and Flood 2014, doi:10.1145/2660193.2660195.
    Held by:
        extensions/search/tests/unit/learned/test_policy.py
    """
    shares = even_numbers(observations, 2 * n)
    lengths = np.sqrt(-2.0 * elementary.log1p_each(-shares[:, :n]))
    return (lengths * elementary.cos_each(2 * np.pi * shares[:, n:])).astype(np.float32)


def add_spread(outputs: Floats, observations: Floats, spread: float) -> Floats:
    """Return a network's outputs (rows, n) with numbers of standard deviation `spread` added; see `normal_numbers`."""
    return outputs + np.float32(spread) * normal_numbers(observations, outputs.shape[1]) if spread else outputs


def read_spread(settings: Mapping[str, Any], action: ActionSettings) -> float:
    """Return the spread that a policy's settings name, 0 where they name none.

    Raises:
        PolicyError: it is no number from 0, or the actions are choices.
    """
    spread = check_number(settings, "spread", is_above=False, default=0.0)
    if spread and action.n_choices:
        raise PolicyError(f"settings.spread: expected 0 for action {action.kind}, which has choices, was {spread}.")
    return spread


def even_numbers(observations: Floats, n: int) -> NDArray[np.float64]:
    """Return n numbers for each observation (rows, k), as if drawn evenly from 0 to below 1, (rows, n).

    Source and test: as `normal_numbers`.
    """
    bits = np.ascontiguousarray(observations, np.float32).view(np.uint32).astype(np.uint64)
    mixed = np.zeros(len(bits), np.uint64)
    with np.errstate(over="ignore"):
        for i in range(bits.shape[1]):
            mixed = scramble_bits(mixed ^ bits[:, i])
        counted = mixed[:, None] + SCRAMBLE_STEP * np.arange(1, n + 1, dtype=np.uint64)
        return (scramble_bits(counted) >> _11).astype(np.float64) * 2.0**-53


def scramble_bits(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the output of SplitMix64 after each state: 64 bits that look unrelated to those of neighbouring states."""
    z = z + SCRAMBLE_STEP
    z = (z ^ (z >> _30)) * _FIRST
    z = (z ^ (z >> _27)) * _SECOND
    return z ^ (z >> _31)
