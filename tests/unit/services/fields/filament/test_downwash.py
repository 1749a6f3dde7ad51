"""Rotors over gas."""

import math

import numpy as np
import pytest
from built_messages import build_body, build_poses

from gslcosim.contract import keys
from gslcosim.contract.participant import Episode
from gslcosim.vehicles import get_vehicle, list_vehicle_names
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.filament.downwash import (
    DECAY,
    ORIGIN,
    WIDENING,
    Downwash,
    blow_filaments_inplace,
    jet_speed_m_s,
    outflow_m_s,
)

OCCUPANCY = np.zeros((20, 20, 40), np.uint8)


def poses(tick, *, phase="holding"):
    return build_poses(tick, build_body("agent_0", (5.0, 5.0, 3.0), phase=phase))


@pytest.fixture
def scenario_of(make_scenario):
    def build(*, vehicle="iris", **gas):
        gas = {"sources": [{"position_m": (5.0, 5.0, 2.0)}], "warm_up_s": 5.0, **gas}
        return make_scenario({"model": vehicle}, gas=gas)

    return build


@pytest.mark.parametrize("name", list_vehicle_names())
def test_each_rotor_carries_its_share_of_the_weight(name):
    """Thrust of a disc is 2 rho A v^2."""
    vehicle = get_vehicle(name)
    if vehicle.rotors is None:
        assert outflow_m_s(vehicle) == 0.0
        return
    thrust_n = 2.0 * 1.204 * math.pi * vehicle.rotors.rotor_radius_m**2 * outflow_m_s(vehicle) ** 2
    assert vehicle.rotors.n_rotors * thrust_n == pytest.approx(vehicle.body.mass_kg * 9.81)


def test_the_jet_slows_down_and_widens_with_the_distance():
    assert jet_speed_m_s(4.0, 0.0, 5.0) == pytest.approx(5.0 * DECAY / (4.0 - ORIGIN))
    half_width = WIDENING * (4.0 - ORIGIN) + 0.1
    assert jet_speed_m_s(4.0, half_width, 5.0) == pytest.approx(0.5 * jet_speed_m_s(4.0, 0.0, 5.0))
    assert jet_speed_m_s(8.0, half_width, 5.0) > 0.5 * jet_speed_m_s(8.0, 0.0, 5.0)
    for below, aside in ((-1.0, 0.0), (0.0, 0.0), (21.0, 0.0), (4.0, 4.5)):
        assert jet_speed_m_s(below, aside, 5.0) == 0.0


def moved(place_m, *, n_steps=1, step_s=0.1, occupancy=OCCUPANCY):
    positions = np.array([place_m])
    for _ in range(n_steps):
        blow_filaments_inplace(
            positions, 1, np.array([[5.0, 5.0, 15.0]]), np.array([0.5]), np.array([5.0]), occupancy,
            (0.0, 0.0, 0.0), 0.5, step_s,
        )  # fmt: skip
    return positions[0]


def test_filaments_fall_in_the_jet_as_its_speed_says():
    """On the axis dz/dt = -Uj 10.11 D / (z0 - z - s0 D): the square of the distance grows evenly."""
    before = 15.0 - 12.0 - ORIGIN * 0.5
    after = 15.0 - moved((5.0, 5.0, 12.0), n_steps=10)[2] - ORIGIN * 0.5
    assert after**2 - before**2 == pytest.approx(2 * 5.0 * DECAY * 0.5 * 1.0, rel=0.02)


def test_the_fall_hardly_depends_on_the_step():
    coarse, fine = moved((5.1, 5.0, 13.0), n_steps=4, step_s=0.1), moved((5.1, 5.0, 13.0), n_steps=40, step_s=0.01)
    assert coarse[2] == pytest.approx(fine[2], abs=0.03)


def test_the_floor_and_obstacles_stop_the_fall():
    occupancy = OCCUPANCY.copy()
    occupancy[:, :, :20] = 1
    assert 10.0 < moved((5.0, 5.0, 12.0), n_steps=50, occupancy=occupancy)[2] < 10.01


def test_what_is_above_or_aside_stays():
    for place_m in ((5.0, 5.0, 15.5), (9.0, 5.0, 12.0)):
        assert moved(place_m).tolist() == list(place_m)


def test_only_vehicles_in_the_air_that_have_rotors_blow(scenario_of):
    downwash = Downwash(scenario_of(rotor_downwash=True))
    assert len(downwash.compute_jets(poses(0)).outflow_m_s) == 1
    assert len(downwash.compute_jets(poses(0, phase="on_ground")).outflow_m_s) == 0
    assert not Downwash(scenario_of()).is_on
    assert not Downwash(scenario_of(rotor_downwash=True, vehicle="holonomic")).is_on


@pytest.mark.parametrize("model", ["filament", "farrell"])
def test_a_vehicle_above_the_source_pushes_its_gas_to_the_floor(scenario_of, make_room, model):
    heights_m = []
    for is_on in (False, True):
        calm = {"farrell": {"gust_std_m_s": 0.0}} if model == "farrell" else {}
        gas = {"model": model, "buoyancy": "none", **calm}
        core = FieldsCore(scenario_of(rotor_downwash=is_on, **gas), make_room())
        core.reset(Episode(seed=1))
        for tick in range(20):
            core.step(tick, {keys.BODIES: poses(tick)})
        heights_m.append(core.gas.filaments.position_world_m[:, 2].mean())
    assert heights_m[0] == pytest.approx(2.0, abs=0.3)
    assert heights_m[1] < 1.2
