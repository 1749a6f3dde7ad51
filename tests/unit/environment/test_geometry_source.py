"""Rooms from what a scenario says: where folders are, and imported rooms with the scenario's wind at their inlets."""

from gslcosim.environment.geometry_source import find_folder
from gslcosim.scenario.models.scenario import EnvironmentSpec


def test_relative_folders_start_at_the_scenario(tmp_path):
    assert find_folder(EnvironmentSpec(path="rooms/a"), tmp_path) == tmp_path / "rooms" / "a"
    assert find_folder(EnvironmentSpec(gsl_bench=str(tmp_path / "b")), tmp_path / "elsewhere") == tmp_path / "b"
    assert str(find_folder(EnvironmentSpec(path="rooms/a"), None)) == "rooms/a"
