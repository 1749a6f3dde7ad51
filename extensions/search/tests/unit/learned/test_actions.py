import math

import pytest
from briefings import briefing, observation

from gslcosim.base.errors import UsageError
from gslcosim.contract.messages import Command
from gslcosim_search.learned.encoding import MARGIN_M, N_HEADINGS, action_kind


def command(kind, action, *, at_m=(7.0, 5.0, 1.0), **settings):
    return action_kind(kind, briefing(), **settings).command(observation(position_m=at_m), action)


def test_a_waypoint_is_an_offset_at_the_search_height():
    assert command("waypoint", [0.5, -1.0], step_m=2.0, hold_s=0.5) == Command(
        tick=40, kind="waypoint", position_world_m=(8.0, 3.0, 2.0), hold_s=0.5
    )
    assert command("waypoint_3d", [0.0, 0.0, 1.0]).position_world_m == (7.0, 5.0, 2.0)


def test_waypoints_keep_off_the_walls():
    assert command("waypoint", [1.0, 1.0], step_m=99.0).position_world_m == (15.0 - MARGIN_M, 10.0 - MARGIN_M, 2.0)


def test_headings_go_round_and_the_last_choice_holds():
    ends_m = [command("heading", choice).position_world_m for choice in range(N_HEADINGS)]
    bearings = [math.atan2(y_m - 5.0, x_m - 7.0) % (2 * math.pi) for x_m, y_m, _ in ends_m]
    assert bearings == pytest.approx([i * math.pi / 4 for i in range(N_HEADINGS)], abs=1e-9)
    assert command("heading", N_HEADINGS).kind == "hold"


def test_velocities_and_drives_are_scaled():
    assert command("velocity", [1.0, -0.5], speed_m_s=0.8).velocity_world_m_s == (0.8, -0.4, 0.0)
    assert command("velocity_3d", [0.0, 0.0, 1.0]).velocity_world_m_s == (0.0, 0.0, 1.0)
    drive = command("drive", [1.0, -0.5], speed_m_s=0.3).drive
    assert (drive.speed_m_s, drive.yaw_rate_rad_s) == (0.3, -0.5)


def test_another_kind_is_refused():
    with pytest.raises(UsageError, match=r"action: expected one of waypoint, waypoint_3d, heading, .*, was 'jump'"):
        action_kind("jump", briefing())
