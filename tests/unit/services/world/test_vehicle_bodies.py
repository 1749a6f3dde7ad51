"""The MJCF of each vehicle is what the catalogue says."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from gslcosim.base.errors import ModelError, VehicleError
from gslcosim.vehicles import get_vehicle, list_vehicle_names
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.scene import build_scene, check_body, load_body_spec


@pytest.mark.parametrize("name", list_vehicle_names())
def test_every_vehicle_compiles_to_what_the_catalogue_says(name):
    check_body(get_vehicle(name))


@pytest.mark.parametrize("name", list_vehicle_names())
def test_the_scene_has_the_vehicle_of_the_catalogue(name, make_room):
    vehicle = get_vehicle(name)
    scene = build_scene(make_room(), [("beetle", vehicle)], 0.004)
    assert scene.half_height_m == pytest.approx((vehicle.body.half_height_m,))
    assert scene.model.body_subtreemass[scene.model.body("beetle/body").id] == pytest.approx(vehicle.body.mass_kg)


def with_section(name, section, **changes):
    vehicle = get_vehicle(name)
    return replace(vehicle, **{section: replace(getattr(vehicle, section), **changes)})


@pytest.mark.parametrize(
    ("name", "section", "changes", "problem"),
    [
        ("iris", "body", {"mass_kg": 1.5}, "body.mass_kg: expected 1.535, as the MJCF has it, was 1.5."),
        ("iris", "body", {"half_height_m": 0.06}, "body.half_height_m: expected 0.055, as the MJCF has it, was 0.06."),
        ("iris", "body", {"radius_m": 0.3}, "body.radius_m: expected 0.383539, as the MJCF has it, was 0.3."),
        ("iris", "rotors", {"rotor_radius_m": 0.2}, "body.radius_m: expected 0.455539"),
        ("holonomic", "body", {"radius_m": 0.1}, "body.radius_m: expected 0.15, as the MJCF has it, was 0.1."),
        ("rover", "wheels", {"half_track_m": 0.2}, "the place of wheel_left, from half_track_m and axle_height_m"),
        ("rover", "wheels", {"wheel_radius_m": 0.1}, "wheels.wheel_radius_m: expected 0.0975"),
        ("rover", "wheels", {"caster_radius_m": 0.1}, "wheels.caster_radius_m: expected 0.0375"),
        ("rover", "wheels", {"caster_place_m": (0.2, 0.0, 0.0)}, "caster_place_m: expected [-0.2145, 0, -0.081]"),
    ],
)  # fmt: skip
def test_what_the_mjcf_contradicts_is_reported(name, section, changes, problem):
    with pytest.raises(VehicleError) as error:
        check_body(with_section(name, section, **changes))
    assert problem in str(error.value)


def test_a_rotor_elsewhere_is_reported():
    places_m = list(get_vehicle("iris").rotors.rotor_places_m)
    places_m[2] = (0.1, 0.2, 0.0)
    with pytest.raises(VehicleError, match=r"rotor_places_m\[2\]: expected \[0.13, 0.22, 0.023\]"):
        check_body(with_section("iris", "rotors", rotor_places_m=tuple(places_m)))


@pytest.mark.parametrize(
    ("before", "after", "problem"),
    [
        ('name="rotor_3"', 'name="rotor_4"', "expected a site named rotor_3, found none."),
        ('name="hull"', 'name="frame"', "expected a geom named hull, found none."),
        ("<freejoint", "<freejoin", "expected an MJCF that MuJoCo compiles, got"),
    ],
)
def test_a_body_without_a_part_is_refused(tmp_path, before, after, problem):
    iris = get_vehicle("iris")
    shutil.copytree(iris.folder, tmp_path / "iris")
    mjcf = tmp_path / "iris" / "iris.xml"
    mjcf.write_text(mjcf.read_text().replace(before, after))
    with pytest.raises(VehicleError) as error:
        load_body_spec(replace(iris, folder=tmp_path / "iris"))
    assert problem in str(error.value)


def test_rotors_too_weak_to_hover_are_refused(make_room):
    iris = with_section("iris", "rotors", max_rotor_speed_rad_s=700.0)
    scene = build_scene(make_room(), [("beetle", iris)], 0.004)
    with pytest.raises(ModelError, match="rotors that can carry it, was 803 rad/s in hover at a limit of 700 rad/s"):
        vehicle_records.set_constants(np.zeros(1, vehicle_records.CONSTANTS)[0], iris, scene.model, "beetle/", 0.004)
