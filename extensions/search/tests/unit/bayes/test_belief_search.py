import math
from types import SimpleNamespace

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim_search.bayes.belief_search import (
    AlikeFindings,
    BeliefAgent,
    GoalNavigator,
    choose_goal,
    coarsen_belief,
    expected_information_bits,
    mass_around,
)
from gslcosim_search.bayes.puff_tracing import PuffModel, displacements_m, footprint
from gslcosim_search.beliefs import CellGrid, normalised
from gslcosim_search.motion.declaration import Estimate
from gslcosim_search.motion.map_navigation import MapNavigator
from gslcosim_search.random_stream import RandomStream

SETTINGS = {
    "cell_m": 0.5, "max_cells": 5000, "wall_margin_m": 0.5, "clearance_m": 0.3, "step_m": 1.0, "planner": "moth",
    "visit_m": 1.0, "near_m": 2.0, "surge_s": 6.0, "hold_s": 1.5, "explore_hold_s": 0.0, "finding_s": 1.0,
    "gas_threshold_ppm": 0.1, "wind_threshold_m_s": 0.05, "wind_step_s": 1.0, "window_s": 20.0, "wind": "uniform",
    "wind_reach_m": 1.5, "declare_variance_m2": 0.5, "leash_legs": 6, "leash_m": 1.0,
}  # fmt: skip
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
WEST = math.pi  # the wind comes from -x
GRID = CellGrid((1.0, -1.0), 0.5, (6, 4))
ALL = np.ones(GRID.shape, bool)
RNG = np.random.default_rng(1)


class Searcher(BeliefAgent):
    """Believes and has found what a test says; notes what it would learn from."""

    believed: np.ndarray | None = None
    found: Estimate | None = None

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self.findings, self.weights, self.rejected_m = [], [], []

    @property
    def p(self):
        return np.full(self.grid.shape, 1.0 / self.grid.n_cells) if self.believed is None else self.believed

    def update(self, observation, finding, weight):
        self.findings.append(finding)
        self.weights.append(weight)

    def reject(self, place_m):
        self.rejected_m.append(place_m)

    def estimate(self, observation):
        return self.found

    def next_leg(self, observation):
        return self.surge_or_search(observation, None)


def search(**changes):
    return Searcher(briefing(sensors=SENSORS), SimpleNamespace(**{**SETTINGS, **changes}))


def seen(tick, *, ppm=0.0, wind=(0.5, WEST), position_m=(7.0, 5.0, 2.0), notice=None):
    return observation(tick=tick, readings={"nose": ppm, "vane": wind}, position_m=position_m, notice=notice)


def warmed(made, *, ppm=0.0, wind=(0.5, WEST), ticks=31):
    """Let it observe for some seconds; return the last observation."""
    for tick in range(ticks):
        made.observe(seen(tick, ppm=ppm, wind=wind))
    return seen(ticks, ppm=ppm, wind=wind)


def peak(made, place_m):
    """Let it believe that the source is in one cell."""
    made.believed = np.zeros(made.grid.shape)
    made.believed[made.grid.cell_at(place_m)] = 1.0
    return made


def chance_of(made, here):
    model = PuffModel(window_s=20.0, step_s=1.0, initial_sigma_m=0.3, sensed_m2=0.5)
    travelled_m = displacements_m(made.winds, model, here.position_world_m)
    return footprint(model, travelled_m, made.plan_grid.cell_m, made.plan_grid.shape)


def test_soon_after_gas_a_moth_goes_a_step_upwind_and_holds():
    made = search()
    here = warmed(made, ppm=2.0)
    command = made.surge_or_search(here, chance_of(made, here))
    assert command.position_world_m == pytest.approx((6.0, 5.0, 2.0), abs=0.02)
    assert command.hold_s == 1.5


def test_a_traced_place_comes_before_the_step_upwind():
    made = search()
    here = warmed(made, ppm=2.0)
    command = made.surge_or_search(here, None, trace_m=(6.3, 5.4))
    assert command.position_world_m == pytest.approx((6.3, 5.4, 2.0), abs=0.02)


def test_before_any_wind_there_is_no_surge():
    assert search().surge_m(seen(1)) is None


