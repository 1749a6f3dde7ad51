"""Every number of every command, out of all reason, given to every vehicle; bad places, starts, and turning over.

New commands and vehicles come in by themselves.
"""

import math

import pytest
from contract_examples import EXAMPLES

from gslcosim.base.errors import ScenarioError
from gslcosim.contract.messages import AGENT_KINDS, Command
from gslcosim.contract.record import validate_fields
from gslcosim.vehicles import list_vehicle_names
from gslcosim_services.world.core import WorldCore
from gslcosim_services.world.path_follower import OVERTURNED_NOTICE

MODELS = list_vehicle_names()
RACK = ("rack", (6.0, 4.0, 0.0), (7.0, 6.0, 6.0))
PLACES = {"a_kilometre_away": (1000.0, 3.0, 2.0), "under_the_floor": (4.0, 4.0, -1.0), "in_a_rack": (6.5, 5.0, 2.0)}
# What neither moves a vehicle nor depends on where it is.
WITHOUT_PLACE = ("hold", "noop", "declare_source")


def commands():
    """One command of each kind at least, with all fields that the golden examples have."""
    found = [example.model_dump() for example in EXAMPLES.values() if isinstance(example, Command)]
    kinds = {fields["kind"] for fields in found}
    return found + [
        Command(tick=0, kind=kind, hold_s=0.5, yaw_rad=0.1).model_dump() for kind in AGENT_KINDS if kind not in kinds
    ]


COMMANDS = [{key: value for key, value in fields.items() if key != "tick"} for fields in commands()]


def leaves(value, path=()):
    """The places of all numbers in nested fields."""
    if isinstance(value, float):
        return [path]
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, (list, tuple)) else ()
    return [leaf for key, inner in items for leaf in leaves(inner, (*path, key))]


def with_leaf(value, path, number):
    if not path:
        return number
    if isinstance(value, dict):
        return {**value, path[0]: with_leaf(value[path[0]], path[1:], number)}
    return tuple(with_leaf(inner, path[1:], number) if i == path[0] else inner for i, inner in enumerate(value))


def test_all_kinds_are_tried():
    assert {fields["kind"] for fields in COMMANDS} >= set(AGENT_KINDS)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("fields", COMMANDS, ids=lambda fields: fields["kind"])
def test_numbers_that_are_not_finite_are_no_commands(fields, number):
    for path in leaves(fields):
        with pytest.raises(ValueError, match=r"expected|[Ii]nput"):
            validate_fields(Command, {"tick": 0, **with_leaf(fields, path, number)})


def is_sound(body):
    """In the room, whole, and in contact with nothing but what it may stand on."""
    x_m, y_m, z_m = body.position_world_m
    is_inside = 0 < x_m < 15 and 0 < y_m < 10 and 0 < z_m < 6
    return is_inside and all(map(math.isfinite, body.velocity_world_m_s)) and not set(body.contacts) - {"floor"}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("avoidance", ["none", "2d"])
@pytest.mark.parametrize("fields", COMMANDS, ids=lambda fields: fields["kind"])
def test_numbers_beyond_all_reason_are_answered_and_harm_nobody(hovering_pilot, model, avoidance, fields):
    pilot = hovering_pilot({"model": model, "avoidance": avoidance}, obstacles=[RACK])
    n_tried = 0
    for path in leaves(fields):
        for number in (1e6, -1e6):
            try:
                validate_fields(Command, {"tick": 0, **with_leaf(fields, path, number)})
            except ValueError:
                continue
            body = pilot.step(agent_0=with_leaf(fields, path, number))
            n_tried += 1
            matters = fields["kind"] not in WITHOUT_PLACE and not (model == "rover" and path[-1] == 2)
            matters = matters and path[0] != "belief"  # which is for the referee
            assert body.rejected_command or not matters, (path, number)
            for _ in range(8):
                assert is_sound(pilot.step()), (path, number, pilot.body())
            pilot.step(agent_0={"kind": "hold"})
            pilot.run(3)
    assert n_tried or fields["kind"] not in ("waypoint", "mission", "velocity", "drive")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("avoidance", ["none", "2d"])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("kind", ["waypoint", "mission"])
