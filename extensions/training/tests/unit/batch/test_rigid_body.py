"""A rigid body of a batch may touch what MuJoCo's may touch."""

import mujoco
import pytest

from gslcosim.vehicles import get_vehicle
from gslcosim_services.world.scene import load_body_spec
from gslcosim_training.batch.contact_scene import find_hull_half_m


def compiled(change=None):
    """Return a scene with nothing but a vehicle."""
    spec = mujoco.MjSpec()
    kept = load_body_spec(get_vehicle("iris"))
    body = spec.worldbody.add_frame().attach_body(kept.worldbody.first_body(), "v/", "")
    if change is not None:
        change(spec, body)
    return spec.compile()


def test_the_box_around_a_hull_holds_its_parts_wherever_they_are():
    assert find_hull_half_m(compiled()) == pytest.approx((0.258, 0.348, 0.055))

    def leg(spec, body):
        del spec
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0.3, 0, -0.2], size=[0.1, 0.02, 0.05], euler=[0, 0, 90])

    assert find_hull_half_m(compiled(leg)) == pytest.approx((0.32, 0.348, 0.25))
