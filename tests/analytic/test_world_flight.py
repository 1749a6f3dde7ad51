"""Flight against closed forms, and the accuracy that the vehicles promise."""

import math

import pytest

from gslcosim.base.quantities import GRAVITY_M_S2
from gslcosim.contract.participant import Episode
from gslcosim_services.world.core import WorldCore


def test_speed_while_falling_with_drag(make_room, robot_study):
    """v = v_t tanh(g t/v_t)."""
    body = robot_study.FreeBody(make_room(), height_m=5e4)
    body.run(375)
    terminal_m_s = math.sqrt(2 * 1.535 * GRAVITY_M_S2 / (1.204 * 0.04))
    assert -body.data.qvel[2] == pytest.approx(terminal_m_s * math.tanh(GRAVITY_M_S2 * 1.5 / terminal_m_s), rel=2e-3)


def test_a_body_without_thrust_takes_the_speed_of_the_air(make_room, robot_study):
    """Drag is relative to the moving air: v = U - U/(1 + U t q/m), q = rho A/2."""
    body = robot_study.FreeBody(make_room(wind_m_s=((6.0, 0.0, 0.0),)))
    body.constants[0]["gravity_m_s2"] = 0.0
    body.run(250)
    rate_s = 6.0 * 0.5 * 1.204 * 0.015 / 1.535
    assert body.data.qvel[0] == pytest.approx(6.0 - 6.0 / (1.0 + rate_s * 1.0), rel=2e-3)


def test_a_steady_wind_leaves_no_lasting_error(make_room, make_scenario):
    core = WorldCore(make_scenario({"start_m": (7.0, 5.0, 0.1)}), make_room(wind_m_s=((3.0, -1.0, 0.5),)))
    core.reset(Episode(seed=0))
    for tick in range(200):
        body = core.step(tick, {})["truth/bodies"].bodies[0]
    assert math.dist(body.position_world_m, (7.0, 5.0, 2.0)) < 0.005


def test_it_rights_itself_from_a_steep_tilt(make_room, robot_study):
    body = robot_study.FreeBody(make_room(), height_m=3.0)
    body.data.qpos[3:7] = [math.cos(math.pi / 6), math.sin(math.pi / 6), 0.0, 0.0]
    body.data.qvel[3:6] = [3.0, 0.0, 1.0]
    body.hold_at((7.0, 5.0, 3.0))
    body.run(1000)
    assert math.dist(body.data.qpos[:3], (7.0, 5.0, 3.0)) < 0.1
    assert abs(body.data.qpos[3]) == pytest.approx(1.0, abs=1e-3)
