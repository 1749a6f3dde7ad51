"""A door is a box that is there or not: cells, air and situations follow it."""

from dataclasses import replace

import numpy as np
import pytest

from gslcosim.base.errors import ModelError
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import AT_START, OWN_WIND, Cell, EnvironmentVariant
from gslcosim.environment.variants import (
    DynamicEnvironment,
    fill_still_air,
    find_variants,
    scenario_in_variant,
)
from gslcosim.scenario import load_scenario

OPENS, CLOSES = "{what: door_opens, at_s: 10, door: gate}", "{what: door_closes, at_s: 20, door: gate}"
TURNS = "{what: wind_changes, at_s: 15, inlet_velocity_m_s: [-0.2, 0, 0]}"
ONCE_NEAR = "{what: door_opens, door: gate, when: {agent: beetle, within_m: 1, of_m: [2, 2, 1]}}"
IN_THE_GATE = (12, 8, 4)
BEHIND_IT = (20, 8, 4)


def scenario_with(*events):
    return load_scenario("event_door", overrides=[f"events=[{', '.join(events)}]"]).scenario


def room_at_start(scenario):
    return build_geometry(scenario.environment, scenario.wind)


def begins(*places):
    return {EVENTS: EventsBeginning(tick=0, beginning=places)}


def test_a_closed_door_is_solid_and_an_open_one_is_not_there():
    scenario = scenario_with(OPENS)
    closed, opened = (room_at_start(scenario_in_variant(scenario, each)) for each in find_variants(scenario))
    assert (closed.occupancy[IN_THE_GATE], opened.occupancy[IN_THE_GATE]) == (Cell.SOLID, Cell.FREE)
    assert {box.name for box in closed.boxes} - {box.name for box in opened.boxes} == {"gate"}
    assert int((closed.occupancy != opened.occupancy).sum()) == 1 * 6 * 8


def test_a_room_with_all_doors_open_is_that_without_doors():
    scenario = scenario_with(OPENS)
    opened = room_at_start(scenario_in_variant(scenario, EnvironmentVariant()))
    without = scenario.environment.model_copy(update={"doors": ()})
    plain = build_geometry(without, scenario.wind)
    np.testing.assert_array_equal(opened.occupancy, plain.occupancy)
    assert opened.boxes == plain.boxes


def test_air_that_a_door_cuts_off_stays_air_but_has_no_wind():
    layout = {"environment.layout.openings=[]", "environment.layout.inlet={min_m: [0.5, 0, 1], max_m: [1.5, 0, 2]}"}
    scenario = load_scenario("event_door", overrides=[*sorted(layout), "wind.inlet_velocity_m_s=[0, 0.4, 0]"]).scenario
    room = room_at_start(scenario)
    assert room.occupancy[BEHIND_IT] == Cell.FREE
    assert fill_still_air(room).occupancy[BEHIND_IT] == Cell.SOLID
    assert fill_still_air(room).occupancy[4, 8, 4] == Cell.FREE


def test_events_at_times_follow_each_other():
    closed, opened = ("gate",), ()
    assert find_variants(scenario_with(CLOSES, OPENS, TURNS)) == [
        EnvironmentVariant(closed), EnvironmentVariant(opened), EnvironmentVariant(opened, 2),
        EnvironmentVariant(closed, 2),
    ]  # fmt: skip
    assert find_variants(scenario_with()) == [EnvironmentVariant(closed)]


def test_with_conditions_any_order_is_possible():
    found = find_variants(scenario_with(ONCE_NEAR, TURNS))
    assert found[0] == EnvironmentVariant(("gate",))
    assert set(found) == {EnvironmentVariant(doors, wind) for doors in (("gate",), ()) for wind in (OWN_WIND, 1)}


def test_a_room_in_time_follows_events_and_forgets_them(room_with_gate):
    scenario, environment = room_with_gate(OPENS, TURNS, CLOSES)
    room = DynamicEnvironment(environment, scenario)
    assert room.now is environment
    assert room.obey(begins(0))
    assert room.now is environment.later_rooms[EnvironmentVariant(())]
    assert not room.obey(begins(1)), "no door has moved"
    assert room.now is environment.later_rooms[EnvironmentVariant((), 1)]
    assert not room.obey(begins())
    assert room.obey(begins(2))
    assert room.variant == EnvironmentVariant(("gate",), 1)
    room.reset()
    assert room.now is environment


def test_a_door_that_comes_back_finds_the_room_of_the_start(room_with_gate):
    scenario, environment = room_with_gate(OPENS, CLOSES)
    room = DynamicEnvironment(environment, scenario)
    room.obey(begins(0))
    room.obey(begins(1))
    assert room.now is environment
    assert list(environment.by_doors()) == [AT_START, ()]


def test_a_room_that_was_not_made_is_reported(room_with_gate):
    scenario, environment = room_with_gate(OPENS)
    with pytest.raises(ModelError, match="expected the room that events bring with no door closed, found none"):
        DynamicEnvironment(replace(environment, later_rooms={}), scenario)
