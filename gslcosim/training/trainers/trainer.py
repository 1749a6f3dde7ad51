"""What every trainer is: it learns in rounds, can stop between two of them, and has a policy at any time."""

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from gslcosim.errors import UsageError


class Trainer(Protocol):
    """Learns in rounds. Nothing but what `state` tells goes from one round into the next."""

    @property
    def is_over(self) -> bool:
        """Whether all rounds are done."""
        ...

    def step(self) -> Mapping[str, float]:
        """Learn for a round, and return its figures."""
        ...

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all that the next rounds depend on, as arrays by name."""
        ...

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a state of a trainer with the same settings."""
        ...

    def policy(self) -> Any:
        """Return what has been learned so far: a `Policy`, or `MethodParameters`."""
        ...


def taken_from(state: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int | None, ...]]) -> None:
    """Check that a state has arrays of these shapes; None stands for any number.

    Raises:
        UsageError: it has others.
    """
    for name, shape in shapes.items():
        found = state[name].shape if name in state else None
        fits = found is not None and len(found) == len(shape)
        if not fits or any(b is not None and a != b for a, b in zip(found or (), shape)):
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            raise UsageError(
                f"checkpoint: {name}: expected an array of shape ({wanted}), was "
                f"{'none' if found is None else found}. Take the settings that it was made with."
            )
