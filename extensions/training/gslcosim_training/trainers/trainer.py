"""Interface of trainers, costs of policies in a batch, and a curriculum of cases."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gslcosim.base.errors import UsageError
from gslcosim.scenario.models.base import NonNegative, Positive, Spec
from gslcosim_search.learned.policy import Policy

_Count = Annotated[int, Field(ge=1, le=1_000_000)]
_Share = Annotated[float, Field(ge=0, le=1)]
_SEEN = ("nose_ppm.amount", "wind.from_sin", "wind.from_cos", "x", "y", "refused")
_Names = Annotated[tuple[str, ...], Field(min_length=1)]
# From mean costs of cases, NaN where not flown, to how often each comes; see `Family.weights`.
Weights = Callable[[NDArray[np.float64]], NDArray[np.float64]]
# Of a case's mean cost: the newest search counts a half.
_NEWEST = 0.5
_NEEDED = ("case", "success", "time_s", "distance_to_source_m")


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
        """Return the policy learned so far: a `Policy`, or `EvolvedParameters`."""
        ...


def check_state(state: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int | None, ...]]) -> None:
    """Check that a state has arrays of these shapes; None stands for any number."""
    for name, shape in shapes.items():
        found = state[name].shape if name in state else None
        fits = found is not None and len(found) == len(shape)
        if not fits or any(b is not None and a != b for a, b in zip(found or (), shape)):
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            raise UsageError(
                f"checkpoint: {name}: expected an array of shape ({wanted}), was "
                f"{'none' if found is None else found}. Take the settings that it was made with."
            )


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


@dataclass(frozen=True, kw_only=True)
class SearchOutcomes:
    """Outcomes of searches: success, time [s] and last distance to the source [m] of each."""

    success: NDArray[np.bool_]
    time_s: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    n_steps: int

    def costs(self, time_limits_s: NDArray[np.float64], diagonals_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cost of each search, between 0 and 2; see `compute_costs`."""
        return compute_costs(self.success, self.time_s / time_limits_s, self.distance_m / diagonals_m)


def compute_costs(
    success: NDArray[np.bool_], shares_of_time: NDArray[np.float64], shares_of_room: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the costs of searches, between 0 and 2.

    cost = t / limit upon success, else 1 + distance / diagonal, so that who fails nearer fails less.

    Args:
        success: Of each search, (n,).
        shares_of_time: Times over time limits, (n,).
        shares_of_room: Last distances to the source over diagonals of rooms, (n,).
    """
    return np.where(success, shares_of_time, 1.0 + np.minimum(shares_of_room, 1.0))


def run_searches(
    envs: Any, policies: Sequence[Policy], cases: NDArray[np.int64], seeds: NDArray[np.int64], places: NDArray[np.int64]
) -> SearchOutcomes:
    """Fly every policy in every case, each once, and return how the searches ended, policy by policy.

    Args:
        envs: A `BatchSearchEnv` with a search for each policy and case.
        cases: Which cases, (k,).
        seeds: Of gas and noise, (k,): the same for all policies.
        places: Where the policies' observations stand in those of `envs`.
    """
    n_policies, k = len(policies), len(cases)
    n = n_policies * k
    chosen = {"cases": np.tile(cases, n_policies), "seeds": np.tile(seeds, n_policies)}
    observed, infos = envs.reset(seed=0, options=chosen)
    parts = [slice(i * k, (i + 1) * k) for i in range(n_policies)]
    memories = [policy.memory(k) for policy in policies]
    is_over, success = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    time_s, distance_m = np.zeros(n), np.array(infos["distance_to_source_m"], np.float64)
    n_steps = 0
    while not is_over.all():
        seen, actions = np.ascontiguousarray(observed[:, places]), []
        for i, policy in enumerate(policies):
            chosen_now, memories[i] = policy.act(seen[parts[i]], memories[i])
            actions.append(chosen_now)
        n_steps += int((~is_over).sum())
        observed, _, terminated, truncated, infos = envs.step(np.concatenate(actions))
        ends = (np.asarray(terminated) | np.asarray(truncated)) & ~is_over
        if ends.any():
            success[ends] = np.asarray(infos["success"])[ends]
            time_s[ends] = np.asarray(infos["time_s"])[ends]
            distance_m[ends] = np.asarray(infos["distance_to_source_m"])[ends]
            is_over |= ends
    return SearchOutcomes(success=success, time_s=time_s, distance_m=distance_m, n_steps=n_steps)


class Curriculum:
    """Mean costs of cases, of which the newest search counts a half; NaN where a case has not been flown.

    Args:
        weights: From mean costs to how often each case comes.
        time_limits_s: Of the cases, (n_cases,) [s].
        diagonals_m: Of the cases' rooms, (n_cases,) [m].
    """

    def __init__(
        self, weights: Weights, *, time_limits_s: NDArray[np.float64], diagonals_m: NDArray[np.float64]
    ) -> None:
        self._weights, self._limits_s, self._diagonals_m = weights, time_limits_s, diagonals_m
        self.costs = np.full(len(time_limits_s), np.nan)

    @property
    def shares(self) -> NDArray[np.float64]:
        """Probabilities with which the cases come, (n_cases,)."""
        return self._weights(self.costs)

    def count(self, infos: Mapping[str, Any], ends: NDArray[np.bool_]) -> None:
        """Remember the searches that have ended, in their order.

        Args:
            infos: What a batch returns of a step, or its `final_info` where searches begin again at once.
        """
        ended = infos.get("final_info", infos)
        if missing := [name for name in _NEEDED if name not in ended]:
            raise UsageError(
                f"doping: expected environments that tell {', '.join(_NEEDED)} of searches that end, was without "
                f"{', '.join(missing)}. Take a BatchSearchEnv, or train without doping."
            )
        cases, success, time_s, distance_m = (np.asarray(ended[name])[ends] for name in _NEEDED)
        cases = cases.astype(np.int64)
        costs = compute_costs(
            success.astype(bool), time_s / self._limits_s[cases], distance_m / self._diagonals_m[cases]
        )
        for case, cost in zip(cases.tolist(), costs.tolist(), strict=True):
            before = self.costs[case]
            self.costs[case] = cost if np.isnan(before) else (1 - _NEWEST) * before + _NEWEST * cost
