"""`hold_rule: fixed`: each waypoint and mission ends with the vehicle's hold, whatever the agent asks for."""

import pytest
from pydantic import ValidationError

from gslcosim.scenario.models.scenario import AgentSpec

HOLD_S, TICKS = 1.2, 12
PLACE_M = (4.0, 3.0, 2.0)


def held_ticks(pilot, command) -> int:
    """Ticks from arrival to the question."""
    pilot.run_until_asked()
    asked = pilot.fly(command)
    assert asked.awaiting_command
    held_from = max(m.tick for m in pilot.log if m.bodies[0].phase == "flying") + 1
    return pilot.tick - held_from


def vehicle(rule):
    return {"hold_s": HOLD_S, "hold_rule": rule}


@pytest.mark.parametrize(
    ("rule", "asked_s", "ticks"),
    [
        ("fixed", 0.0, TICKS),
        ("fixed", None, TICKS),
        ("fixed", 3.0, TICKS),
        (None, 0.0, 0),
        (None, None, TICKS),
        (None, 3.0, 30),
    ],
)
def test_a_waypoint_ends_with_the_vehicles_hold_where_the_rule_says_so(make_pilot, rule, asked_s, ticks):
    command = {"kind": "waypoint", "position_world_m": PLACE_M, "hold_s": asked_s}
    assert held_ticks(make_pilot(vehicle(rule)), command) == ticks


def test_a_mission_holds_at_its_end_and_passes_its_bends(make_pilot):
    bends = [(4.0, 3.0, 2.0), (4.0, 4.0, 2.0)]
    command = {"kind": "mission", "waypoints": [{"position_world_m": place_m} for place_m in bends]}
    assert held_ticks(make_pilot(vehicle("fixed")), command) == TICKS
    assert held_ticks(make_pilot(vehicle(None)), command) == 0


def test_a_velocity_lasts_as_long_as_the_agent_says(asked_pilot):
    pilot = asked_pilot(vehicle("fixed"))
    asked_at = pilot.tick
    pilot.fly({"kind": "velocity", "velocity_world_m_s": (0.2, 0.0, 0.0), "hold_s": 0.5})
    assert pilot.tick == asked_at + 5


@pytest.mark.parametrize("mode", ["lockstep", "free", {"latency": 2}])
def test_it_needs_a_vehicle_that_asks_when_the_hold_is_over(mode):
    values = {
        "name": "one",
        "start": {"python": "sweep"},
        "mode": mode,
        "vehicle": {"start_m": (1.0, 1.0, 0.2), "hold_rule": "fixed"},
        "sensors": [{"model": "pid", "name": "nose"}],
    }
    with pytest.raises(ValidationError, match="hold_rule"):
        AgentSpec.model_validate(values)
    assert AgentSpec.model_validate(values | {"mode": "on_request"}).vehicle.hold_rule == "fixed"
