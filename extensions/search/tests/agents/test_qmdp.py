import math

import numpy as np
import pytest
from briefings import briefing, observation, open_map

from gslcosim_agents.qmdp.agent import TABLE, Qmdp
from gslcosim_agents.qmdp.agent import PlumeTable as Table
from gslcosim_search.information.pomdp import MOVES, offsets_m

PID = (("pid", "nose"), ("anemometer", "vane"))
HERE_M = (7.0, 5.0, 2.0)
UPWIND_RAD = 2.5


def agent(**changes) -> Qmdp:
    return Qmdp(briefing(**{"sensors": PID, **changes}))


def seen(ppm=0.0, wind=(0.5, UPWIND_RAD), position_m=HERE_M, **more):
    return observation(position_m=position_m, readings={"nose": ppm, "vane": wind}, **more)


def step_of(command, from_m=HERE_M):
    return np.subtract(command.position_world_m, from_m)[:2]


@pytest.mark.parametrize("policy", ["qmdp", "perseus"])
def test_moves_are_a_metre_along_the_wind_or_across_it(policy):
    flown = agent(parameters={"policy": policy})
    step_m = step_of(flown.decide(seen(1.0)))
    c, s = math.cos(UPWIND_RAD + math.pi), math.sin(UPWIND_RAD + math.pi)
    along_across = (c * step_m[0] + s * step_m[1], c * step_m[1] - s * step_m[0])
    assert any(along_across == pytest.approx(move, abs=2e-3) for move in MOVES)


def test_a_sure_source_is_flown_towards_by_qmdp():
    flown = agent(parameters={"policy": "qmdp", "declares": False})
    source = int(np.argmin(np.hypot(*(flown.places_m - (2.0, 8.5)).T)))
    flown.belief = np.zeros(flown.grid.n_cells)
    flown.belief[source] = 1.0
    after_m = np.add(HERE_M[:2], step_of(flown.decide(seen())))
    assert math.dist(after_m, flown.places_m[source]) < math.dist(HERE_M[:2], flown.places_m[source])


def test_a_move_that_was_refused_is_not_tried_again_from_there():
    flown = agent(parameters={"stuck_visits": 0})
    commands = [flown.decide(seen(tick=tick, notice="in an obstacle" if tick else None)) for tick in range(4)]
    assert len({tuple(step_of(command)) for command in commands}) == 4


def test_circles_are_left_straight_on_after_the_third_visit():
    flown = agent(parameters={"stuck_visits": 3, "escape_legs": 2})
    steps = [step_of(flown.decide(seen(tick=tick))) for tick in range(5)]
    assert steps[3] == pytest.approx(steps[4])
    headings = [math.atan2(y, x) - UPWIND_RAD for x, y in steps]
    is_along_the_wind = [abs(math.sin(2.0 * heading)) < 0.01 for heading in headings]
    assert is_along_the_wind == [True, True, True, False, False]


def test_it_declares_once_when_its_belief_has_gathered_and_flies_on():
    flown = agent()
    near = np.hypot(*(flown.places_m - (3.0, 4.0)).T) < 0.6
    flown.belief = near / near.sum()
    first, second = flown.decide(seen()), flown.decide(seen(tick=80))
    assert first.kind == "declare_source"
    assert math.dist(first.declaration.position_world_m, (3.0, 4.0, 2.0)) < 0.5
    assert first.declaration.confidence > 0.9
    assert second.kind == "waypoint"


def test_solid_cells_of_a_granted_map_are_never_believed_in():
    flown = agent(known_map=open_map(walls=((3.0, 2.0, 6.0, 4.0),)))
    x_m, y_m = flown.places_m.T
    inside = (x_m > 3.0) & (x_m < 6.0) & (y_m > 2.0) & (y_m < 4.0)
    assert not flown.belief[inside].any()
    assert flown.belief.sum() == pytest.approx(1.0)
    flown.decide(seen(4.0))
    assert not flown.belief[inside].any()


def test_without_any_wind_gas_speaks_for_all_directions_alike():
    flown = agent(size_m=(14.0, 10.0, 8.0))
    flown.decide(seen(4.0, wind=(0.0, 1.0)))
    belief = flown.belief.reshape(flown.grid.shape)
    assert belief == pytest.approx(belief[::-1], rel=0.2)
    assert belief == pytest.approx(belief[:, ::-1], rel=0.2)


def test_it_flies_while_its_sensors_warm_up_and_learns_nothing():
    flown = agent()
    before = flown.belief.copy()
    assert flown.decide(seen(9.0, warming=("nose", "vane"))).kind == "waypoint"
    assert flown.belief == pytest.approx(before)


def test_a_mox_sensor_is_read_by_its_estimate():
    by_estimate = Qmdp(briefing())
    by_estimate.decide(
        observation(position_m=HERE_M, readings={"nose": 5e4, "nose_ppm": 4.0, "vane": (0.5, UPWIND_RAD)})
    )
    by_pid = agent()
    by_pid.decide(seen(4.0))
    assert by_estimate.belief == pytest.approx(by_pid.belief)


def test_it_finds_a_source_whose_gas_is_as_it_was_learned():
    table, rng = Table.load(TABLE), np.random.default_rng(0)
    source_m, position_m = np.array([[2.5, 7.0]]), (12.0, 3.0, 2.0)
    flown = agent(seed=0, parameters={"power": 1.0, "policy": "perseus"})
    for tick in range(40, 40 * 150, 40):
        here = offsets_m(source_m, position_m[:2], UPWIND_RAD + math.pi)
        chances = np.array([table.likelihood(k, here)[0] for k in range(3)])
        ppm = float(np.array([0.0, 1.0, 5.0])[rng.choice(3, p=chances / chances.sum())])
        command = flown.decide(seen(ppm, position_m=position_m, tick=tick))
        position_m = command.position_world_m or position_m
        if math.dist(position_m[:2], source_m[0]) < 1.0:
            return
    pytest.fail("no source after 150 moves")
