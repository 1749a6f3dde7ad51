"""Wind of imported folders and of files, as generation takes it."""

import logging

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.generation.builder import generate_environment
from gslcosim.environment.generation.wind import no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Cell
from gslcosim.scenario.models.geometry import LayoutSpec
from gslcosim.scenario.models.scenario import EnvironmentSpec, WindSpec
from gslcosim_formats.export import export_environment

ROOM = EnvironmentSpec(layout=LayoutSpec(size_m=(3.0, 2.0, 2.0)))


def wind(**fields):
    return WindSpec(cell_m=0.25, **fields)


def made(spec, wind, scenario_dir=None):
    room = build_geometry(spec, wind, scenario_dir=scenario_dir)
    return room, solve_wind_of_scenario(room, spec, wind, scenario_dir=scenario_dir, progress=no_progress)


@pytest.fixture
def exported(tmp_path):
    def export(form, velocity_m_s=(0.5, -0.25, 0.125), **fields):
        spec = wind(solver="uniform", inlet_velocity_m_s=velocity_m_s)
        environment = generate_environment(ROOM, spec, tmp_path / "ours").environment
        export_environment(environment, tmp_path / form, form, **fields)
        return environment

    return export


@pytest.mark.parametrize("form", ["gaden", "gsl_bench"])
def test_an_imported_folder_brings_its_wind(exported, tmp_path, form):
    ours = exported(form)
    for solver in ("auto", "stored"):
        _, found = made(EnvironmentSpec(**{form: form}), wind(solver=solver), tmp_path)
        assert found.report is None
        assert found.frames.velocity_m_s.shape == ours.wind.velocity_m_s.shape
        np.testing.assert_allclose(found.frames.velocity_m_s, ours.wind.velocity_m_s, atol=1e-6)


def test_a_scenario_may_take_another_wind_for_an_imported_folder(exported, tmp_path):
    exported("gsl_bench")
    room, found = made(EnvironmentSpec(gsl_bench="gsl_bench"), wind(solver="uniform"), tmp_path)
    is_air = room.occupancy != Cell.SOLID
    assert (found.frames.velocity_m_s[0][is_air] == np.float32([1.0, 0.0, 0.0])).all()


def test_a_folder_without_wind_is_refused_where_its_wind_is_wanted(exported, tmp_path):
    exported("gsl_bench", velocity_m_s=(0.0, 0.0, 0.0))
    with pytest.raises(EnvironmentDataError, match=r"wind\.solver: expected an environment that brings its wind"):
        made(EnvironmentSpec(gsl_bench="gsl_bench"), wind(solver="stored"), tmp_path)


def test_wind_comes_from_a_file_with_its_gaps_reported(tmp_path, caplog):
    (tmp_path / "wind.csv").write_text('"U:0","U:1","U:2","Points:0","Points:1","Points:2"\n1,2,3,0.1,0.1,0.1\n')
    with caplog.at_level(logging.WARNING):
        _, found = made(ROOM, wind(solver={"file": "wind.csv"}), tmp_path)
    assert found.frames.velocity_m_s[0, 0, 0, 0].tolist() == [1.0, 2.0, 3.0]
    assert np.count_nonzero(found.frames.velocity_m_s.any(axis=-1)) == 1
    assert "767" in caplog.text
    assert found.notices
