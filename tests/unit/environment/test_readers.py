"""Keys of scenarios whose extension is not installed: one sentence says which it is, and how to install it."""

import pytest
import yaml

from gslcosim.base import extensions
from gslcosim.base.bundled import bundled_scenarios
from gslcosim.environment.positions import draw_positions
from gslcosim.environment.readers import list_reader_keys
from gslcosim.scenario.checks.registry import list_checks, list_scenario_checks
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.scenario import EnvironmentSpec, LayoutSpec, WindSpec
from gslcosim.scenario.problems import InvalidScenarioError

REMEDY = (
    "It is in the extension formats, which is not installed: pip install gslcosim-formats, "
    "or ./extensions/formats in a checkout"
)


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Load a scenario with changed blocks where no extension is installed."""
    kept = tuple(point for point in extensions.list_registrations() if point.distribution == "gslcosim")
    monkeypatch.setattr(extensions, "_read_entry_points", lambda folders: kept)
    (tmp_path / "folder").mkdir()
    (tmp_path / "lid.stl").touch()

    def read(**blocks):
        values = yaml.safe_load(bundled_scenarios()["tiny_room"].read_text())
        path = tmp_path / "scenario.yaml"
        path.write_text(yaml.safe_dump({**values, **blocks}))
        return load_scenario(str(path), checks=list_scenario_checks("room"), placer=draw_positions)

    list_checks.cache_clear()
    yield read
    list_checks.cache_clear()


@pytest.mark.parametrize(
    ("blocks", "where"),
    [
        ({"environment": {"gaden": "folder"}}, "environment.gaden"),
        ({"environment": {"gsl_bench": "folder"}}, "environment.gsl_bench"),
        ({"environment": {"geometry": {"files": ["lid.stl"]}}}, "environment.geometry"),
        ({"wind": {"solver": {"file": "wind.csv"}}}, "wind.solver.file"),
        ({"wind": {"solver": "openfoam", "end_time_s": 5.0}}, "wind.solver.openfoam"),
        (
            {"gas": {"model": "playback", "sources": [{"position_m": [1, 1, 1]}], "playback": {"folder": "folder"}}},
            "gas.model",
        ),
    ],
)
def test_a_key_of_an_absent_extension_is_answered_with_its_name(load, blocks, where):
    with pytest.raises(InvalidScenarioError) as refused:
        load(**blocks)
    (located,) = refused.value.problems
    assert (located.problem.where, located.problem.remedy.rstrip(".")) == (where, REMEDY)


def test_rooms_of_the_core_need_no_reader():
    for solver in ("auto", "built_in", "uniform"):
        assert list_reader_keys(EnvironmentSpec(layout=LayoutSpec()), WindSpec(solver=solver)) == []
    assert list_reader_keys(EnvironmentSpec(path="room"), WindSpec(solver="auto")) == []
