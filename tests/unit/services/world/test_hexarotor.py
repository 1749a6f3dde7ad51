"""A vehicle with six rotors flies like one with four."""

import math

import pytest

from gslcosim.contract.participant import Episode
from gslcosim_services.world.core import WorldCore

PLACE_M = (7.0, 5.0, 2.0)


@pytest.mark.parametrize("model", ["iris", "hexarotor"])
def test_it_rises_and_hovers_in_wind(make_room, make_scenario, model):
    core = WorldCore(
        make_scenario({"model": model, "start_m": (7.0, 5.0, 0.1)}), make_room(wind_m_s=((1.0, -0.5, 0.2),))
    )
    core.reset(Episode(seed=0))
    bodies = [core.step(tick, {})["truth/bodies"].bodies[0] for tick in range(200)]
    assert max(math.dist(body.position_world_m, PLACE_M) for body in bodies[150:]) < 0.001


@pytest.mark.parametrize("model", ["iris", "hexarotor"])
def test_it_keeps_to_its_path_while_it_turns(make_pilot, model):
    pilot = make_pilot({"model": model})
    pilot.run_until_asked()
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (8.0, 6.0, 3.0), "yaw_rad": 2.0})
    pilot.run(150)
    w, _, _, z = pilot.body().quaternion_wxyz
    assert 2 * math.atan2(z, w) == pytest.approx(2.0, abs=0.01)
    assert max(body.bodies[0].tracking_error_m or 0.0 for body in pilot.log) < 0.05


def test_its_rotors_can_be_commanded(make_pilot):
    """Thrust may be that of six rotors at full speed, and no more."""
    pilot = make_pilot({"model": "hexarotor"})
    pilot.run_until_asked()
    most_n = 6 * 8.54858e-06 * 838.0**2
    level = {"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": 0.0, "climb_m_s": 0.0}
    body = pilot.step(agent_0={"kind": "attitude", "attitude": {**level, "thrust_n": most_n + 0.1}})
    assert body.rejected_command is not None
    body = pilot.step(agent_0={"kind": "attitude", "attitude": {**level, "thrust_n": most_n - 0.1}})
    assert body.rejected_command is None
