"""Vehicles of installed packages."""

import importlib
import shutil
import sys
import types

import pytest
from offering_packages import install_package

from gslcosim.base.errors import ScenarioError, VehicleError
from gslcosim.scenario.loader import load_scenario
from gslcosim.vehicles import VEHICLE_ENTRY_POINTS, catalogue, get_vehicle, list_vehicle_names
from gslcosim.vehicles.catalogue import VEHICLES_DIR


def forget():
    importlib.invalidate_caches()
    list_vehicle_names.cache_clear()
    catalogue._find_offered.cache_clear()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install a package that offers things under names of vehicles."""

    def install(name="somebodys_vehicles", **offers):
        install_package(monkeypatch, tmp_path, name, VEHICLE_ENTRY_POINTS, **offers)
        forget()

    yield install
    monkeypatch.undo()
    forget()


@pytest.fixture
def folder(tmp_path):
    """The folder of a vehicle named `tern`, which is an iris."""
    place = tmp_path / "anywhere"
    shutil.copytree(VEHICLES_DIR / "iris", place)
    (place / "iris.xml").rename(place / "tern.xml")
    return place


def with_vehicle(name):
    return load_scenario("tiny_room", overrides=[f"agents[0].vehicle.model={name}"]).scenario.agents[0].vehicle


def test_a_scenario_may_name_the_vehicle_of_a_package(package, folder):
    module = types.ModuleType("tern")
    module.__file__ = str(folder / "__init__.py")
    package(tern=module)
    assert list_vehicle_names()[-1] == "tern"
    assert get_vehicle("tern").mjcf_path == folder / "tern.xml"
    assert with_vehicle("tern").facts.body == get_vehicle("iris").body


@pytest.mark.parametrize("kind", [str, lambda path: path])
def test_a_folder_may_be_a_path(package, folder, kind):
    package(tern=kind(folder))
    assert get_vehicle("tern").folder == folder


def test_own_vehicles_cannot_be_replaced(package, folder):
    package(iris=str(folder))
    assert get_vehicle("iris").folder == VEHICLES_DIR / "iris"
    assert list_vehicle_names().count("iris") == 1


def test_something_else_than_a_folder_is_refused_where_it_is_named(package, tmp_path):
    package(tern=42, gull=tmp_path / "nowhere")
    with pytest.raises(VehicleError, match=r"expected somebodys_vehicles:tern to be a folder's path, .* was 42"):
        get_vehicle("tern")
    with pytest.raises(ScenarioError, match=r"vehicle.model: expected a vehicle whose folder is whole, was 'gull'"):
        with_vehicle("gull")


def test_a_folder_without_its_files_is_refused(package, folder):
    (folder / "tern.xml").unlink()
    package(tern=folder)
    with pytest.raises(ScenarioError, match=r"tern.xml: expected the MJCF of the vehicle beside parameters.yaml"):
        with_vehicle("tern")


def test_a_package_that_cannot_be_imported_is_named(package, folder, monkeypatch):
    package(tern=folder)
    monkeypatch.delitem(sys.modules, "somebodys_vehicles")
    forget()
    with pytest.raises(VehicleError, match="vehicle tern: expected somebodys_vehicles:tern to be imported for "):
        get_vehicle("tern")


def test_a_name_that_two_packages_offer_is_refused(package, folder):
    package(tern=folder)
    package("others_vehicles", tern=folder)
    with pytest.raises(VehicleError, match="'tern', was others_vehicles:tern and somebodys_vehicles:tern"):
        get_vehicle("tern")
