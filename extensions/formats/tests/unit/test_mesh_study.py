"""Mesh studies: meshes that divide the room, probes in air, and a table with orders."""

import json

import pytest

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.cli.main import main
from gslcosim.scenario.models.scenario import EnvironmentSpec, WindSpec
from gslcosim_formats.mesh_study import find_dividing_cell_sizes, study_meshes
from gslcosim_formats.recipes import Recipe, load_recipe


def test_meshes_are_the_nearest_that_divide_the_room_and_all_different():
    pairs = find_dividing_cell_sizes((15.0, 15.0, 8.0), (0.4, 0.3, 0.2, 0.15))
    assert [round(1 / cell_m) for _, cell_m in pairs] == [3, 4, 5, 7]
    assert [wanted_m for wanted_m, _ in pairs] == [0.4, 0.3, 0.2, 0.15]
    cells_m = [cell_m for _, cell_m in find_dividing_cell_sizes((4.0, 3.0, 2.0), (0.5, 0.49, 0.48))]
    assert cells_m == sorted(set(cells_m), reverse=True)


@pytest.mark.slow
def test_a_study_shows_speeds_and_orders_and_writes_them(tmp_path, capsys):
    (tmp_path / "tunnel.yaml").write_text(
        "layout: {kind: wind_tunnel, size_m: [4, 1, 1]}\nwind: {end_time_s: 2, inlet_velocity_m_s: [1, 0, 0]}\n"
    )
    words = ["--mesh-study", "0.25,0.2,0.125", "--probe", "2,0.5,0.5", "--json"]
    assert (
        main(["environment", "generate", str(tmp_path / "tunnel.yaml"), "--out", str(tmp_path / "study"), *words]) == 0
    )
    study = json.loads(capsys.readouterr().out)
    assert [run["cell_m"] for run in study["runs"]] == [0.25, 0.2, 0.125]
    # In the middle of a channel with friction at its walls the air is a little faster than at the inlet.
    assert all(1.0 < run["probe_speeds_m_s"][0] < 1.3 for run in study["runs"])
    assert study == json.loads((tmp_path / "study" / "mesh_study.json").read_text())
    assert (tmp_path / "study" / "mesh_study.csv").read_text().startswith("cell [m],wanted")
    assert (tmp_path / "study" / "mesh_study.png").read_bytes().startswith(b"\x89PNG")


def test_a_probe_in_a_solid_and_a_room_with_its_own_cells_are_refused():
    recipe = load_recipe("warehouse_simple", overrides=["wind.solver=uniform"])
    with pytest.raises(ScenarioError, match=r"--probe \[1, 1, -1\]"):
        study_meshes(recipe, (1.0, 0.5, 0.25), probes_m=[(1.0, 1.0, -1.0)])
    imported = Recipe(name="x", environment=EnvironmentSpec(gsl_bench="x"), wind=WindSpec())
    with pytest.raises(UsageError, match="was a room with cells of its own"):
        study_meshes(imported, (1.0, 0.5, 0.25))
