"""A vehicle with six rotors flies like one with four."""

import math

from gslcosim.contract.participant import Episode
from gslcosim_services.world.core import WorldCore

PLACE_M = (7.0, 5.0, 2.0)


def test_it_rises_and_hovers_in_wind(make_room, make_scenario):
    core = WorldCore(
        make_scenario({"model": "hexarotor", "start_m": (7.0, 5.0, 0.1)}), make_room(wind_m_s=((1.0, -0.5, 0.2),))
    )
    core.reset(Episode(seed=0))
    bodies = [core.step(tick, {})["truth/bodies"].bodies[0] for tick in range(200)]
    assert max(math.dist(body.position_world_m, PLACE_M) for body in bodies[150:]) < 0.001


def test_its_rotors_can_be_commanded(asked_pilot):
    pilot = asked_pilot({"model": "hexarotor"})
    most_n = 6 * 8.54858e-06 * 838.0**2
    level = {"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": 0.0, "climb_m_s": 0.0}
    body = pilot.step(agent_0={"kind": "attitude", "attitude": {**level, "thrust_n": most_n + 0.1}})
    assert body.rejected_command is not None
    body = pilot.step(agent_0={"kind": "attitude", "attitude": {**level, "thrust_n": most_n - 0.1}})
    assert body.rejected_command is None
