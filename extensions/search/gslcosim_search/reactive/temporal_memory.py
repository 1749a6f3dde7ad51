"""Temporal memory of a plume as one of a few states, and recovery in the void.

Held by:
    extensions/search/tests/unit/reactive/test_temporal_memory.py
"""

import math
from collections import deque
from pathlib import Path
from typing import Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.untrusted_input import read_json
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.cast_and_surge import BlankMemory
from gslcosim_search.reactive.spirals import random_side

# The functions take arrays and plain numbers only, so that a trainer may compile them with numba as they are.


Floats = NDArray[np.float64]

# Upper ends of the classes: share of the memory with gas, and rank of its mean among all amounts met so far.
SHARE_CUTS = (0.33, 0.66)
RANK_CUTS = (0.25, 0.5, 0.8, 0.99)
N_GAS_STATES = (len(SHARE_CUTS) + 1) * (len(RANK_CUTS) + 1)
# In the void a state for each decision since the last gas; the last one stands for all that follow.
N_VOID_STATES = 50
N_STATES = N_GAS_STATES + N_VOID_STATES
N_MOVES = 4
# Moves relative to the wind, looking upwind.
UPWIND, DOWNWIND, LEFT, RIGHT = range(4)
# In a circle to the left: each is a quarter turn after the one before.
_CIRCLE_LEFT = (UPWIND, LEFT, DOWNWIND, RIGHT)
_OPPOSITE = (DOWNWIND, UPWIND, RIGHT, LEFT)
# A run that grows for ever needs no more than this many doublings.
_MOST_DOUBLINGS = 30
# Steps ahead and to the left, looking upwind.
STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))


def memory_features(amounts: Floats, n: int, noise: float) -> tuple[float, float]:
    """Return the fraction of the memory with gas, and the mean amount of that gas.

    threshold s = max(0.5 mean(M), noise)        M the n amounts in memory
    share = |{m in M: m > s}| / n                mean = mean of these m, 0 without any

    Args:
        amounts: (>= n,) the memory first; what follows is not looked at.
        noise: Amounts up to this are no gas.

    Source:
        Rando, James, Verri, Rosasco, Seminara 2025 (arXiv 2404.17495), read in code.
    """
    if n == 0:
        return 0.0, 0.0
    memory = amounts[:n]
    gas = memory[memory > max(0.5 * memory.mean(), noise)]
    if gas.size == 0:
        return 0.0, 0.0
    return gas.size / n, gas.mean()


def rank_frac(amount: float, history: Floats, n: int) -> float:
    """Return which share of the first `n` amounts of a history is less than an amount; 0 without a history."""
    return np.sum(history[:n] < amount) / max(n, 1)


def gas_state(share_frac: float, rank: float) -> int:
    """Return the state of a memory with gas: 5 times the class of its share, plus the class of its rank.

    classes by upper ends: share 0.33, 0.66; rank 0.25, 0.5, 0.8, 0.99

    Source:
        Rando et al. 2025: cuts of the share, and percentiles of all amounts met so far on this path.
    """
    by_share = 0
    for cut in SHARE_CUTS:
        if share_frac > cut:
            by_share += 1
    by_rank = 0
    for cut in RANK_CUTS:
        if rank > cut:
            by_rank += 1
    return by_share * (len(RANK_CUTS) + 1) + by_rank


def void_state(n_decisions: int) -> int:
    """Return the state after so many decisions without gas, from 1 on."""
    return N_GAS_STATES + min(n_decisions, N_VOID_STATES) - 1


