"""Belief shared by several robots in an order that all agree on, and Langevin motion on it.

Langevin motion goes downhill on the belief's potential with as much noise as a temperature says. A cold robot goes to
the most likely place (it exploits), a hot one wanders (it explores). Where the cold one stands worse than a hotter one,
they swap temperatures: the place keeps its robot, and the robot that stands well becomes cold.

Held by:
    extensions/search/tests/unit/swarms/test_shared_belief.py
"""

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.scalar_kernels import norm2
from gslcosim_search import elementary
from gslcosim_search.bayes.encounter_model import PlumeAssumption, likelihoods
from gslcosim_search.beliefs import CellGrid, normalised_from_log
from gslcosim_search.information.objectives import Candidates, infotaxis_cost, predict_stops

Array = NDArray[np.float64]
Floats = NDArray[np.float64]
LEAST_P = 1e-9


@dataclass(frozen=True, kw_only=True)
class SharedFinding:
    """Finding of one robot at a place: gas or clean air, and the wind there as it knew it then.

    `number` counts the findings of its `finder`; `wind_m_s` is where the air goes, `spread_rad` how far its direction
    spreads.
    """

    finder: str
    number: int
    time_s: float
    place_m: tuple[float, float]
    is_hit: bool
    wind_m_s: tuple[float, float]
    spread_rad: float

    @property
    def key(self) -> tuple[float, str, int]:
        """The place among all findings: by time, then by finder."""
        return self.time_s, self.finder, self.number


# A finding, what it says of each cell, and the sum up to it.
@dataclass
class _Entry:
    finding: SharedFinding
    log_likelihood: Array
    log_p: Array


class SharedBelief:
    """Belief about the source by the findings of all robots: equal to the bit for all who know the same findings.

    ln p = ln p0 + sum_i w_i ln P(finding i given s) + constant        w_i = power / (1 + n_i)
    n_i is how many findings before i were made within `near_m` of it: findings at one place are much alike.

    Findings may come late, twice and in any order: the sum is taken in the order of their keys, and the weights depend
    on that order alone.

    State: the findings in order, and for each the logarithms of its likelihood in all cells and their sum up to it.

    Source:
        Our form of infotaxis for several searchers that share their data (Masson, Bailly-Bechet, Vergassola 2009,
        J. Phys. A 42, 434009; remembered, unverified): likelihoods of all are multiplied.
    Deviation:
        Findings weigh less where others were made, for what a room's wind does there is not independent.
    """

    def __init__(
        self,
        grid: CellGrid,
        free: NDArray[np.bool_],
        dispersal: PlumeAssumption,
        *,
        floor: float,
        power: float,
        near_m: float,
        reach_m: float = 0.0,
    ) -> None:
        """Begin with an even belief over free cells.

        Args:
            free: (nx, ny) which of them the source may be in.
            floor: Least probability of an outcome.
            power: Tempering of the first finding at a place.
            near_m: Findings so close together are at one place [m].
            reach_m: How near to the source a stop finds it [m]; 0 for nowhere.
        """
        self.grid, self.dispersal, self.floor, self.power, self.reach_m = grid, dispersal, floor, power, reach_m
        self._cells_m, self._near_m = grid.centres_m(), near_m
        self._log_prior = np.where(free.reshape(-1), 0.0, -np.inf)
        self._known: list[_Entry] = []
        self._numbers: set[tuple[str, int]] = set()

    def __len__(self) -> int:
        """Return the number of findings it rests on."""
        return len(self._known)

    @property
    def findings(self) -> tuple[SharedFinding, ...]:
        """Findings it rests on, in the order of the keys."""
        return tuple(entry.finding for entry in self._known)

    @property
    def p(self) -> Array:
        """The belief (nx, ny)."""
        log_p = self._known[-1].log_p if self._known else self._log_prior
        return normalised_from_log(log_p).reshape(self.grid.shape)

    def add(self, finding: SharedFinding) -> bool:
        """Take in a finding; return whether it was new."""
        if (finding.finder, finding.number) in self._numbers:
            return False
        self._numbers.add((finding.finder, finding.number))
        model = self.dispersal.model(finding.wind_m_s, finding.spread_rad)
        log_mean = model.log_mean_hits(np.array([finding.place_m]), self._cells_m)
        log_likelihood = likelihoods(log_mean, floor=self.floor)[2][0, int(finding.is_hit)]
        entry = _Entry(finding, log_likelihood, self._log_prior)
        i = bisect_left(self._known, finding.key, key=lambda known: known.finding.key)
        self._known.insert(i, entry)
        self._sum_from(i)
        return True

    def candidates(
        self, places_m: Sequence[tuple[float, float]], wind_m_s: tuple[float, float], spread_rad: float
    ) -> Candidates:
        """Return the possible results of stops at positions in a wind; cells within reach count as searched."""
        places = np.array(places_m, dtype=np.float64).reshape(-1, 2)
        log_mean = self.dispersal.model(wind_m_s, spread_rad).log_mean_hits(places, self._cells_m)
        powers = self.power / (1.0 + self._are_near(places, self._places_m()).sum(axis=1))
        tables = likelihoods(log_mean, floor=self.floor, power=powers)
        return Candidates.within_reach(places, self._cells_m, tables, reach_m=self.reach_m)

    # A late finding moves to its place, and the sums after it are taken again: the same as if it had come in time.
    def _sum_from(self, i: int) -> None:
        places_m = self._places_m()
        for k in range(i, len(self._known)):
            entry = self._known[k]
            before = self._known[k - 1].log_p if k else self._log_prior
            n_near = self._are_near(places_m[k : k + 1], places_m[:k]).sum()
            entry.log_p = before + self.power / (1.0 + n_near) * entry.log_likelihood

    def _places_m(self) -> Array:
        return np.array([entry.finding.place_m for entry in self._known]).reshape(-1, 2)

    def _are_near(self, places_m: Array, others_m: Array) -> NDArray[np.bool_]:
        apart_x = places_m[:, None, 0] - others_m[None, :, 0]
        apart_y = places_m[:, None, 1] - others_m[None, :, 1]
        return apart_x * apart_x + apart_y * apart_y < self._near_m * self._near_m


