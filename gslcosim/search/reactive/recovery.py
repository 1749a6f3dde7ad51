"""Recovery in the void: three ways to meet a plume again, as single steps along and across the wind."""

from typing import Protocol

from gslcosim.search.random_stream import RandomStream
from gslcosim.search.reactive.spirals import random_side

# Moves relative to the wind, looking upwind.
UPWIND, DOWNWIND, LEFT, RIGHT = range(4)
N_MOVES = 4
# In a circle to the left: each is a quarter turn after the one before.
_CIRCLE_LEFT = (UPWIND, LEFT, DOWNWIND, RIGHT)
_OPPOSITE = (DOWNWIND, UPWIND, RIGHT, LEFT)
# A run that grows for ever needs no more than this many doublings.
_MOST_DOUBLINGS = 30

# Steps ahead and to the left, looking upwind.
STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))


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
    Held by:
        tests/unit/search/reactive/test_recovery.py
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
    Held by:
        tests/unit/search/reactive/test_recovery.py
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
    Held by:
        tests/unit/search/reactive/test_recovery.py
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
            self._left = 2**self._n_runs
            return UPWIND
        self._left -= 1
        return self._side


def make_recovery(name: str, draws: RandomStream, moves_since_gas: list[int]) -> Recovery:
    """Return a recovery that begins now: `backtrack`, `circling` or `cast_surge`."""
    if name == "backtrack":
        return Backtrack(draws, moves_since_gas)
    return Circling(draws) if name == "circling" else CastSurge(draws)