class TemporalMemory:
    """The memory of a searcher: amounts of the last T seconds, all amounts met, and how long ago gas was.

    T is as long as the last blank (`cast_and_surge.BlankMemory`), or fixed where `adapts` is false. Amounts above
    `noise` are gas. The history is of the amounts that are gas, at most `MOST_HISTORY` of them, the last ones.

    State: the amounts with their times, the history, the blanks, and decisions since the last state with gas.

    Source:
        Rando et al. 2025, the adaptive memory.
    Deviation:
        T in seconds with bounds, not in steps: legs differ in length. The rank replaces percentiles, which come to the
        same but for ties.
    """

    MOST_HISTORY = 3000

    def __init__(
        self, *, noise: float, first_s: float, least_s: float = 1.0, most_s: float = 30.0, adapts: bool = True
    ) -> None:
        """Begin without gas, with a memory of `first_s`."""
        self._noise = noise
        self._fixed_s = None if adapts else first_s
        self._blanks = BlankMemory(first_s=first_s, least_s=least_s, most_s=most_s, shortest_blank_s=0.15)
        self._most_s = max(most_s, first_s)
        self._amounts: deque[tuple[float, float]] = deque()
        self._history: deque[float] = deque(maxlen=self.MOST_HISTORY)
        self.n_void = 0

    @property
    def memory_s(self) -> float:
        """T, how far back it looks [s]."""
        return self._blanks.memory_s if self._fixed_s is None else self._fixed_s

    def add(self, time_s: float, amount: float) -> None:
        """Take note of an amount at a time [s]; a time counts once, broken amounts not at all."""
        if not math.isfinite(amount) or (self._amounts and time_s <= self._amounts[-1][0]):
            return
        self._amounts.append((time_s, amount))
        while self._amounts[0][0] < time_s - self._most_s:
            self._amounts.popleft()
        if amount > self._noise:
            self._blanks.note_hit(time_s)
            self._history.append(amount)

    def decide(self, time_s: float) -> int:
        """Return the state at a decision; without gas in memory it counts the decisions in the void."""
        recent = np.array([amount for t, amount in self._amounts if t > time_s - self.memory_s])
        share_frac, mean = memory_features(recent, len(recent), self._noise)
        if share_frac == 0.0:
            self.n_void += 1
            return void_state(self.n_void)
        self.n_void = 0
        return gas_state(share_frac, rank_frac(mean, np.array(self._history), len(self._history)))


class _Policies(TypedDict):
    tables: dict[str, list[list[float]]]


def load_policies(path: Path) -> dict[str, list[list[float]]]:
    """Return tables of values (state, move) by the name of the recovery that they were learned with."""
    return read_json(path, _Policies)["tables"]


def best_move(values: list[float]) -> int:
    """Return the move of the greatest value, the first of equal ones."""
    return max(range(len(values)), key=lambda move: (values[move], -move))


def opposite_move(move: int) -> int:
    """Return the move that undoes a move."""
    return _OPPOSITE[move]


class Recovery(Protocol):
    """Gives moves until there is gas again; one is made for each time in the void."""

    def next_move(self) -> int:
        """Return the next move."""
        ...


class Backtrack:
    """Undoes the moves since the last gas, the last one first; then it moves at random.

    Source:
        Rando, James, Verri, Rosasco, Seminara 2025 (arXiv 2404.17495), read in code.
    """

    def __init__(self, draws: RandomStream, moves_since_gas: list[int]) -> None:
        """Begin at the end of `moves_since_gas`, which are copied."""
        self._draws = draws
        self._moves = list(moves_since_gas)

    def next_move(self) -> int:
        """Return the next move; a random one costs a draw."""
        return opposite_move(self._moves.pop()) if self._moves else self._draws.index(N_MOVES)


class Circling:
    """A square spiral of runs of 1, 2, 3, ... steps, turned by a right angle after each.

    The first run goes in a random direction; the turns are all to one random side.

    Source:
        Rando et al. 2025, read in code.
    Deviation:
        That direction and side are random is ours.
    """

    def __init__(self, draws: RandomStream) -> None:
        """Begin with a direction and a side; costs two draws."""
        self._at = draws.index(N_MOVES)
        self._side = random_side(draws)
        self._run = 1
        self._left = 1

    def next_move(self) -> int:
        """Return the next move."""
        if self._left == 0:
            self._run += 1
            self._left = self._run
            self._at = (self._at + self._side) % N_MOVES
        self._left -= 1
        return _CIRCLE_LEFT[self._at]


class CastSurge:
    """Runs across the wind of 1, 2, 4, ... steps, with one step upwind and a change of side between them.

    Source:
        Rando et al. 2025, read in code; there it is much worse than circling.
    Deviation:
        The first side is random.
    """

    def __init__(self, draws: RandomStream) -> None:
        """Begin with a side; costs one draw."""
        self._side = LEFT if random_side(draws) > 0 else RIGHT
        self._n_runs = 0
        self._left = 1

    def next_move(self) -> int:
        """Return the next move."""
        if self._left == 0:
            self._side = opposite_move(self._side)
            self._n_runs = min(self._n_runs + 1, _MOST_DOUBLINGS)
            self._left = 1 << self._n_runs
            return UPWIND
        self._left -= 1
        return self._side


def make_recovery(name: str, draws: RandomStream, moves_since_gas: list[int]) -> Recovery:
    """Return a recovery that begins now: `backtrack`, `circling` or `cast_surge`."""
    if name == "backtrack":
        return Backtrack(draws, moves_since_gas)
    return Circling(draws) if name == "circling" else CastSurge(draws)