def assigned_costs(p: Array, own: Candidates, planned: Sequence[Candidates]) -> Array:
    """Return the expected entropy after each of the own stops (m,), when others make theirs first [bit].

    J = sum_h1 rho_h1 ... sum_hk rho_hk J_infotaxis(p given h1 ... hk)        h outcomes at the stops of the k others

    The others have chosen; this robot chooses what adds most to what they will find. One after the other they so reach
    at least half of what the best joint choice would find (greedy choice of a submodular gain).

    Args:
        p: Belief, flat.
        planned: Of each other robot the one stop that it has chosen.

    Returns:
        Costs; where the others would find the source nothing is left to learn, which counts 0.

    Source:
        Sequential assignment is ours; that greedy choice reaches half: Fisher, Nemhauser, Wolsey 1978 (remembered,
        unverified), for gains of findings that are independent given the source.
    Held by:
        extensions/search/tests/unit/swarms/test_shared_belief.py (equals the joint entropy by brute force)
    """
    if not planned:
        return infotaxis_cost(predict_stops(p, own))
    costs = np.zeros(len(own.places_m))
    first, rest = planned[0], planned[1:]
    for likelihood, weight in zip(first.likelihood[0], first.weight[0]):
        chance, left = float((p * likelihood).sum()), p * weight
        if chance > 0.0 and left.any():
            costs += chance * assigned_costs(left / left.sum(), own, rest)
    return costs


def belief_potential(p: Floats) -> Floats:
    """Return the potential of a belief, of the same shape: Phi = -ln max(p, 1e-9).

    Source:
        SniffySquad (arXiv 2411.06121), Phi = -log p. The floor is ours: cells of probability 0 have no slope.
    """
    return -elementary.log_each(np.maximum(p, LEAST_P))


def potential_slope(potential: Floats, grid: CellGrid, point_m: Sequence[float]) -> Floats:
    """Return the gradient of a potential at a point (2,), by central differences over the cells beside it.

    dPhi/dx = (Phi[i + 1, j] - Phi[i - 1, j]) / (2 h), the same in y        h edge of a cell [m]; one-sided at the rim
    [1/m] = [1] / [m]

    Args:
        potential: (nx, ny) potential at the centres of the cells.
        point_m: The place; that of the nearest cell is taken, world frame [m].

    Source:
        SniffySquad (arXiv 2411.06121), central differences; h is not given there.
    Held by:
        extensions/search/tests/unit/swarms/test_shared_belief.py (exact for a plane)
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

    Source:
        SniffySquad (arXiv 2411.06121): x <- x - eta grad Phi + sqrt(2 eta tau) xi, drift capped at the maximal speed.
    Held by:
        extensions/search/tests/unit/swarms/test_shared_belief.py (drift, that variance)
    """
    drift_m = -mobility_m2 * np.asarray(slope_per_m, dtype=np.float64)
    length_m = norm2(drift_m[0], drift_m[1])
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
        phi_j: Of the other.
        attempt: a, how often a swap is tried at all.

    Source:
        Replica exchange (Swendsen and Wang 1986); of roles, SniffySquad (arXiv 2411.06121).
    Held by:
        extensions/search/tests/unit/swarms/test_shared_belief.py (limits, detailed balance)
    """
    return attempt * elementary.exp(min(0.0, (1.0 / tau_i - 1.0 / tau_j) * (phi_i - phi_j)))


def temperature_ladder(n: int, coldest: float, hottest: float) -> tuple[float, ...]:
    """Return n temperatures from the coldest to the hottest, each a constant factor above the last.

    tau_k = tau_0 (tau_1 / tau_0)^(k / (n - 1)); a single robot has their geometric mean

    Source:
        Ours: the paper's ladder is not given.
    """
    if n == 1:
        return (math.sqrt(coldest * hottest),)
    return tuple(coldest * elementary.pow(hottest / coldest, k / (n - 1)) for k in range(n))


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
