"""Every vehicle by name: gslcosim's own, and what their folders must hold."""

import shutil

import pytest
import yaml

from gslcosim.base.errors import VehicleError
from gslcosim.vehicles import get_vehicle, is_vehicle, list_vehicle_names
from gslcosim.vehicles.catalogue import VEHICLES_DIR, read_vehicle


def test_every_folder_is_a_vehicle():
    folders = {path.name for path in VEHICLES_DIR.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders <= set(list_vehicle_names())
    assert all(get_vehicle(name).name == name and get_vehicle(name).mjcf_path.is_file() for name in folders)


def test_a_name_that_nobody_has_is_no_vehicle():
    assert not is_vehicle("zeppelin")
    with pytest.raises(VehicleError, match=r"vehicle: expected one of crazyflie, .*, was 'zeppelin'"):
        get_vehicle("zeppelin")


@pytest.fixture
def changed(tmp_path):
    """Read a copy of a vehicle's folder after its parameters have been changed."""

    def read(change, name="iris"):
        shutil.copytree(VEHICLES_DIR / name, tmp_path / name)
        path = tmp_path / name / "parameters.yaml"
        entries = yaml.safe_load(path.read_text())
        change(entries)
        path.write_text(yaml.safe_dump(entries))
        return read_vehicle(name, tmp_path / name)

    return read


def test_all_problems_of_a_parameter_file_come_in_one_error(changed):
    def change(entries):
        del entries["body"]["radius_m"], entries["description"]
        entries["rotors"]["wingspan_m"] = {"value": 1.0, "origin": "none"}
        entries["rotors"]["rotor_radius_m"]["value"] = "large"
        entries["body"]["mass_kg"]["value"] = 0
        entries["rotors"]["drag_area_m2"]["value"] = [0.015, 0.015]
        entries["rotors"]["rotor_places_m"]["value"] = [[0.1, 0.2]]
        entries["control"]["max_tilt_rad"].pop("origin")
        entries["wings"] = {}

    with pytest.raises(VehicleError) as error:
        changed(change)
    for problem in (
        "vehicle iris: description: expected one sentence, was missing.",
        "vehicle iris: body.radius_m: expected a parameter, was missing.",
        "vehicle iris: body.mass_kg: expected a number greater than 0, was 0.",
        "vehicle iris: rotors.wingspan_m: expected one of ['air_density_kg_m3', ",
        "vehicle iris: rotors.rotor_radius_m: expected a number greater than 0, was 'large'.",
        "vehicle iris: rotors.drag_area_m2: expected a list of 3 numbers, was [0.015, 0.015].",
        "vehicle iris: rotors.rotor_places_m: expected a list of places, each a list of 3 numbers, was [[0.1, 0.2]].",
        "vehicle iris: control.max_tilt_rad: expected an origin, was missing.",
        "vehicle iris: wings: expected one of the sections body, control, rotors, drawing of kind multirotor.",
    ):
        assert problem in str(error.value)
    assert str(error.value).endswith("iris/parameters.yaml")


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("rotor_places_m", [[0.1, 0.1, 0.0]] * 3, "rotor_places_m: expected 4 to 16 places, was 3."),
        ("rotor_directions", [1, -1, 1], "rotor_directions: expected 4, one for each place, was 3."),
        ("rotor_directions", [1, -1, 1, 0.5], "rotor_directions: expected 1 or -1 for each rotor, was "),
        ("rotor_directions", [1, 1, 1, 1], "can turn the vehicle about all axes, was some that cannot."),
    ],
)
def test_rotors_that_cannot_fly_are_refused(changed, key, value, problem):
    with pytest.raises(VehicleError) as error:
        changed(lambda entries: entries["rotors"][key].update(value=value))
    assert problem in str(error.value)


def test_a_kind_that_nobody_knows_is_refused(changed):
    with pytest.raises(VehicleError, match="kind: expected one of multirotor, holonomic, wheels, was 'fish'"):
        changed(lambda entries: entries.update(kind="fish"), "rover")


def test_a_folder_needs_both_files(tmp_path):
    with pytest.raises(VehicleError, match="vehicle kite: expected a file that can be read"):
        read_vehicle("kite", tmp_path)
    shutil.copy(VEHICLES_DIR / "iris" / "parameters.yaml", tmp_path)
    with pytest.raises(VehicleError, match=r"kite.xml: expected the MJCF of the vehicle beside parameters.yaml"):
        read_vehicle("kite", tmp_path / ".")
    (tmp_path / "parameters.yaml").write_text("- a list\n")
    with pytest.raises(VehicleError, match="expected a map of sections, was list"):
        read_vehicle("swift", tmp_path)
    (tmp_path / "parameters.yaml").write_text("{")
    with pytest.raises(VehicleError, match="expected YAML, got"):
        read_vehicle("gull", tmp_path)
