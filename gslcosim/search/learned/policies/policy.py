"""What a learned policy is: from vectors of observations and a memory to actions, for one agent or a thousand."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import MethodError
from gslcosim.search.learned.acting import ACTIONS, N_HEADINGS

# float32 throughout; what numpy calls the types of intermediate results is wider.
Floats = NDArray[np.floating[Any]]
# Numbers between -1 and 1, (n, n_numbers), or choices, (n,).
Actions = NDArray[Any]

_KINDS_WITH_CHOICES = ("heading",)


class PolicyError(MethodError):
    """The file of a policy is wrong, or a policy does not fit an agent; the user corrects the file or the scenario."""


@dataclass(frozen=True, kw_only=True)
class ActionSettings:
    """What the numbers of an action mean: the settings of `gslcosim.search.learned.acting.action_kind`.

    `hold_s` absent is the briefing's.
    """

    kind: str
    step_m: float = 1.0
    speed_m_s: float = 1.0
    hold_s: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in ACTIONS:
            raise PolicyError(f"action.kind: expected one of {', '.join(ACTIONS)}, was {self.kind!r}.")
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
        """How many choices there are; 0 where actions are numbers."""
        return N_HEADINGS + 1 if self.kind in _KINDS_WITH_CHOICES else 0

    @property
    def n_outputs(self) -> int:
        """How many numbers a network puts out: those of an action, or one for each choice."""
        return self.n_choices or ACTIONS[self.kind].n_numbers  # type: ignore[attr-defined]

    def chosen(self, outputs: Floats) -> Actions:
        """Return the actions of a network's outputs, (n, n_outputs): tanh of numbers, the largest of choices."""
        if self.n_choices:
            return np.argmax(outputs, axis=1)
        return np.tanh(outputs)


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
        """Return what it remembers at the beginning, (n, size); a policy without a memory has size 0."""

    @abstractmethod
    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        """Return actions, (n, numbers) or (n,), and the next memory, upon observations (n, k); nothing is changed."""

    @property
    @abstractmethod
    def arrays(self) -> dict[str, NDArray[Any]]:
        """What was learned, by name, as `of_arrays` takes it."""

    @property
    def settings(self) -> dict[str, Any]:
        """What `of_arrays` needs besides the arrays, as plain values."""
        return {}

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


def checked(arrays: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int | None, ...]]) -> dict[str, Floats]:
    """Return arrays of these names as float32, each of its shape; None stands for any number from 1.

    Raises:
        PolicyError: one is missing, has another shape, or numbers that are not finite.
    """
    return {name: _checked(arrays, name, shape) for name, shape in shapes.items()}


def checked_number(settings: Mapping[str, Any], name: str, *, is_above: bool, default: float | None = None) -> float:
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
