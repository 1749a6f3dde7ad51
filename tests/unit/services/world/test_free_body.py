"""A free rigid body advances as MuJoCo's does, step by step."""

import mujoco
import numpy as np
import pytest

from gslcosim.vehicles import get_vehicle
from gslcosim_services.world.scene import load_body_spec
from gslcosim_services.world.simulation_loop import advance_free_body_inplace
from gslcosim_services.world.vehicle_records import CONSTANTS, is_plain_body, set_constants

DT_S = 0.004
ROTORCRAFT = ("iris", "crazyflie", "hexarotor")
# Spinning as no vehicle does, slowly, and not at all.
RATES_RAD_S = (20.0, 1.0, 1e-9, 0.0)


def compiled(change=None, vehicle="iris"):
    """Return a scene with nothing but a vehicle."""
    spec = mujoco.MjSpec()
    spec.option.timestep = DT_S
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    kept = load_body_spec(get_vehicle(vehicle))
    body = spec.worldbody.add_frame().attach_body(kept.worldbody.first_body(), "v/", "")
    if change is not None:
        change(spec, body)
    return spec.compile()


@pytest.mark.parametrize("vehicle", ROTORCRAFT)
def test_a_step_is_that_of_mujoco_but_for_rounding(vehicle):
    model = compiled(vehicle=vehicle)
    data, constants = mujoco.MjData(model), np.zeros(1, CONSTANTS)
    set_constants(constants[0], get_vehicle(vehicle), model, "v/", DT_S)
    rng = np.random.default_rng(4)
    acceleration = np.zeros(6)
    for k in range(400):
        mujoco.mj_resetData(model, data)
        quaternion = rng.normal(size=4)
        data.qpos[:] = (*rng.normal(size=3), *quaternion / np.linalg.norm(quaternion))
        data.qvel[:] = (*rng.normal(size=3), *rng.normal(size=3) * RATES_RAD_S[k % len(RATES_RAD_S)])
        wrench = rng.normal(size=6)
        wrench[3:] *= constants[0]["inertia_kg_m2"] * RATES_RAD_S[k % len(RATES_RAD_S)]
        pose, motion, data.qfrc_applied[:] = data.qpos.copy(), data.qvel.copy(), wrench
        advance_free_body_inplace(constants[0], pose, motion, acceleration, wrench, DT_S)
        mujoco.mj_step(model, data)
        np.testing.assert_allclose(pose, data.qpos, rtol=0, atol=1e-13)
        np.testing.assert_allclose(motion, data.qvel, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(acceleration, data.qacc, rtol=1e-12, atol=1e-12)


def shifted(spec, body):
    del spec
    body.ipos = [0.01, 0.0, 0.0]


def turned(spec, body):
    del spec
    body.iquat = [0.8, 0.6, 0.0, 0.0]


def damped(spec, body):
    del spec
    body.joints[0].damping = [0.1, 0.0, 0.0]


def immersed(spec, body):
    del body
    spec.option.density = 1.2


def jointed(spec, body):
    del spec
    child = body.add_body(name="arm")
    child.add_joint(name="hinge")
    child.add_geom(size=[0.01, 0, 0])


@pytest.mark.parametrize("change", [shifted, turned, damped, immersed, jointed])
def test_a_body_whose_step_is_another_is_told_apart(change):
    assert is_plain_body(compiled(), 1)
    assert not is_plain_body(compiled(change), 1)
