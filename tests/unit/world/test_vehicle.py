from typing import get_args

import numpy as np
import pytest
import yaml

from gslcosim.environment.of_scenario.places import VEHICLE_HALF_HEIGHT_M, VEHICLE_RADIUS_M
from gslcosim.errors import ModelError
from gslcosim.scenario.models.scenario import ROVER_HEIGHT_M, VehicleSpec
from gslcosim.world import vehicle
from gslcosim.world.physics import records
from gslcosim.world.physics.scene import build_scene
from gslcosim.world.vehicle import VEHICLES_DIR, load_vehicle

MODELS = sorted(path.name for path in VEHICLES_DIR.iterdir())


@pytest.mark.parametrize("name", MODELS)
def test_every_vehicle_loads_and_every_parameter_has_an_origin(name):
    assert load_vehicle(name).name == name


def test_models_of_the_scenario_are_the_folders():
    assert sorted(get_args(VehicleSpec.model_fields["model"].annotation)) == MODELS


@pytest.mark.parametrize("name", MODELS)
def test_the_sizes_that_scenarios_are_checked_with_are_the_vehicles(name, make_room):
    scene = build_scene(make_room(), [("beetle", load_vehicle(name))], 0.004)
    assert load_vehicle(name).body.radius_m == VEHICLE_RADIUS_M[name]
    assert scene.half_height_m == pytest.approx((VEHICLE_HALF_HEIGHT_M[name],))


def test_the_height_of_a_rover_in_scenarios_is_the_rovers(make_room):
    scene = build_scene(make_room(), [("beetle", load_vehicle("rover"))], 0.004)
    assert scene.half_height_m == pytest.approx((ROVER_HEIGHT_M,))


def write_model(tmp_path, monkeypatch, change):
    entries = yaml.safe_load((VEHICLES_DIR / "iris" / "parameters.yaml").read_text())
    change(entries)
    (tmp_path / "iris").mkdir()
    (tmp_path / "iris" / "parameters.yaml").write_text(yaml.safe_dump(entries))
    (tmp_path / "iris" / "iris.xml").write_text((VEHICLES_DIR / "iris" / "iris.xml").read_text())
    monkeypatch.setattr(vehicle, "VEHICLES_DIR", tmp_path)


def test_all_problems_of_a_parameter_file_come_in_one_error(tmp_path, monkeypatch):
    def change(entries):
        del entries["body"]["radius_m"]
        entries["rotors"]["wingspan_m"] = {"value": 1.0, "origin": "none"}
        del entries["control"]["max_tilt_rad"]["origin"]

    write_model(tmp_path, monkeypatch, change)
    with pytest.raises(ModelError) as error:
        load_vehicle("iris")
    assert all(
        name in str(error.value) for name in ("body.radius_m", "rotors.wingspan_m", "max_tilt_rad: expected an origin")
    )


def test_rotors_too_weak_to_hover_are_refused(tmp_path, monkeypatch, make_room):
    write_model(tmp_path, monkeypatch, lambda entries: entries["rotors"]["max_rotor_speed_rad_s"].update(value=700.0))
    iris = load_vehicle("iris")
    scene = build_scene(make_room(), [("beetle", iris)], 0.004)
    with pytest.raises(ModelError, match="rotors that can carry it, was 803 rad/s in hover at a limit of 700 rad/s"):
        records.set_constants(np.zeros(1, records.CONSTANTS)[0], iris, scene.model, "beetle/", 0.004)
