"""A free rigid body of a batch is MuJoCo's, step by step, and may touch what MuJoCo's may touch."""

import mujoco
import numpy as np
import pytest

from gslcosim.vehicles import get_vehicle
from gslcosim_services.world.scene import load_body_spec
from gslcosim_services.world.vehicle_records import CONSTANTS, set_constants
from gslcosim_training.batch.contact_scene import find_hull_half_m, is_plain_body
from gslcosim_training.batch.rigid_body import advance_free_body_inplace

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
    acceleration_m_s2 = np.zeros(3)
    for k in range(400):
        mujoco.mj_resetData(model, data)
        quaternion = rng.normal(size=4)
        data.qpos[:] = (*rng.normal(size=3), *quaternion / np.linalg.norm(quaternion))
        data.qvel[:] = (*rng.normal(size=3), *rng.normal(size=3) * RATES_RAD_S[k % len(RATES_RAD_S)])
        wrench = rng.normal(size=6)
        wrench[3:] *= constants[0]["inertia_kg_m2"] * RATES_RAD_S[k % len(RATES_RAD_S)]
        pose, motion, data.qfrc_applied[:] = data.qpos.copy(), data.qvel.copy(), wrench
        advance_free_body_inplace(constants[0], pose, motion, acceleration_m_s2, wrench, DT_S)
        mujoco.mj_step(model, data)
        np.testing.assert_allclose(pose, data.qpos, rtol=0, atol=1e-13)
        np.testing.assert_allclose(motion, data.qvel, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(acceleration_m_s2, data.qacc[:3], rtol=1e-13, atol=1e-13)


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
    assert is_plain_body(compiled())
    assert not is_plain_body(compiled(change))


def test_the_box_around_a_hull_holds_its_parts_wherever_they_are():
    assert find_hull_half_m(compiled()) == pytest.approx((0.258, 0.348, 0.055))

    def leg(spec, body):
        del spec
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0.3, 0, -0.2], size=[0.1, 0.02, 0.05], euler=[0, 0, 90])

    assert find_hull_half_m(compiled(leg)) == pytest.approx((0.32, 0.348, 0.25))
