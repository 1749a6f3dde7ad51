"""Rooms from what a scenario says: where folders are, and imported rooms with the scenario's wind at their inlets."""

from gslcosim.environment.geometry_source import build_geometry, find_folder
from gslcosim.scenario.models.scenario import EnvironmentSpec, LayoutSpec, WindSpec


def test_relative_folders_start_at_the_scenario(tmp_path):
    assert find_folder(EnvironmentSpec(path="rooms/a"), tmp_path) == tmp_path / "rooms" / "a"
    assert find_folder(EnvironmentSpec(gsl_bench=str(tmp_path / "b")), tmp_path / "elsewhere") == tmp_path / "b"
    assert str(find_folder(EnvironmentSpec(path="rooms/a"), None)) == "rooms/a"


def test_a_layout_becomes_its_room():
    spec = EnvironmentSpec(layout=LayoutSpec(size_m=(4.0, 3.0, 2.0)))
    assert build_geometry(spec, WindSpec(cell_m=0.5)).grid.shape == (8, 6, 4)
