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
