"""From keys to commands."""

import pytest
from observations import briefing, observation

from gslcosim_conformance.teleop import KeyControls


def controls(*, at=(3.0, 2.0, 1.0), **fields):
    it = KeyControls(briefing(), **fields)
    it.see(observation(5, position_world_m=at))
    return it


@pytest.mark.parametrize(
    ("key", "place"),
    [("up", (3, 3, 1)), ("w", (3, 3, 1)), ("s", (3, 1, 1)), ("left", (2, 2, 1)), ("d", (4, 2, 1)), ("r", (3, 2, 1.25)),
     ("page_down", (3, 2, 0.75))],
)  # fmt: skip
def test_a_step_goes_from_where_the_vehicle_is(key, place):
    command = controls().press(key)
    assert (command.kind, command.tick, command.position_world_m) == ("waypoint", 5, place)


def test_after_a_refusal_or_a_hold_a_step_begins_where_the_vehicle_is():
    it = controls()
    it.press("d")
    it.see(observation(6, notice="The waypoint is outside the room."))
    assert it.press("d").position_world_m == (4, 2, 1)
    assert it.press("space").kind == "hold"
    assert it.press("w").position_world_m == (3, 3, 1)


def test_from_the_ground_it_rises_to_its_search_height():
    it = KeyControls(briefing(search_height_m=1.5))
    it.see(observation(5, position_world_m=(3.0, 2.0, 0.1), status="on_ground"))
    assert it.press("d").position_world_m == (4, 2, 1.5)


@pytest.mark.parametrize("key", ["x", "q"])
def test_what_cannot_be_taken_back_is_pressed_twice(key):
    it = controls()
    assert it.press(key) is None
    assert "again" in it.note
    it.press("]")
    assert it.press(key) is None
    assert it.press(key) is not None


def test_the_source_is_declared_where_the_vehicle_is():
    it = controls()
    it.press("x")
    assert it.press("x").declaration.position_world_m == (3, 2, 1)


def test_steps_become_shorter_and_longer():
    it = controls()
    it.press("[")
    assert it.press("d").position_world_m[0] == 3.5


def test_turn_by_turn_a_command_is_given_once_for_each_question():
    it = controls(waits_for_questions=True)
    assert it.press("d") is None
    assert it.note == "Wait until you are asked."
    it.see(observation(9, awaiting_command=True))
    assert it.is_asked
    assert it.press("d").tick == 9
    assert not it.is_asked
    assert it.press("d") is None
