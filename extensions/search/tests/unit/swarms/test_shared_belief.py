import itertools
import math

import numpy as np
import pytest

from gslcosim_search.bayes.encounter_model import PlumeAssumption
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.information.objectives import infotaxis_cost, predict_stops
from gslcosim_search.swarms.shared_belief import SharedBelief, SharedFinding, assigned_costs

GRID = CellGrid((0.0, 0.0), 1.0, (9, 7))
DISPERSAL = PlumeAssumption(
    dimensions=2, hits_at_1m=2.0, diffusivity_m2_s=0.1, lifetime_s=60.0, room_length_m=9.0, detector_m=0.1,
    correlation_s=5.0, stop_s=2.0,
)  # fmt: skip
WIND = (0.4, 0.1)


def belief(free=None, *, power=0.5, near_m=0.5, reach_m=0.0):
    free = np.ones(GRID.shape, bool) if free is None else free
    return SharedBelief(GRID, free, DISPERSAL, floor=0.02, power=power, near_m=near_m, reach_m=reach_m)


def found(finder, number, time_s, place_m, *, hit=False):
    return SharedFinding(
        finder=finder, number=number, time_s=time_s, place_m=place_m, is_hit=hit, wind_m_s=WIND, spread_rad=0.2
    )


FINDINGS = [
    found("ada", 1, 2.0, (7.0, 3.0)),
    found("bob", 1, 2.0, (5.2, 3.4), hit=True),
    found("ada", 2, 4.0, (6.2, 3.6), hit=True),
    found("cyd", 1, 5.0, (6.3, 3.5)),
    found("bob", 2, 6.0, (4.1, 3.3)),
]


def test_without_findings_all_free_cells_are_equally_likely():
    free = np.ones(GRID.shape, bool)
    free[3, :] = False
    p = belief(free).p
    assert p[free] == pytest.approx(1.0 / free.sum())
    assert p[~free] == pytest.approx(0.0)


def test_the_belief_is_the_same_to_the_bit_in_whatever_order_findings_come():
    first = belief()
    for finding in FINDINGS:
        first.add(finding)
    for order in itertools.permutations(FINDINGS):
        other = belief()
        for finding in order:
            other.add(finding)
        assert np.array_equal(other.p, first.p)


def test_a_finding_that_comes_twice_counts_once():
    once = belief()
    assert once.add(FINDINGS[1])
    before = once.p
    assert not once.add(FINDINGS[1])
    assert len(once) == 1
    assert np.array_equal(once.p, before)


def test_a_hit_raises_the_upwind_side_and_clean_air_lowers_it():
    hit, clean = belief(), belief()
    hit.add(found("ada", 1, 2.0, (5.5, 3.5), hit=True))
    clean.add(found("ada", 1, 2.0, (5.5, 3.5)))
    # The wind goes to +x: upwind is the side of small x.
    assert hit.p[:5].sum() > 5.0 / 9.0 > clean.p[:5].sum()


def test_the_second_finding_at_a_place_weighs_half_of_the_first():
    """With all powers as 1, p goes with the likelihood L to the power 1 + 1/2 for two equal findings at one place."""
    one, two = belief(power=1.0), belief(power=1.0)
    one.add(found("ada", 1, 2.0, (5.5, 3.5), hit=True))
    for number, finder in enumerate(("ada", "bob"), start=1):
        two.add(found(finder, number, 2.0 * number, (5.5, 3.5), hit=True))
    expected = one.p**1.5
    assert two.p == pytest.approx(expected / expected.sum())


def test_a_stop_searches_the_cells_within_reach():
    candidates = belief(reach_m=1.2).candidates([(4.5, 3.5)], WIND, 0.2)
    within = (np.hypot(*(GRID.centres_m() - np.array([4.5, 3.5])).T) < 1.2).nonzero()[0]
    assert candidates.likelihood[0][:, within] == pytest.approx(0.0)
    assert candidates.likelihood[0].sum(axis=0).max() == pytest.approx(1.0)


def test_with_no_plans_of_others_it_is_infotaxis():
    known = belief()
    known.add(FINDINGS[1])
    own = known.candidates([(3.0, 3.0), (6.0, 2.0)], WIND, 0.2)
    p = known.p.reshape(-1)
    assert assigned_costs(p, own, []) == pytest.approx(infotaxis_cost(predict_stops(p, own)))


@pytest.mark.parametrize("plans", [[(4.0, 3.0)], [(4.0, 3.0), (2.5, 5.0)]])
def test_the_cost_is_the_entropy_that_all_stops_together_leave(plans):
    """Against a sum over all combinations of outcomes, written out."""
    known = belief(power=1.0)
    own = known.candidates([(6.0, 2.0), (3.0, 4.0)], WIND, 0.2)
    planned = [known.candidates([plan], WIND, 0.2) for plan in plans]
    p = known.p.reshape(-1)
    for i, cost in enumerate(assigned_costs(p, own, planned)):
        expected = 0.0
        for outcomes in itertools.product((0, 1), repeat=len(plans) + 1):
            joint = p * own.likelihood[i][outcomes[-1]]
            for stop, outcome in zip(planned, outcomes):
                joint = joint * stop.likelihood[0][outcome]
            q = joint / joint.sum()
            expected += joint.sum() * -(q * np.log2(q)).sum()
        assert cost == pytest.approx(expected)


def test_where_another_goes_there_is_less_left_to_learn():
    known = belief()
    here, there = (4.0, 3.5), (4.0, 0.8)
    own = known.candidates([here, there], WIND, 0.2)
    p = known.p.reshape(-1)
    alone = assigned_costs(p, own, [])
    taken = assigned_costs(p, own, [known.candidates([here], WIND, 0.2)])
    assert taken.max() < math.log2(GRID.n_cells)
    assert taken[0] - taken[1] > alone[0] - alone[1]
