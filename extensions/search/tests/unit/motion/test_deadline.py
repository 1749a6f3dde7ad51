"""The declaration at the time limit: what a belief says, where gas was met and the mission asks."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from briefings import briefing, observation, task_of

from gslcosim.scenario.models.success import DeclarationSuccess, SourceSuccess
from gslcosim_search.beliefs import CellGrid, normalised
from gslcosim_search.motion.deadline import DeadlineRule

GRID = CellGrid((0.0, 0.0), 0.5, (30, 20))
EVEN = np.full(GRID.shape, 1.0 / GRID.n_cells)
PID = (("pid", "nose"), ("anemometer", "vane"))
MOX = (("tgs2600", "nose"), ("anemometer", "vane"))


def belief_at(place_m, share):
    """A share of the belief in one cell, the rest spread evenly."""
    p = (1.0 - share) * EVEN
    p[GRID.nearest_cell(place_m)] += share
    return normalised(p)


def rule(sensors=PID, success=None, deadline="by_mission"):
    task = task_of(success or DeclarationSuccess())
    return DeadlineRule.for_mission(briefing(sensors=sensors, task=task), SimpleNamespace(deadline=deadline))


def met(values, sensors=PID):
    """The rule after these readings, one in a second."""
    one = rule(sensors)
    for i, value in enumerate(values):
        one.add(observation(tick=10 * i, readings={"nose": value, "vane": (0.5, math.pi)}))
    return one


def test_late_in_the_run_the_place_that_holds_most_is_declared_with_what_it_holds():
    one, p = met([0.0, 2.0, 0.0]), belief_at((4.2, 6.2), 0.4)
    assert one.estimate(269.0, p, GRID) is None
    found = one.estimate(270.0, p, GRID)
    assert math.dist(found.position_m, (4.25, 6.25)) < 0.3
    assert 0.4 < found.confidence < 0.45


def test_a_belief_that_knows_no_place_stays_silent():
    one = met([2.0])
    assert one.estimate(299.0, EVEN, GRID) is None
    assert one.estimate(299.0, belief_at((4.2, 6.2), 0.05), GRID) is None


@pytest.mark.parametrize(
    ("sensors", "values"),
    [
        (PID, [0.0, 0.3, 0.1, 0.4]),
        (MOX, [50_000.0] * 20),
        # A sensor that drifts by a tenth.
        (MOX, list(np.linspace(50_000.0, 45_000.0, 300))),
    ],
)
def test_without_gas_nothing_is_declared_however_sure_the_belief(sensors, values):
    assert met(values, sensors).estimate(299.0, belief_at((4.2, 6.2), 0.99), GRID) is None


def test_a_mox_sensor_that_falls_by_half_has_met_gas():
    values = [50_000.0] * 5 + [45_000.0, 40_000.0, 35_000.0, 30_000.0, 25_000.0]
    assert met(values, MOX).estimate(299.0, belief_at((4.2, 6.2), 0.5), GRID) is not None


def test_the_rule_holds_where_the_mission_asks_and_can_be_switched_off():
    assert rule() is not None
    assert rule(success=SourceSuccess()) is None
    assert rule(deadline="never") is None


def test_the_ball_is_as_wide_as_success():
    place_m = (4.2, 6.2)
    p = 0.5 * belief_at(place_m, 0.08) + 0.5 * belief_at((place_m[0] + 2.0, place_m[1]), 0.08)
    narrow, wide = rule(), rule(success=DeclarationSuccess(within_m=3.0))
    for one in (narrow, wide):
        one.add(observation(readings={"nose": 2.0, "vane": (0.5, math.pi)}))
    assert narrow.estimate(299.0, p, GRID) is None
    assert wide.estimate(299.0, p, GRID) is not None