@pytest.mark.parametrize("planner", ["maximum", "information", "moth"])
def test_without_gas_it_goes_towards_where_the_source_is_believed(planner):
    made = search(planner=planner)
    here = warmed(made)
    command = peak(made, (3.25, 5.25)).surge_or_search(here, chance_of(made, here))
    assert command.position_world_m[0] < 6.2
    assert command.hold_s == 0.0


def test_a_place_is_declared_when_the_vehicle_is_there_and_then_left():
    made = search()
    here = warmed(made)
    made.found = Estimate(position_m=(7.3, 5.2), confidence=0.8)
    command = made.decide(here)
    assert command.kind == "declare_source"
    assert command.declaration.position_world_m == pytest.approx((7.3, 5.2, 2.0))
    assert command.declaration.confidence == 0.8
    for tick in (60, 61):
        made.observe(seen(tick))
    assert made.rejected_m == [pytest.approx((7.3, 5.2))]


def test_a_place_far_away_is_flown_to_before_it_is_declared():
    made = search()
    here = warmed(made)
    made.found = Estimate(position_m=(11.0, 5.0), confidence=0.8)
    command = made.decide(here)
    assert command.kind == "waypoint"
    assert command.position_world_m[0] > 7.5
    made.observe(seen(60))
    assert made.rejected_m == []


def test_a_place_that_cannot_be_reached_is_declared_from_where_the_vehicle_came():
    made = search()
    here = warmed(made)
    made.found = Estimate(position_m=(11.0, 5.0), confidence=0.8)
    made.decide(here)
    assert made.decide(seen(60, notice="in an obstacle")).kind == "declare_source"


def test_a_place_that_was_searched_for_long_is_rejected():
    made = search()
    for i in range(6):
        assert made.rejected_m == []
        made.decide(seen(40 + 20 * i))
    made.observe(seen(200))
    assert made.rejected_m == [pytest.approx((7.0, 5.0))]


def test_nothing_is_found_before_the_wind_is_known():
    made = search()
    for tick in range(25):
        made.observe(observation(tick=tick, readings={"nose": 2.0, "vane": (0.5, WEST)}, warming=("vane",)))
    assert made.findings == []
    for tick in range(25, 60):
        made.observe(seen(tick, ppm=2.0))
    assert len(made.findings) >= 2


def test_a_measured_wind_is_kept_by_place():
    made = search(wind="measured")
    for tick in range(31):
        made.observe(seen(tick, wind=(0.5, WEST), position_m=(3.0, 5.0, 2.0)))
    for tick in range(31, 62):
        made.observe(seen(tick, wind=(0.5, -math.pi / 2), position_m=(12.0, 5.0, 2.0)))
    winds_m_s = made.field.winds_m_s()
    assert winds_m_s[made.grid.cell_at((3.0, 5.0))] == pytest.approx([0.5, 0.0], abs=0.1)
    assert winds_m_s[made.grid.cell_at((12.0, 5.0))] == pytest.approx([0.0, 0.5], abs=0.1)


def entropy(q):
    return 0.0 if q in (0.0, 1.0) else -q * math.log2(q) - (1.0 - q) * math.log2(1.0 - q)


def test_information_is_the_mutual_information_of_source_and_finding():
    p, chance = normalised(RNG.uniform(size=GRID.shape)), RNG.uniform(size=(11, 7))
    found = expected_information_bits(p, chance)
    for x in np.ndindex(GRID.shape):
        seen = {s: chance[s[0] - x[0] + 5, s[1] - x[1] + 3] for s in np.ndindex(GRID.shape)}
        q = sum(p[s] * seen[s] for s in seen)
        expected = entropy(q) - sum(p[s] * entropy(seen[s]) for s in seen)
        assert found[x] == pytest.approx(expected, abs=2e-9)


def test_mass_around_a_cell_is_the_sum_of_the_square_about_it():
    p = RNG.uniform(size=(7, 5))
    for reach in (0, 1, 2, 9):
        found = mass_around(p, reach)
        for i, j in np.ndindex(p.shape):
            expected = p[max(0, i - reach) : i + reach + 1, max(0, j - reach) : j + reach + 1].sum()
            assert found[i, j] == pytest.approx(expected)


