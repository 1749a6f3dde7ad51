"""Where to go with a belief: the likeliest place, or the one with the most probability for the way to it."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Command, Observation
from gslcosim.search.beliefs import distances_m
from gslcosim.search.grids import CellGrid
from gslcosim.search.moving.grid_paths import Free, shortest_path
from gslcosim.search.moving.map_flights import MapFlights
from gslcosim.search.moving.piloting import step_towards_m

Array = NDArray[np.float64]
Point = tuple[float, float]
# The last bits of a Fourier transform decide nothing: places that are equally good tie on every machine.
_DIGITS = 9


def mass_around(p: Array, reach_cells: int) -> Array:
    """Return the probability within a square about each cell, `reach_cells` to each side; beyond the grid is none."""
    for axis in range(2):
        n = p.shape[axis]
        running = np.concatenate([np.zeros_like(np.take(p, [0], axis)), np.cumsum(p, axis=axis)], axis=axis)
        centre = np.arange(n)
        last, first = np.minimum(centre + reach_cells + 1, n), np.maximum(centre - reach_cells, 0)
        p = np.take(running, last, axis) - np.take(running, first, axis)
    return p


def expected_information_bits(p: Array, chance: Array) -> Array:
    """Return how much the next finding, gas or none, is expected to tell of the source, for a sensor in each cell.

    I(x) = h(sum over s of p(s) F(s - x)) - sum over s of p(s) h(F(s - x)),  h(q) = -q log2 q - (1 - q) log2(1 - q)
    [bit]; F(o) chance that gas is detected of a source at the offset o from the sensor

    The exact mutual information of source and finding, for all places at once: both sums are correlations.

    Args:
        p: (nx, ny) belief, sum 1.
        chance: (2 nx - 1, 2 ny - 1) F by offset in cells; the middle is a source in the sensor's own cell.

    Returns:
        (nx, ny), none negative, to 1e-9 bit.

    Source:
        Shannon 1948; as a plan for a sensor: infotaxis (Vergassola et al. 2007) for a whole room and one finding.
    Held by:
        tests/unit/search/bayes/test_source_goals.py (against its definition, sum by sum)
    """
    shape = tuple(3 * n - 2 for n in p.shape)
    spectrum = np.fft.rfft2(p, shape)
    detected = np.clip(_correlated(spectrum, chance, shape, p.shape), 0.0, 1.0)
    left = _correlated(spectrum, _binary_entropy_bits(chance), shape, p.shape)
    gain: Array = np.maximum(_binary_entropy_bits(detected) - left, 0.0)
    return np.round(gain, _DIGITS)


def best_goal(
    worth: Array, grid: CellGrid, goals: Free, here_m: Sequence[float], *, near_m: float, least_m: float = 0.0
) -> Point:
    """Return the goal of the greatest worth for the way to it.

    argmax over c of w(c) / (|c - x| + n)        n the way that every visit costs, however near [m]

    Of equally good ones the first in the order of the grid is taken.

    Args:
        worth: w, of the grid's shape.
        grid: The cells.
        goals: Cells that may be a goal; at least one.
        here_m: Where the vehicle is, x, world frame [m].
        near_m: n [m]; infinite: the way does not count.
        least_m: Goals nearer than this do not count, where there are others [m].

    Source:
        Probability per cost, as in search theory (Stone 1975, Theory of Optimal Search).
    Held by:
        tests/unit/search/bayes/test_source_goals.py
    """
    ways_m = distances_m(grid, here_m)
    per_metre = worth if math.isinf(near_m) else worth / (ways_m + near_m)
    far = goals & (ways_m >= least_m)
    i, j = np.unravel_index(int(np.where(far if far.any() else goals, per_metre, -1.0).argmax()), grid.shape)
    x_m, y_m = grid.centre_m((int(i), int(j)))
    return x_m, y_m


def coarser(p: Array, grid: CellGrid, *, least_cell_m: float) -> tuple[Array, CellGrid]:
    """Return a belief on the finest coarser cells whose edge is at least that long [m], whole blocks of old ones."""
    n = max(1, math.ceil(least_cell_m / grid.cell_m - 1e-9))
    shape = tuple(math.ceil(size / n) for size in grid.shape)
    padded = np.pad(p, [(0, n * blocks - size) for blocks, size in zip(shape, grid.shape, strict=True)])
    summed = padded.reshape(shape[0], n, shape[1], n).sum(axis=(1, 3))
    return summed, CellGrid(grid.origin_m, grid.cell_m * n, shape)


class GoalFlights:
    """Flies towards goals in steps, round the obstacles of a granted map, and gives up goals that are refused.

    State: the flights' pilot, and which cells were refused.

    Held by:
        tests/unit/search/bayes/test_source_goals.py
    """

    def __init__(self, flights: MapFlights, *, step_m: float, radius_m: float = 0.5) -> None:
        """Begin with every cell that can be flown to.

        Args:
            flights: Gives cells, ways and the pilot.
            step_m: Longest leg [m].
            radius_m: After a refusal no cell within so far of the goal is a goal again [m].
        """
        self.flights = flights
        self.goals: Free = flights.flyable.copy()
        self._step_m, self._radius_m = step_m, radius_m
        # Ways are compiled, or loaded from the cache on disk, before the flight.
        low_m, high_m = flights.pilot.room.min_m, flights.pilot.room.max_m
        shortest_path(flights.flyable, flights.grid, low_m[:2], high_m[:2])
        self._goal_m: Point | None = None

    def leg(self, observation: Observation, goal_m: Point, *, hold_s: float | None = None) -> Command:
        """Return the command for the next step towards a goal, world frame [m]."""
        self._goal_m = goal_m
        pilot, here_m = self.flights.pilot, observation.position_world_m[:2]
        way_m = shortest_path(self.flights.flyable, self.flights.grid, here_m, goal_m)
        bend_m = goal_m if way_m is None or len(way_m) < 2 else (float(way_m[1][0]), float(way_m[1][1]))
        return pilot.leg(observation, step_towards_m(here_m, bend_m, self._step_m), hold_s=hold_s)

    def is_goal(self, place_m: Sequence[float]) -> bool:
        """Return whether a place lies in a cell that may be a goal."""
        cell = self.flights.grid.cell_at(place_m)
        return cell is not None and bool(self.goals[cell])

    def note_refusal(self, observation: Observation) -> None:
        """Give up the last goal if the vehicle tells that it could not go on; call it before the next is chosen."""
        if self._goal_m is None or not self.flights.pilot.was_refused(observation):
            return
        left = self.goals & (distances_m(self.flights.grid, self._goal_m) > self._radius_m)
        # When nothing is left the refusals are forgotten: a vehicle that moved may be let through now.
        self.goals = left if left.any() else self.flights.flyable.copy()


# sum over s of p(s) F(s - x): F's middle is the offset 0.
def _correlated(
    spectrum: NDArray[np.complex128], chance: Array, shape: tuple[int, ...], size: tuple[int, ...]
) -> Array:
    flipped = chance[::-1, ::-1]
    full = np.fft.irfft2(np.fft.rfft2(flipped, shape) * spectrum, shape)
    return full[size[0] - 1 : 2 * size[0] - 1, size[1] - 1 : 2 * size[1] - 1]


def _binary_entropy_bits(chance: Array) -> Array:
    safe = np.clip(chance, 1e-300, 1.0)
    rest = np.clip(1.0 - chance, 1e-300, 1.0)
    return -(safe * np.log2(safe) + rest * np.log2(rest))