def test_bad_places_are_refused_or_moved(hovering_pilot, model, avoidance, place, kind):
    pilot = hovering_pilot({"model": model, "avoidance": avoidance}, obstacles=[RACK])
    x_m, y_m, z_m = PLACES[place]
    one = {"position_world_m": (x_m, y_m, z_m)}
    command = {"kind": kind, **one} if kind == "waypoint" else {"kind": kind, "waypoints": (one,)}
    body = pilot.step(agent_0=command)
    assert "expected" in body.rejected_command
    assert (body.phase == "holding") == (place != "in_a_rack" or avoidance == "none")
    assert ("goes to" in body.rejected_command) == (place == "in_a_rack" and avoidance != "none")
    for _ in range(120):
        assert is_sound(pilot.step())


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("other", MODELS)
def test_vehicles_of_all_kinds_start_apart(make_scenario, make_room, model, other):
    vehicles = [{"model": kind, "start_m": (3.0 + 0.05 * i, 3.0, 0.1)} for i, kind in enumerate((model, other))]
    with pytest.raises(ScenarioError, match=r"agent_1.vehicle.start_m: expected at least .* m from agent_0's vehicle"):
        WorldCore(make_scenario(*vehicles), make_room())


# ---------------------------------------------------------------- upside down


@pytest.mark.parametrize("model", ["iris", "crazyflie"])
def test_who_turns_over_and_falls_says_so_and_is_asked(asked_pilot, model):
    pilot = asked_pilot({"model": model})
    pilot.step(agent_0={"kind": "attitude", "attitude": {"roll_rad": 3.1}, "hold_s": 60.0})
    body = pilot.run_until(lambda body: body.contacts, at_most=100)
    assert body.contacts == ("floor",)
    # Once it lies the rotors stop and the agent is asked, long before its 60 s are over.
    body = pilot.run_until(lambda body: body.awaiting_command, at_most=300)
    assert body.phase == "on_ground"
    assert body.rejected_command == OVERTURNED_NOTICE
    for command in ({"kind": "take_off"}, {"kind": "waypoint", "position_world_m": (4.0, 4.0, 2.0)}):
        assert pilot.step(agent_0=command).rejected_command == OVERTURNED_NOTICE


@pytest.mark.parametrize("model", ["iris", "crazyflie"])
def test_tumbling_over_the_floor_ends_when_the_agent_is_asked(asked_pilot, model):
    pilot = asked_pilot({"model": model})
    pilot.step(agent_0={"kind": "rates", "rates": {"rates_body_rad_s": (20.0, 0.0, 0.0)}, "hold_s": 10.0})
    pilot.run_until(lambda body: body.contacts, at_most=100)
    for _ in range(100):
        assert is_sound(pilot.step())
    assert pilot.run_until(lambda body: body.awaiting_command, at_most=20)


@pytest.mark.parametrize("model", ["iris", "crazyflie"])
def test_who_turns_over_high_enough_can_be_caught(make_pilot, model):
    pilot = make_pilot({"model": model, "search_height_m": 5.0}, mode="lockstep")
    pilot.run(110)
    pilot.step(agent_0={"kind": "rates", "rates": {"rates_body_rad_s": (15.0, 0.0, 0.0), "thrust_n": 0.0}})
    pilot.run_until(lambda body: abs(body.quaternion_wxyz[0]) < 0.5, at_most=10)
    pilot.step(agent_0={"kind": "hold"})
    body = pilot.run(60)
    assert body.contacts == ()
    assert abs(body.quaternion_wxyz[0]) > 0.99
    assert math.hypot(*body.velocity_world_m_s) < 0.1
