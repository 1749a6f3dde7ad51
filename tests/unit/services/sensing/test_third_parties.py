"""Sensor models of installed packages."""

import importlib
from dataclasses import replace

import pytest
from offering_packages import install_package

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.sensors import SENSOR_ENTRY_POINTS
from gslcosim.scenario.models.sensors import sensor_names as names_in_scenarios
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.core import SensingCore
from gslcosim_services.sensing.models import sensor_kind, sensor_names


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install a package that offers things under names of sensors."""

    def install(**offers):
        install_package(monkeypatch, tmp_path, "somebodys_sensors", SENSOR_ENTRY_POINTS, **offers)
        names_in_scenarios.cache_clear()

    yield install
    monkeypatch.undo()
    importlib.invalidate_caches()
    names_in_scenarios.cache_clear()


OWN = replace(SENSOR_MODELS["pid"], name="sniffer", description="Somebody's own.")


def test_a_scenario_may_name_the_sensor_of_a_package(package, make_room):
    package(sniffer=OWN)
    assert sensor_names()[-2:] == ("broken", "sniffer")
    assert sensor_kind("sniffer") is OWN
    scenario = load_scenario("tiny_room", overrides=["agents[0].sensors[0].model=sniffer"]).scenario
    assert SensingCore(scenario, make_room()).spec.name == "sensing"


def test_without_the_package_the_name_is_unknown():
    with pytest.raises(ScenarioError, match=r"expected one of tgs2600, .*, was 'sniffer'"):
        sensor_kind("sniffer")


def test_a_package_that_offers_something_else_is_refused(package):
    package(sniffer=42, misnamed=OWN)
    with pytest.raises(
        ScenarioError, match="expected somebodys_sensors:sniffer to be the SensorKind 'sniffer', was 42"
    ):
        sensor_kind("sniffer")
    with pytest.raises(ScenarioError, match="to be the SensorKind 'misnamed'"):
        sensor_kind("misnamed")


def test_a_package_that_cannot_be_imported_is_named(package):
    package(sniffer=OWN)
    with pytest.raises(ScenarioError, match="somebodys_missing_module:broken to be imported for the sensor 'broken'"):
        sensor_kind("broken")
