"""Rewards of agents, by name or by a function of your own."""

from collections.abc import Callable
from dataclasses import dataclass

from gslcosim.base.errors import UsageError

# Of the success, in units of which everything else is measured.
SUCCESS = 1.0
# The outcome of a search that was cut off: it is truncated, and every other end terminates it.
TIME_LIMIT = "time_limit"


@dataclass(frozen=True, kw_only=True)
class AgentState:
    """State of an agent before or after a step.

    `distance_m` is its distance to the nearest source, `time_s` the simulated time, `n_commands` how many commands it
    has given; `outcome` is absent while it searches. `path_m` is the length of the shortest free path to that source,
    absent where it is the distance.
    """

    distance_m: float
    time_s: float
    n_commands: int
    outcome: str | None = None
    path_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class TaskScale:
    """Scales of a task: the diagonal of its room [m], its time limit [s], and the discount."""

    diagonal_m: float
    time_limit_s: float
    discount: float


Reward = Callable[[AgentState, AgentState, TaskScale], float]


def sparse(before: AgentState, after: AgentState, scale: TaskScale) -> float:
    """Return 1 upon success, and 0 otherwise."""
    del before, scale
    return SUCCESS if after.outcome == "success" else 0.0


def potential(before: AgentState, after: AgentState, scale: TaskScale) -> float:
    """Return `sparse`, less the share of the time limit that the step took, and a shaping that changes no best policy.

    g F(after) - F(before), with the potential F = -path / diagonal while the search goes on and 0 after its end,
    and the discount g. The path leads around what is solid: a distance through walls has its hills there, and holds
    back who has to go away to come near. A search that the time limit cuts off has not come to an end, so its potential
    stays.

    Source:
        Ng, Harada and Russell 1999, Policy invariance under reward transformations, theorem 1.
    Held by:
        extensions/training/tests/unit/test_rewards.py
    """
    shaping = scale.discount * _potential(after, scale) - _potential(before, scale)
    return sparse(before, after, scale) - (after.time_s - before.time_s) / scale.time_limit_s + shaping


def _potential(moment: AgentState, scale: TaskScale) -> float:
    length_m = moment.distance_m if moment.path_m is None else moment.path_m
    return 0.0 if moment.outcome not in (None, TIME_LIMIT) else -length_m / scale.diagonal_m


REWARDS: dict[str, Reward] = {"sparse": sparse, "potential": potential}


def reward_function(reward: str | Reward) -> Reward:
    """Return the function of a name; a function is returned as it is."""
    if callable(reward):
        return reward
    if reward not in REWARDS:
        raise UsageError(f"reward: expected one of {', '.join(REWARDS)}, or a function, was {reward!r}.")
    return REWARDS[reward]
