"""Interface of trainers: rounds that can stop between two of them, a policy at any time, and their settings."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Protocol

from numpy.typing import NDArray
from pydantic import Field

from gslcosim.base.errors import UsageError
from gslcosim.scenario.models.base import NonNegative, Positive, Spec


class Trainer(Protocol):
    """Learns in rounds. Nothing but what `state`` holds goes from one round into the next."""

    @property
    def is_over(self) -> bool:
        """True if all rounds are done."""
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
        """Return what has been learned so far: a `Policy`, or `EvolvedParameters`."""
        ...


def check_state(state: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int | None, ...]]) -> None:
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


_Count = Annotated[int, Field(ge=1, le=1_000_000)]
_Share = Annotated[float, Field(ge=0, le=1)]
_SEEN = ("nose_ppm.amount", "wind.from_sin", "wind.from_cos", "x", "y", "refused")
_Names = Annotated[tuple[str, ...], Field(min_length=1)]


class CtrnnSettings(Spec):
    """Evolution of a continuous-time recurrent network of `n_neurons`.

    In each of `rounds` generations a `population` of networks searches in `cases_per_round` cases; `spread` is the
    standard deviation of the first. `flown_spread` is that of what is added to the outputs in all flights.
    """

    kind: Literal["ctrnn"]
    rounds: _Count = 200
    population: Annotated[int, Field(ge=4, le=10_000)] = 24
    cases_per_round: _Count = 32
    n_neurons: Annotated[int, Field(ge=1, le=1000)] = 8
    spread: Positive = 0.5
    flown_spread: NonNegative = 0.0
    observations: _Names = _SEEN


class TableSettings(Spec):
    """Tabular Q-learning, the smallest example.

    In each of `rounds` a number of `searches` flies `steps_per_round` legs; the share of random legs falls from
    `explore` to `explore_last`, with which the table is flown, the rate of learning from `rate` to `rate_last`. The
    state is made of the `gas` now in classes between `gas_cuts`, of whether there is more than at the leg before, of
    how many legs ago there was gas last, in classes between `since_cuts`, and with `place_cuts` of where in the room it
    is, seen upwind; legs are counted from the wind, and after one that was `refused` the next best follows.
    """

    kind: Literal["table"]
    rounds: _Count = 60
    searches: _Count = 512
    steps_per_round: _Count = 128
    explore: _Share = 0.5
    explore_last: _Share = 0.2
    rate: _Share = 0.3
    rate_last: _Share = 0.02
    discount: _Share = 0.99
    gas: str = "nose_ppm.amount"
    gas_cuts: tuple[float, ...] = (0.02, 0.1, 0.2, 0.3)
    change_cuts: tuple[float, ...] = (-0.005, 0.005)
    since_cuts: tuple[float, ...] = (1, 2, 3, 4, 6, 8, 12, 16, 24, 1e6)
    place_cuts: tuple[float, ...] = ()
    wind: tuple[str, str] = ("wind.from_sin", "wind.from_cos")
    refused: str = "refused"


class MethodSettings(Spec):
    """Evolution of the parameters of a `method` within `ranges`, least and most of each, in flights of this process.

    In each of `rounds` generations a `population` of settings flies `cases_per_round` cases with so many `robots`.
    `spread` is the standard deviation of the first about the method's defaults, in halves of the ranges.
    """

    kind: Literal["method"]
    method: str
    robots: Annotated[int, Field(ge=1, le=100)] = 1
    ranges: dict[str, tuple[float, float]]
    rounds: _Count = 10
    population: Annotated[int, Field(ge=4, le=10_000)] = 8
    cases_per_round: _Count = 8
    spread: Positive = 0.25
