"""Vehicles are drawn as they are in the world."""

from typing import get_args

import pytest

from gslcosim.recording.vehicle_shapes import SHAPES, Multirotor
from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.world.vehicle import load_vehicle


def model_of(name):
    return load_vehicle(name).body_spec().compile()


def test_every_vehicle_has_a_shape():
    assert set(SHAPES) == set(get_args(VehicleSpec.model_fields["model"].annotation))


@pytest.mark.parametrize("name", [name for name, shape in SHAPES.items() if isinstance(shape, Multirotor)])
def test_rotors_are_drawn_where_they_push(name):
    model, shape = model_of(name), SHAPES[name]
    for i, rotor_m in enumerate(shape.rotors_m):
        assert rotor_m == pytest.approx(tuple(model.site(f"rotor_{i}").pos))
    # The hull of the physics just holds all discs.
    for axis in range(2):
        reach_m = max(abs(rotor_m[axis]) for rotor_m in shape.rotors_m) + shape.rotor_radius_m
        assert reach_m == pytest.approx(model.geom("hull").size[axis], abs=0.001)


def test_the_ball_is_the_hull():
    assert SHAPES["holonomic"].radius_m == model_of("holonomic").geom("hull").size[0]


def test_the_rover_stands_on_what_is_drawn():
    model, shape = model_of("rover"), SHAPES["rover"]
    for i, side in enumerate(("left", "right")):
        wheel = model.body(f"wheel_{side}")
        assert (0.0, (1 - 2 * i) * shape.half_track_m, shape.axle_height_m) == pytest.approx(tuple(wheel.pos))
        assert shape.wheel_radius_m == model.geom(f"wheel_{side}").size[0]
    assert shape.caster_m == pytest.approx(tuple(model.body("caster").pos))
    assert shape.caster_radius_m == model.geom("caster").size[0]
    lowest_m = shape.axle_height_m - shape.wheel_radius_m
    assert lowest_m == pytest.approx(shape.caster_m[2] - shape.caster_radius_m)
    top_m = shape.plate_m[0][2] + shape.plate_m[1][2]
    assert top_m - lowest_m == pytest.approx(0.237)
