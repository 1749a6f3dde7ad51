"""Occupancy of sources: for each cell the probability of a source, whatever the other cells hold."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.beliefs import distances_m
from gslcosim.search.grids import CellGrid

Array = NDArray[np.float64]


class SourceOccupancy:
    """The probability of each cell to hold a source, independently of each other, kept as log odds.

    L_i += ln P(finding | source in i) - ln P(finding | none in i)
    P(gas | source in i) = 1 - (1 - F_i)(1 - b),  P(gas | none in i) = b
    [1]; F_i the chance to detect gas of a source in i from here, b the chance of gas that i has no part in

    A declared source explains the gas that it may have sent: then b = 1 - (1 - b0) product over declared (1 - F). The
    cells around it are masked: they are not declared again and change no more.

    State: log odds, clamped, and which cells are masked or declared.

    Source:
        Ferri et al. 2011, Mapping multiple gas/odor sources in an uncontrolled indoor environment using a Bayesian
        occupancy grid mapping based method, Robotics and Autonomous Systems 59 (remembered, unverified).
    Deviation:
        The share of declared sources in what is found is ours.
    Limits:
        Cells that could have sent the same gas are raised together, for each is judged alone: in wind mask a radius
        that reaches along the plume, or cells upwind of a source follow it.
    Held by:
        tests/unit/search/bayes/test_source_occupancy.py
    """

    def __init__(
        self, grid: CellGrid, *, prior: float = 0.01, background: float = 0.05, most_log_odds: float = 10.0
    ) -> None:
        """Begin with equal odds.

        Args:
            grid: The cells.
            prior: Probability of each cell to hold a source.
            background: b0, chance to find gas that is of no source in question, > 0.
            most_log_odds: Where log odds are clamped, so that no cell becomes deaf.
        """
        self.grid = grid
        self.log_odds: Array = np.full(grid.shape, math.log(prior / (1.0 - prior)))
        self.is_masked: NDArray[np.bool_] = np.zeros(grid.shape, np.bool_)
        self._background, self._most = background, most_log_odds
        self._declared: list[tuple[int, ...]] = []

    def probability(self) -> Array:
        """Return the probability of each cell to hold a source; they need not sum to 1."""
        return 1.0 / (1.0 + np.exp(-self.log_odds))

    def update(self, chance: Array, *, is_hit: bool) -> None:
        """Take note of a finding; `chance` is F, of the grid's shape, from 0 to 1."""
        silent = 1.0 - self._background
        for cell in self._declared:
            silent *= 1.0 - float(chance[cell])
        with_source = silent * (1.0 - chance)
        if is_hit:
            gain = np.log(np.maximum(1.0 - with_source, _LEAST)) - math.log(max(1.0 - silent, _LEAST))
        else:
            gain = np.log(np.maximum(with_source, _LEAST)) - math.log(max(silent, _LEAST))
        updated = np.clip(self.log_odds + gain, -self._most, self._most)
        self.log_odds = np.where(self.is_masked, self.log_odds, updated)

    def found(self, *, least: float = 0.9) -> tuple[float, ...] | None:
        """Return the centre of the likeliest cell that is not masked, if it is likely enough, world frame [m]."""
        open_odds = np.where(self.is_masked, -np.inf, self.log_odds)
        index = np.unravel_index(int(open_odds.argmax()), self.grid.shape)
        is_likely = float(open_odds[index]) > math.log(least / (1.0 - least))
        return self.grid.centre_m([int(i) for i in index]) if is_likely else None

    def mask(self, place_m: Sequence[float], radius_m: float) -> None:
        """Declare a source at a place: the cells within a radius are masked, and it explains gas from now on."""
        cell = self.grid.nearest_cell(place_m)
        self._declared.append(cell)
        self.is_masked |= distances_m(self.grid, self.grid.centre_m(cell)) <= radius_m


_LEAST = 1e-300
