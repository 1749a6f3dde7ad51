"""Langevin motion on a belief: downhill on its potential with as much noise as a temperature says, and swapped roles.

A cold robot goes to the most likely place (it exploits), a hot one wanders (it explores). Where the cold one stands
worse than a hotter one, they swap temperatures: the place keeps its robot, and the robot that stands well becomes cold.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.grids import CellGrid

Floats = NDArray[np.float64]

LEAST_P = 1e-9


def belief_potential(p: Floats) -> Floats:
    """Return the potential of a belief, of the same shape: Phi = -ln max(p, 1e-9).

    Source:
        SniffySquad (arXiv 2411.06121), Phi = -log p. The floor is ours: cells of probability 0 have no slope.
    Held by:
        tests/unit/search/swarms/test_langevin.py
    """
    return -np.log(np.maximum(p, LEAST_P))


def potential_slope(potential: Floats, grid: CellGrid, point_m: Sequence[float]) -> Floats:
    """Return the gradient of a potential at a point (2,), by central differences over the cells beside it.

    dPhi/dx = (Phi[i + 1, j] - Phi[i - 1, j]) / (2 h), the same in y        h edge of a cell [m]; one-sided at the rim
    [1/m] = [1] / [m]

    Args:
        potential: (nx, ny) potential at the centres of the cells.
        grid: The cells.
        point_m: The place; that of the nearest cell is taken, world frame [m].

    Source:
        SniffySquad (arXiv 2411.06121), central differences; h is not given there.
    Held by:
        tests/unit/search/swarms/test_langevin.py (exact for a plane)
    """
    i, j = grid.nearest_cell(point_m)
    slope = np.zeros(2)
    for axis, (index, line) in enumerate(((i, potential[:, j]), (j, potential[i, :]))):
        low, high = max(index - 1, 0), min(index + 1, len(line) - 1)
        if high > low:
            slope[axis] = (line[high] - line[low]) / ((high - low) * grid.cell_m)
    return slope


def langevin_step_m(
    slope_per_m: Floats, noise: Floats, *, temperature: float, mobility_m2: float, longest_m: float
) -> Floats:
    """Return a step (2,) down a potential with thermal noise.

    d = -eta grad Phi, no longer than the longest + sqrt(2 eta tau) xi        eta mobility, tau temperature
    [m] = [m^2] [1/m] + sqrt([m^2] [1]) [1]

    In a potential k r^2 / 2 the places settle to the variance tau / (k (1 - eta k / 2)) on each axis, tau / k for small
    steps, as long as no drift is capped.

    Args:
        slope_per_m: (2,) gradient of the potential [1/m].
        noise: (2,) standard normal numbers xi.
        temperature: tau; 0 goes straight downhill.
        mobility_m2: eta [m^2].
        longest_m: Longest drift of a step [m].

    Source:
        SniffySquad (arXiv 2411.06121): x <- x - eta grad Phi + sqrt(2 eta tau) xi, drift capped at the maximal speed.
    Held by:
        tests/unit/search/swarms/test_langevin.py (drift, that variance)
    """
    drift_m = -mobility_m2 * np.asarray(slope_per_m, dtype=np.float64)
    length_m = math.hypot(drift_m[0], drift_m[1])
    if length_m > longest_m:
        drift_m *= longest_m / length_m
    return drift_m + math.sqrt(2.0 * mobility_m2 * temperature) * np.asarray(noise)


def swap_probability(tau_i: float, tau_j: float, phi_i: float, phi_j: float, *, attempt: float = 1.0) -> float:
    """Return the probability that two robots swap their temperatures.

    P = a exp(min(0, (1 / tau_i - 1 / tau_j) (Phi_i - Phi_j)))
    [1] = [1]

    It is a when the colder robot stands at the worse place (of higher potential), and less the more it stands better.
    With a = 1 and one potential for all, swapping leaves the joint distribution exp(-Phi_i / tau_i - Phi_j / tau_j) as
    it is (detailed balance).

    Args:
        tau_i: Temperature of one, > 0.
        tau_j: Of the other, > 0.
        phi_i: Potential at the place of the one.
        phi_j: Of the other.
        attempt: a, how often a swap is tried at all.

    Source:
        Replica exchange (Swendsen and Wang 1986); of roles, SniffySquad (arXiv 2411.06121).
    Held by:
        tests/unit/search/swarms/test_langevin.py (limits, detailed balance)
    """
    return attempt * math.exp(min(0.0, (1.0 / tau_i - 1.0 / tau_j) * (phi_i - phi_j)))


def temperature_ladder(n: int, coldest: float, hottest: float) -> tuple[float, ...]:
    """Return n temperatures from the coldest to the hottest, each a constant factor above the last.

    tau_k = tau_0 (tau_1 / tau_0)^(k / (n - 1)); a single robot has their geometric mean

    Source:
        Ours: the paper's ladder is not given.
    """
    if n == 1:
        return (math.sqrt(coldest * hottest),)
    return tuple(coldest * (hottest / coldest) ** (k / (n - 1)) for k in range(n))


def settle_roles(claimed: Mapping[str, int], n_roles: int) -> dict[str, int]:
    """Return a role for each robot, no two the same: what it reported where that is free, else the lowest that is left.

    Args:
        claimed: Which role each robot says it has; names decide in sorted order who keeps one that two claim.
        n_roles: How many there are, at least as many as robots.
    """
    roles: dict[str, int] = {}
    for name in sorted(claimed):
        if 0 <= claimed[name] < n_roles and claimed[name] not in roles.values():
            roles[name] = claimed[name]
    left = iter([role for role in range(n_roles) if role not in roles.values()])
    return {name: roles[name] if name in roles else next(left) for name in sorted(claimed)}


def swap_roles(
    roles: Mapping[str, int],
    potentials: Mapping[str, float],
    fractions: Mapping[str, float],
    ladder: Sequence[float],
    *,
    is_odd: bool,
    attempt: float = 1.0,
) -> dict[str, int]:
    """Return the roles after a round of swaps between robots that are next to each other in temperature.

    In even rounds the coldest may swap with the second, the third with the fourth and so on; in odd rounds the second
    with the third and so on, so that each robot takes part in one swap a round and all roles can come to all robots.

    Args:
        roles: Which rung of the ladder each robot has.
        potentials: The potential at each robot's place.
        fractions: A number uniform in [0, 1) that each robot has drawn and reported; that of the pair's first name
        decides,
            so all who have heard it come to the same.
        ladder: The temperatures, from cold to hot.
        is_odd: Which pairs it is the turn of.
        attempt: a of `swap_probability`.

    Source:
        Alternating neighbours is common in replica exchange; the paper swaps pairs (i, j) without saying which.
    Held by:
        tests/unit/search/swarms/test_langevin.py
    """
    changed = dict(roles)
    by_heat = sorted(roles, key=lambda name: roles[name])
    for cold, hot in zip(by_heat[int(is_odd) :: 2], by_heat[int(is_odd) + 1 :: 2]):
        probability = swap_probability(
            ladder[roles[cold]], ladder[roles[hot]], potentials[cold], potentials[hot], attempt=attempt
        )
        if fractions[min(cold, hot)] < probability:
            changed[cold], changed[hot] = roles[hot], roles[cold]
    return changed
