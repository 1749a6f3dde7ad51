"""Belief shared by several robots: findings with all that weighs them, in an order that all agree on."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.bayes.encounter_model import PlumeAssumption, likelihoods
from gslcosim.search.beliefs import normalised_from_log
from gslcosim.search.grids import CellGrid
from gslcosim.search.information.objectives import Candidates, infotaxis_cost, predict_stops

Array = NDArray[np.float64]


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
    Held by:
        tests/unit/search/swarms/test_shared_belief.py
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
            grid: The cells, in the plane.
            free: (nx, ny) which of them the source may be in.
            dispersal: What is supposed of the plume.
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
        """Return what stops at places would find in a wind; cells within reach would be searched through."""
        places = np.array(places_m, dtype=np.float64).reshape(-1, 2)
        log_mean = self.dispersal.model(wind_m_s, spread_rad).log_mean_hits(places, self._cells_m)
        powers = self.power / (1.0 + self._are_near(places, self._places_m()).sum(axis=1))
        likelihood, weight, log_weight = likelihoods(log_mean, floor=self.floor, power=powers)
        for i, place_m in enumerate(places):
            within = self._within(place_m)
            for table in (likelihood, weight, log_weight):
                table[i][:, within] = 0.0
        return Candidates(
            places_m=places, cells_m=self._cells_m, likelihood=likelihood, weight=weight, log_weight=log_weight
        )

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
        return apart_x**2 + apart_y**2 < self._near_m**2

    def _within(self, place_m: Array) -> NDArray[np.bool_]:
        return ((self._cells_m - place_m) ** 2).sum(axis=1) < self.reach_m**2


def assigned_costs(p: Array, own: Candidates, planned: Sequence[Candidates]) -> Array:
    """Return the expected entropy after each of the own stops (m,), when others make theirs first [bit].

    J = sum_h1 rho_h1 ... sum_hk rho_hk J_infotaxis(p given h1 ... hk)        h outcomes at the stops of the k others

    The others have chosen; this robot chooses what adds most to what they will find. One after the other they so reach
    at least half of what the best joint choice would find (greedy choice of a submodular gain).

    Args:
        p: Belief, flat.
        own: Stops to choose from.
        planned: Of each other robot the one stop that it has chosen.

    Returns:
        Costs; where the others would find the source nothing is left to learn, which counts 0.

    Source:
        Sequential assignment is ours; that greedy choice reaches half: Fisher, Nemhauser, Wolsey 1978 (remembered,
        unverified), for gains of findings that are independent given the source.
    Held by:
        tests/unit/search/swarms/test_shared_belief.py (equals the joint entropy by brute force)
    """
    if not planned:
        return infotaxis_cost(predict_stops(p, own))
    costs = np.zeros(len(own.places_m))
    first, rest = planned[0], planned[1:]
    for likelihood, weight in zip(first.likelihood[0], first.weight[0]):
        chance, left = float(p @ likelihood), p * weight
        if chance > 0.0 and left.any():
            costs += chance * assigned_costs(left / left.sum(), own, rest)
    return costs
