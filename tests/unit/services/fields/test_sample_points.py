"""Beams: how far they reach, and the gas along them."""

import math

import numpy as np
import pytest
from built_messages import build_body, build_poses
from built_scenarios import NOSE

from gslcosim.contract import keys
from gslcosim.contract.participant import Episode
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.sample_points import Beams, distance_to_wall_m

YAW_90 = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


@pytest.fixture
def scenario_of(make_scenario):
    """Build a scenario whose agent has a laser half a metre ahead of it, looking ahead, and a nose."""

    def build(*, warm_up_s=10.0, **laser):
        gas = {"sources": [{"position_m": (5.0, 5.0, 2.0)}], "warm_up_s": warm_up_s}
        laser = {"model": "tdlas", "name": "laser", "mount_m": (0.5, 0.0, 0.0), **laser}
        return make_scenario(sensors=[laser, NOSE], gas=gas)

    return build


def poses(position_m=(6.0, 5.3, 2.0), quaternion=(1.0, 0.0, 0.0, 0.0), agent="agent_0"):
    return build_poses(0, build_body(agent, position_m, quaternion_wxyz=quaternion))


def test_the_way_to_a_wall_is_that_of_small_steps():
    rng = np.random.default_rng(1)
    occupancy = (rng.random((7, 5, 9)) < 0.1).astype(np.uint8)
    origin_m, cell_m, tiny_m = (-1.0, 2.0, 0.5), 0.4, 1e-3
    for _ in range(200):
        start = np.array(origin_m) + rng.random(3) * np.multiply(occupancy.shape, cell_m)
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        distance_m = 0.0
        while True:
            cell = np.floor((start + distance_m * direction - origin_m) / cell_m).astype(int)
            is_inside = ((cell >= 0) & (cell < occupancy.shape)).all()
            if not is_inside or occupancy[tuple(cell)]:
                break
            distance_m += tiny_m
        found = distance_to_wall_m(occupancy, origin_m, cell_m, *start.tolist(), *direction.tolist())
        assert abs(found - distance_m) <= 2 * tiny_m


def test_a_beam_along_an_axis_ends_at_the_wall():
    occupancy = np.zeros((10, 4, 4), np.uint8)
    occupancy[8] = 1
    beam = (0.3, 1.0, 1.0, 1.0, 0.0, 0.0)
    assert distance_to_wall_m(occupancy, (0.0, 0.0, 0.0), 0.5, *beam) == pytest.approx(3.7)
    assert distance_to_wall_m(occupancy, (0.0, 0.0, 0.0), 0.5, 4.1, *beam[1:]) == 0.0
    assert distance_to_wall_m(occupancy, (0.0, 0.0, 0.0), 0.5, -1.0, *beam[1:]) == 0.0


def test_a_beam_turns_with_its_vehicle_and_starts_at_its_mount(scenario_of, make_room):
    beams = Beams(scenario_of(), make_room())
    length_m, points = beams.points_of(poses(quaternion=YAW_90))["agent_0", "laser"]
    assert length_m == pytest.approx(10.0 - 5.8)
    np.testing.assert_allclose(points[:, [0, 2]], [(6.0, 2.0)] * len(points), atol=1e-12)
    assert points[:, 1].mean() == pytest.approx((10.0 + 5.8) / 2)
    assert np.diff(points[:, 1]).max() <= 0.1 + 1e-12
    assert ("agent_0", "nose") not in beams.points_of(poses())


def test_beyond_its_range_nothing_comes_back(scenario_of, make_room):
    beams = Beams(scenario_of(max_range_m=3.0), make_room())
    length_m, points = beams.points_of(poses())["agent_0", "laser"]
    assert (length_m, len(points)) == (0.0, 0)


def test_the_sample_of_a_beam_is_the_mean_along_it(scenario_of, make_room):
    core = FieldsCore(scenario_of(), make_room(wind_m_s=((0.3, 0.0, 0.0),)))
    core.reset(Episode(seed=3))
    laser, nose = core.step(0, {keys.BODIES: poses((5.1, 5.0, 2.0))})[keys.SAMPLES].samples
    assert laser.beam_m == pytest.approx(15.0 - 5.6)
    fine = 5.6 + (np.arange(2000) + 0.5) * laser.beam_m / 2000
    points = np.stack([fine, np.full(2000, 5.0), np.full(2000, 2.0)], axis=1)
    expected = core.gas.mixing_ratio_ppm_at(points)[:, 0].mean()
    assert laser.gases[0].mixing_ratio_ppm == pytest.approx(expected, rel=1e-3)
    assert expected > 0.1
    assert nose.beam_m is None
