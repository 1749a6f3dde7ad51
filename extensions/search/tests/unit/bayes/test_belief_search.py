"""What searches with a belief share: surges, goals, declarations at the place, and places that are left."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim_search.bayes.belief_search import BeliefAgent
from gslcosim_search.bayes.puff_tracing import PuffModel, displacements_m, footprint
from gslcosim_search.motion.declaration import Estimate

SETTINGS = {
    "cell_m": 0.5, "max_cells": 5000, "wall_margin_m": 0.5, "clearance_m": 0.3, "step_m": 1.0, "planner": "moth",
    "visit_m": 1.0, "near_m": 2.0, "surge_s": 6.0, "hold_s": 1.5, "explore_hold_s": 0.0, "finding_s": 1.0,
    "gas_threshold_ppm": 0.1, "wind_threshold_m_s": 0.05, "wind_step_s": 1.0, "window_s": 20.0, "wind": "uniform",
    "wind_reach_m": 1.5, "declare_variance_m2": 0.5, "leash_legs": 6, "leash_m": 1.0,
}  # fmt: skip
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
WEST = math.pi  # the wind comes from -x


class Searcher(BeliefAgent):
    """Believes and has found what a test says; notes what it would learn from."""

    believed: np.ndarray | None = None
    found: Estimate | None = None

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self.findings, self.rejected_m = [], []

    @property
    def p(self):
        return np.full(self.grid.shape, 1.0 / self.grid.n_cells) if self.believed is None else self.believed

    def update(self, observation, finding):
        self.findings.append(finding)

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


def test_in_calm_air_a_surge_follows_the_last_wind():
    made = search()
    warmed(made, ppm=2.0)
    assert made.upwind_rad() == pytest.approx(math.pi, abs=1e-6)
    for tick in range(31, 80):
        made.observe(seen(tick, ppm=2.0, wind=(0.0, 0.3)))
    assert abs(made.upwind_rad()) == pytest.approx(math.pi, abs=1e-6)
    assert made.recent_wind_m_s() == pytest.approx((0.0, 0.0))


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


def test_a_belief_that_has_drawn_together_is_an_estimate():
    made = search()
    assert BeliefAgent.estimate(made, seen(40)) is None
    assert BeliefAgent.estimate(peak(made, (3.25, 5.25)), seen(40)).position_m == pytest.approx((3.25, 5.25))


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
