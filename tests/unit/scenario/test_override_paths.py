"""Paths given by `--set` start at the working directory, those in a file at the file's folder."""

from pathlib import Path

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.overrides import make_paths_absolute

HERE = Path("/here")


@pytest.mark.parametrize(
    ("path", "value", "made"),
    [
        ("agents[0].start", {"python": "mine.py"}, {"python": "/here/mine.py"}),
        ("agents[1].start.python", "agents/mine", "/here/agents/mine"),
        ("agents", [{"start": {"python": "mine.py"}}], [{"start": {"python": "/here/mine.py"}}]),
        ("agents[0].start.command", ["./mine", "x.txt"], ["/here/mine", "x.txt"]),
        ("agents[0].start", {"command": ["sh", "mine.sh", "a.sh"]}, {"command": ["sh", "/here/mine.sh", "a.sh"]}),
        ("environment", {"path": "hall"}, {"path": "/here/hall"}),
        ("environment.geometry.files", ["a.stl", "/b.stl"], ["/here/a.stl", "/b.stl"]),
        ("wind.solver", {"file": "U.csv"}, {"file": "/here/U.csv"}),
        ("gas.playback.folder", "frames", "/here/frames"),
    ],
)  # fmt: skip
def test_relative_paths_start_at_the_directory(path, value, made):
    assert make_paths_absolute(path, value, HERE) == made


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("agents[0].start.python", "e_coli"),
        ("agents[0].start.command", ["python3", "-m", "mine"]),
        ("agents[0].start.command[0]", "node"),
        ("agents[0].name", "a/b.py"),
        ("name", "mine.py"),
        ("gas.sources[0].position_m", [1.0, 2.0, 3.0]),
        ("environment.path", None),
    ],
)
def test_other_values_stay(path, value):
    assert make_paths_absolute(path, value, HERE) == value


def test_an_agent_beside_the_user_runs_a_scenario_that_is_elsewhere(scenario_file, tmp_path, monkeypatch):
    (tmp_path / "user").mkdir()
    monkeypatch.chdir(tmp_path / "user")
    Path("mine.py").write_text("")
    start = load_scenario(scenario_file(), overrides=["agents[0].start={python: mine.py}"]).scenario.agents[0].start
    assert start.python == str(tmp_path / "user" / "mine.py")


def test_a_missing_file_is_reported_where_it_was_looked_for(scenario_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError, match=rf"There is no {tmp_path}/mine.py"):
        load_scenario(scenario_file(), overrides=["agents[0].start={python: mine.py}"])
