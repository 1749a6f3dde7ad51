"""What is closed is touched and refused, what is open is flown through; planners know it in the same tick."""

import numpy as np
import pytest

from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.runtime.replay.snapshot import build_state_adapter
from gslcosim_services.world.core import WorldCore

OPENS, CLOSES = "{what: door_opens, at_s: 10, door: gate}", "{what: door_closes, at_s: 20, door: gate}"
STRAIGHT = ("agents[0].vehicle.avoidance=none", "agents[0].vehicle.model=iris")
BEHIND_M = (4.5, 2.0, 1.0)
IN_THE_GATE_M = (3.1, 2.0, 1.0)


class Flight:
    """A world whose doors move when the test says so."""

    def __init__(self, scenario, environment):
        self.core = WorldCore(scenario, environment)
        self.core.reset(Episode(seed=0))
        self.tick = -1

    def step(self, *events, to_m=None):
        self.tick += 1
        inbox = {EVENTS: EventsBeginning(tick=self.tick - 1, beginning=events)} if self.tick else {}
        if to_m is not None:
            fields = {"kind": "waypoint", "position_world_m": to_m}
            inbox["command/beetle"] = Command(tick=self.tick - 1, **fields)
        return self.core.step(self.tick, inbox)["truth/bodies"].bodies[0]

    def until_asked(self, *, at_most=300):
        for _ in range(at_most):
            body = self.step()
            if body.awaiting_command or body.contacts == ("gate",):
                return body
        raise AssertionError("not asked")


@pytest.fixture
def flight(room_with_gate):
    return lambda *events, changes=STRAIGHT: Flight(*room_with_gate(*events, changes=changes))


@pytest.mark.parametrize(("events", "contacts"), [((), ("gate",)), ((0,), ()), ((0, 1), ("gate",))])
def test_who_flies_through_a_door_touches_it_while_it_is_closed(flight, events, contacts):
    world = flight(OPENS, CLOSES)
    world.until_asked()
    for event in events:
        world.step(event)
    world.step(to_m=BEHIND_M)
    body = world.until_asked()
    assert body.contacts == contacts
    assert contacts or body.position_world_m == pytest.approx(BEHIND_M, abs=0.05)


def test_a_reset_closes_what_has_been_opened(flight):
    world = flight(OPENS)
    world.step()
    world.step(0)
    assert not world.core.model.geom("gate").contype[0]
    world.core.reset(Episode(seed=0))
    assert world.core.model.geom("gate").contype[0]


def test_a_place_in_a_closed_door_is_refused_until_it_opens(flight):
    world = flight(OPENS)
    world.until_asked()
    assert "inside gate" in world.step(to_m=IN_THE_GATE_M).rejected_command
    world.until_asked()
    assert world.step(0, to_m=IN_THE_GATE_M).rejected_command is None


def test_a_planner_finds_its_way_through_a_door_in_the_tick_in_which_it_opens(flight):
    world = flight(OPENS, changes=())
    world.until_asked()
    body = world.step(to_m=BEHIND_M)
    assert "a place that can be reached" in body.rejected_command or "moved" in body.rejected_command
    world.until_asked()
    assert world.step(0, to_m=BEHIND_M).rejected_command is None
    body = world.until_asked()
    assert body.position_world_m == pytest.approx(BEHIND_M, abs=0.05)


def test_the_state_of_a_world_says_which_doors_are_closed(flight):
    first, second = flight(OPENS), flight(OPENS)
    keepers = [build_state_adapter(each.core) for each in (first, second)]
    first.until_asked()
    first.step(0)
    keepers[1].restore(keepers[0].state())
    second.tick = first.tick
    for world in (first, second):
        world.step(to_m=BEHIND_M)
    assert [each.until_asked().contacts for each in (first, second)] == [(), ()]
    np.testing.assert_array_equal(first.core.data.qpos, second.core.data.qpos)
