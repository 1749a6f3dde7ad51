from briefings import briefing, observation

from gslcosim.agent_kit.commands import LegCommander


def test_a_leg_is_a_waypoint_at_the_height_of_the_search():
    command = LegCommander(briefing()).leg(observation(), (3.0, 4.0))
    assert (command.kind, command.position_world_m, command.hold_s) == ("waypoint", (3.0, 4.0, 2.0), None)
    assert LegCommander(briefing()).leg(observation(), (3.0, 4.0, 1.5)).position_world_m == (3.0, 4.0, 1.5)


def test_a_hold_of_its_own_counts():
    assert LegCommander(briefing(), hold_s=0.1).leg(observation(), (3.0, 4.0)).hold_s == 0.1


def test_a_leg_with_a_duration_holds_as_long_as_one_without():
    for hold_s, expected_s in ((None, 2.0), (0.1, 0.1)):
        command = LegCommander(briefing(), hold_s=hold_s, leg_s=3.0).leg(observation(), (3.0, 4.0))
        (place,) = command.waypoints
        assert (place.position_world_m, place.after_s, place.hold_s) == ((3.0, 4.0, 2.0), 3.0, expected_s)
