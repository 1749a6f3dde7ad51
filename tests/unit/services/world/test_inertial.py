"""What an IMU would feel, as the world tells it."""

import pytest
from built_scenarios import NOSE

from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim_services.world.core import WorldCore

G = 9.81


def ticks(make_scenario, room, n, has_imu=True, **commands):
    sensors = [{"model": "imu", "name": "imu"}] if has_imu else [NOSE]
    core = WorldCore(make_scenario({"start_m": (5.0, 5.0, 2.0)}, sensors=sensors), room)
    core.reset(Episode(seed=0))
    return [core.step(tick, commands.get(f"t{tick}", {}))["truth/bodies"].bodies[0] for tick in range(n)]


def test_only_a_vehicle_with_an_imu_is_measured(make_room, make_scenario):
    assert ticks(make_scenario, make_room(), 2, has_imu=False)[1].inertial_body is None


def test_hovering_feels_its_weight_from_the_first_tick_on(make_room, make_scenario):
    for body in ticks(make_scenario, make_room(), 3):
        rows = body.inertial_body.to_array()
        assert rows.shape == (25, 9)
        assert rows[:, :3].mean(axis=0) == pytest.approx((0.0, 0.0, G), abs=0.05)


def test_felt_forces_add_up_to_the_change_of_velocity(make_room, make_scenario):
    up = Command(tick=0, kind="waypoint", position_world_m=(5.0, 5.0, 4.0))
    first, *rest = ticks(make_scenario, make_room(), 8, t1={"command/agent_0": up})
    for body in rest:
        gained_m_s = body.velocity_world_m_s[2] - first.velocity_world_m_s[2]
        felt_m_s2 = body.inertial_body.to_array()[:, 2] - G
        assert gained_m_s == pytest.approx(felt_m_s2.sum() * 0.004, abs=1e-6)
        first = body
    assert first.velocity_world_m_s[2] > 0.1