def test_the_best_goal_is_the_worth_for_the_way():
    worth = np.full(GRID.shape, 0.1)
    worth[5, 3], worth[1, 0] = 1.0, 0.8
    here_m = GRID.centre_m((0, 0))
    assert choose_goal(worth, GRID, ALL, here_m, near_m=math.inf) == pytest.approx(GRID.centre_m((5, 3)))
    assert choose_goal(worth, GRID, ALL, here_m, near_m=1.0) == pytest.approx(GRID.centre_m((1, 0)))
    assert choose_goal(worth, GRID, ALL, here_m, near_m=1.0, least_m=1.0) == pytest.approx(GRID.centre_m((5, 3)))


def test_only_allowed_cells_are_goals_and_near_ones_are_when_there_are_no_others():
    worth, allowed = np.zeros(GRID.shape), np.zeros(GRID.shape, bool)
    worth[5, 3], allowed[2, 2] = 1.0, True
    here_m = GRID.centre_m((2, 2))
    assert choose_goal(worth, GRID, allowed, here_m, near_m=1.0, least_m=0.4) == pytest.approx(here_m)


def test_coarser_cells_hold_the_mass_of_their_block():
    p = normalised(RNG.uniform(size=(7, 5)))
    summed, grid = coarsen_belief(p, CellGrid((0.0, 0.0), 0.2, (7, 5)), least_cell_m=0.5)
    assert grid.shape == (3, 2)
    assert grid.cell_m == pytest.approx(0.6)
    assert summed[0, 0] == pytest.approx(p[:3, :3].sum())
    assert summed[2, 1] == pytest.approx(p[6:, 3:].sum())
    same, _ = coarsen_belief(p, CellGrid((0.0, 0.0), 0.5, (7, 5)), least_cell_m=0.5)
    assert np.array_equal(same, p)


def flights(known_map=None, **options):
    agent_briefing = briefing(known_map=known_map)
    made = MapNavigator(agent_briefing, RandomStream(1), cell_m=0.5, max_cells=5000, clearance_m=0.3, margin_m=0.5)
    return GoalNavigator(made, step_m=1.0, **options)


def test_a_leg_goes_a_step_towards_the_goal_or_to_it():
    goals = flights()
    here = observation(position_m=(7.0, 5.0, 2.0))
    assert goals.leg(here, (10.25, 5.25)).position_world_m[0] == pytest.approx(8.0, abs=0.02)
    near = goals.leg(here, (7.25, 5.25), hold_s=0.5)
    assert near.position_world_m == pytest.approx((7.25, 5.25, 2.0))
    assert near.hold_s == 0.5


def test_a_refused_goal_and_what_is_near_it_are_given_up_until_nothing_is_left():
    goals = flights()
    here = observation(position_m=(7.0, 5.0, 2.0))
    goals.leg(here, (10.25, 5.25))
    assert goals.is_goal((10.25, 5.25))
    goals.note_refusal(here)
    assert goals.is_goal((10.25, 5.25))
    goals.note_refusal(observation(notice="in an obstacle"))
    assert not goals.is_goal((10.25, 5.25))
    assert goals.is_goal((12.25, 5.25))
    assert not goals.is_goal((100.0, 5.0))
    everything = flights(radius_m=100.0)
    everything.leg(here, (10.25, 5.25))
    everything.note_refusal(observation(notice="in an obstacle"))
    assert everything.is_goal((10.25, 5.25))


def test_findings_at_one_place_weigh_less_and_less_and_others_fully():
    alike = AlikeFindings(radius_m=0.5, n_remembered=3)
    assert [alike.weigh((2.0, 3.0, z_m)) for z_m in (1.0, 2.0, 3.0)] == pytest.approx([1.0, 1 / 2, 1 / 3])
    assert alike.weigh((2.6, 3.0, 1.0)) == 1.0
    # One of the three that are remembered was elsewhere.
    assert alike.weigh((2.0, 3.0, 1.0)) == pytest.approx(1 / 3)
    assert [AlikeFindings(radius_m=0.0).weigh((2.0, 3.0)) for _ in range(3)] == [1.0, 1.0, 1.0]


def test_a_vehicle_at_rest_learns_less_from_each_finding():
    made = search(alike_m=0.5)
    warmed(made, ppm=2.0)
    assert made.weights[:3] == pytest.approx([1.0, 1 / 2, 1 / 3])
