"""Vehicles are drawn as they are in the catalogue."""

import pytest

from gslcosim.vehicles import get_vehicle, list_vehicle_names
from gslcosim_services.recorder.scene import draw_shape

PARTS = {"multirotor": {"arms", "rotors", "hull"}, "holonomic": {"hull"}, "wheels": {"hull", "wheels", "caster"}}


@pytest.mark.parametrize("name", list_vehicle_names())
def test_every_vehicle_is_drawn_with_the_parts_of_its_kind(name):
    class Drawn(dict):
        def draw(self, entity, shape):
            self[entity.split("/")[-1]] = shape

    file = Drawn()
    draw_shape(file, "moth", get_vehicle(name), (1, 2, 3))
    assert set(file) == PARTS[get_vehicle(name).kind]
    if rotors := get_vehicle(name).rotors:
        assert len(file["rotors"].centers) == rotors.n_rotors


def test_the_rover_is_drawn_from_its_floor_to_its_top():
    rover = get_vehicle("rover")
    drawing, wheels = rover.drawing, rover.wheels
    lowest_m = wheels.axle_height_m - wheels.wheel_radius_m
    assert lowest_m == pytest.approx(wheels.caster_place_m[2] - wheels.caster_radius_m)
    assert lowest_m == pytest.approx(-rover.body.half_height_m)
    assert drawing.plate_centre_m[2] + drawing.plate_half_m[2] == pytest.approx(rover.body.half_height_m)
