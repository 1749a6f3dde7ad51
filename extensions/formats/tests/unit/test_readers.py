"""Rooms that scenarios name by folders and files."""

from reference_data import ENVIRONMENTS, needs_environments

from gslcosim.environment.geometry_source import build_geometry, find_source_problems
from gslcosim.scenario.models.scenario import EnvironmentSpec, WindSpec

ROOM_1 = ENVIRONMENTS / "001"


@needs_environments
def test_inlets_of_an_imported_room_have_the_scenario_s_wind():
    spec = EnvironmentSpec(gsl_bench=str(ROOM_1))
    room = build_geometry(spec, WindSpec(inlet_velocity_m_s=(0.7, 0.0, 0.0)))
    velocities = {opening.kind: opening.velocity_m_s for opening in room.openings}
    assert velocities == {"inlet": (0.7, 0.0, 0.0), "outlet": (0.0, 0.0, 0.0)}


@needs_environments
def test_wind_that_does_not_enter_an_imported_room_is_a_problem():
    spec = EnvironmentSpec(gsl_bench=str(ROOM_1))
    (problem,) = find_source_problems(spec, WindSpec(inlet_velocity_m_s=(-1.0, 0.0, 0.0)))
    assert problem.where == "wind.inlet_velocity_m_s"
    assert "x_min" in problem.expected


def test_a_folder_that_is_no_environment_is_a_problem_of_its_key(tmp_path):
    (problem,) = find_source_problems(EnvironmentSpec(gsl_bench=str(tmp_path)), WindSpec())
    assert problem.where == "environment.gsl_bench"
    assert "head.txt" in problem.remedy


def test_what_is_wrong_with_geometry_is_reported_with_its_place_in_the_scenario(tmp_path):
    (tmp_path / "half.stl").write_text("solid x\nfacet normal 0 0")
    (tmp_path / "lid.stl").write_text(
        "solid lid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 4 0 0\nvertex 0 4 0\nendloop\nendfacet\n"
        "endsolid lid\n"
    )

    def problems_with(file):
        spec = EnvironmentSpec.model_validate({"geometry": {"files": (file,)}})
        return find_source_problems(spec, WindSpec(), scenario_dir=tmp_path)

    (damaged,) = problems_with("half.stl")
    assert damaged.where == "environment.geometry.files"
    assert "half.stl: expected a whole stl file" in damaged.remedy
    assert {problem.where for problem in problems_with("lid.stl")} == {"environment.geometry.openings"}
