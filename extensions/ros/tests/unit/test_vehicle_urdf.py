"""The URDF of a vehicle, read by MuJoCo, is the vehicle."""

import mujoco
import numpy as np
import pytest

from gslcosim.base.frames import rotation_from_rpy
from gslcosim.vehicles import get_vehicle, list_vehicle_names
from gslcosim_ros.vehicle_urdf import build_urdf, rpy_from_rotation

# MuJoCo takes the first link for the world: the vehicle floats in it.
WORLD = '<link name="world"/><joint name="free" type="floating"><parent link="world"/><child link="body"/></joint>'


def compute_free_inertia(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    columns = np.zeros((6, model.nv))
    for column, unit in zip(columns, np.eye(model.nv), strict=False):
        mujoco.mj_mulM(model, data, column, unit)
    return columns[:, :6]


@pytest.mark.parametrize("name", list_vehicle_names())
def test_a_urdf_has_mass_inertia_and_shapes_of_the_vehicle(name):
    vehicle = get_vehicle(name)
    urdf = build_urdf(vehicle, "body")
    read = mujoco.MjModel.from_xml_string(urdf.replace("</robot>", f"{WORLD}</robot>").split("?>", 1)[1])
    own = mujoco.MjModel.from_xml_path(str(vehicle.mjcf_path))
    assert read.body_mass.sum() == pytest.approx(vehicle.body.mass_kg, rel=1e-2)
    assert read.body_mass.sum() == pytest.approx(own.body_mass.sum(), rel=1e-6)
    # As MuJoCo sums it: how mass and inertia resist the free joint.
    np.testing.assert_allclose(compute_free_inertia(read), compute_free_inertia(own), rtol=1e-5, atol=1e-8)
    assert sorted(read.geom_type) == sorted(own.geom_type)
    np.testing.assert_allclose(np.sort(read.geom_rbound), np.sort(own.geom_rbound), rtol=1e-6)


@pytest.mark.parametrize("rpy_rad", [(0.0, 0.0, 0.0), (0.4, -1.2, 2.9), (-3.0, 1.5, -0.7)])
def test_angles_of_a_rotation_are_those_that_it_was_made_of(rpy_rad):
    assert rpy_from_rotation(rotation_from_rpy(rpy_rad)) == pytest.approx(rpy_rad)
