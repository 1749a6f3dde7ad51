"""Environments from scenarios: made once, kept by what they were made from, and solved with the built-in solver."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from built_scenarios import build_agent, build_scenario
from deadlines import PROCESS_S

import gslcosim
from gslcosim.base.errors import EnvironmentDataError, ScenarioError
from gslcosim.environment.generation.cache import prepare_environment, recipe_hash, sources
from gslcosim.environment.model import Cell
from gslcosim.environment.readers import list_reader_packages
from gslcosim.environment.store import load_environment
from gslcosim.scenario.models.scenario import EnvironmentSpec, LayoutSpec, WindSpec
from gslcosim.scenario.serialization import plain_values

SMALL = {"size_m": [4.0, 3.0, 2.0], "obstacles": [{"name": "box", "min_m": [1, 1, 0], "max_m": [2, 2, 1]}]}
UNIFORM = {"solver": "uniform", "inlet_velocity_m_s": [0.5, -0.25, 0.0], "cell_m": 0.25}


def scenario(environment=None, wind=None):
    gas = {"sources": [{"position_m": [3.0, 1.0, 1.0]}]}
    agent = build_agent("agent", (3.0, 2.0, 0.2))
    return build_scenario(agent, environment=environment or {"layout": SMALL}, wind=wind or UNIFORM, gas=gas)


def test_uniform_wind_is_the_same_in_all_air_and_zero_in_solids(tmp_path):
    environment = load_environment(prepare_environment(scenario(), cache_dir=tmp_path))
    assert environment.wind.velocity_m_s.shape == (1, 16, 12, 8, 3)
    is_air = environment.occupancy != Cell.SOLID
    assert (environment.wind.velocity_m_s[0][is_air] == np.float32([0.5, -0.25, 0.0])).all()
    assert (environment.wind.velocity_m_s[0][~is_air] == 0.0).all()
    assert 0 < (~is_air).sum() < is_air.sum()


def test_an_environment_is_made_once(tmp_path):
    reports = []

    def tell(text, fraction):
        reports.append((text, fraction))

    first = prepare_environment(scenario(), cache_dir=tmp_path, progress=tell)
    assert reports[0] == ("Building the room", 0.0)
    assert reports[-1][1] == 1.0
    made = (first / "wind.npy").stat().st_ino
    reports.clear()
    assert prepare_environment(scenario(), cache_dir=tmp_path, progress=tell) == first
    assert reports == []
    assert (first / "wind.npy").stat().st_ino == made


def test_a_damaged_environment_in_the_cache_is_made_again(tmp_path, caplog):
    folder = prepare_environment(scenario(), cache_dir=tmp_path)
    (folder / "wind.npy").write_bytes(b"half")
    assert prepare_environment(scenario(), cache_dir=tmp_path) == folder
    assert "damaged" in caplog.text
    load_environment(folder)


def test_the_recipe_changes_with_everything_that_changes_the_result():
    layout, wind = LayoutSpec(), WindSpec()

    def hash_of(layout, wind):
        return recipe_hash(EnvironmentSpec(layout=layout), wind)

    recipes = {
        hash_of(layout, wind),
        hash_of(layout.model_copy(update={"size_m": (10.0, 15.0, 8.0)}), wind),
        hash_of(layout.model_copy(update={"seed": 2}), wind),
        hash_of(layout, wind.model_copy(update={"solver": "uniform"})),
        hash_of(layout, wind.model_copy(update={"cell_m": 0.25})),
        hash_of(layout, wind.model_copy(update={"end_time_s": 61.0})),
        hash_of(layout, wind.model_copy(update={"courant": 0.5})),
        hash_of(layout, wind.model_copy(update={"inlet_velocity_m_s": (1.5, 0.0, 0.0)})),
    }
    assert len(recipes) == 8


def test_the_recipe_of_uniform_wind_does_not_depend_on_the_solver():
    wind = WindSpec(solver="uniform")
    spec = EnvironmentSpec(layout=LayoutSpec())
    assert recipe_hash(spec, wind) == recipe_hash(spec, wind.model_copy(update={"end_time_s": 5.0}))


def list_sources(spec, wind):
    return sources(wind, list_reader_packages(spec, wind))


def test_the_recipe_names_all_code_that_decides_the_result():
    layout, folder = EnvironmentSpec(layout=LayoutSpec()), EnvironmentSpec(gsl_bench="somewhere")
    for solver in ("uniform", "built_in"):
        paths = list_sources(layout, WindSpec(solver=solver))
        assert all(path.is_file() for path in paths)
        assert any(path.parent.name == "flow" for path in paths) == (solver == "built_in")
    names_of = lambda spec: {path.name for path in list_sources(spec, WindSpec())}  # noqa: E731
    assert names_of(folder) > names_of(layout)


def test_code_that_only_writes_rooms_elsewhere_makes_no_environment_again():
    names = {path.name for path in list_sources(EnvironmentSpec(layout=LayoutSpec()), WindSpec())}
    assert names.isdisjoint({"stl.py", "vtk.py", "export.py", "positions.py", "scoring_paths.py"})
    assert names >= {"grid_kernels.py", "geometry_source.py", "store.py", "solver.py", "domain.py"}
    assert names & {path.name for path in (Path(gslcosim.__file__).parent / "environment" / "layouts").glob("*.py")}


PREPARE = """
import sys
from pathlib import Path
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.scenario.models.scenario import Scenario
scenario = Scenario.model_validate_json(sys.argv[1])
sys.stdout.write(str(prepare_environment(scenario, cache_dir=Path(sys.argv[2]))))
"""


@pytest.mark.slow
def test_processes_that_prepare_the_same_environment_at_once_all_get_it(tmp_path):
    text = json.dumps(plain_values(scenario()))
    command = [sys.executable, "-c", PREPARE, text, str(tmp_path / "cache")]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    folders = {process.communicate(timeout=PROCESS_S)[0] for process in processes}
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert len(folders) == 1
    load_environment(Path(folders.pop()))
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_the_folder_of_a_path_is_checked_and_returned(tmp_path):
    folder = prepare_environment(scenario(), cache_dir=tmp_path)
    stored = scenario({"path": folder.name})
    assert prepare_environment(stored, scenario_dir=tmp_path) == folder
    (folder / "occupancy.npy").unlink()
    with pytest.raises(EnvironmentDataError, match=r"environment\.path: occupancy\.npy"):
        prepare_environment(stored, scenario_dir=tmp_path)


def test_an_impossible_room_is_refused_and_leaves_nothing(tmp_path):
    with pytest.raises(ScenarioError, match="whole number"):
        prepare_environment(scenario({"layout": {"size_m": [4.1, 3, 2]}}), cache_dir=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_built_in_solver_blows_from_the_inlet_around_the_obstacle_to_the_outlet(tmp_path):
    wind = {"inlet_velocity_m_s": [0.5, 0.0, 0.0], "cell_m": 0.25, "end_time_s": 4.0, "average_from_s": None}
    reports = []
    folder = prepare_environment(
        scenario(wind=wind), cache_dir=tmp_path, progress=lambda text, fraction: reports.append((text, fraction))
    )
    environment = load_environment(folder)
    velocity_m_s = environment.wind.velocity_m_s[0]
    assert (velocity_m_s[environment.occupancy == Cell.SOLID] == 0.0).all()
    inlet, outlet = environment.openings
    assert velocity_m_s[0][: round(inlet.max_m[1] / 0.25), : round(inlet.max_m[2] / 0.25), 0] == pytest.approx(
        0.5, abs=0.1
    )
    assert velocity_m_s[-1][round(outlet.min_m[1] / 0.25) :, : round(outlet.max_m[2] / 0.25), 0].mean() > 0.25
    fractions = [fraction for text, fraction in reports if text == "Solving the wind"]
    assert len(fractions) > 1
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
