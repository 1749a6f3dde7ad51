"""Whole runs that say what they are worth: an agent whose every command is refused, stored gas beside a solved wind."""

import os
from pathlib import Path

import pytest
import yaml

from gslcosim.cli.main import main
from gslcosim.scenario import load_scenario
from gslcosim.scenario.checks.registry import find_warnings
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values

REFERENCE_DIR = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[3] / "shared" / "reference"))
ROOM = REFERENCE_DIR / "gsl-bench" / "environments" / "001"
OUTSIDE = """from gslcosim.agent_kit import Agent, Command


class Outside(Agent):
    def __init__(self, briefing):
        pass

    def decide(self, observation):
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(400.0, 1.0, 1.0))
"""


def written(tmp_path, monkeypatch, **changes):
    """Write a short run of the smallest room, flown from its folder."""
    monkeypatch.chdir(tmp_path)
    values = plain_values(load_scenario("tiny_room").scenario) | changes
    values["recording"] = {"enabled": False}
    values["referee"]["stop"]["time_limit_s"] = 6.0
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(values))
    return values


def test_an_agent_whose_commands_are_all_refused_is_told_at_the_end(tmp_path, monkeypatch, capsys):
    values = written(tmp_path, monkeypatch)
    values["agents"][0]["start"] = {"python": "outside.py"}
    (tmp_path / "outside.py").write_text(OUTSIDE)
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(values))
    assert main(["up", "room.yaml", "--in-process"]) == 1
    text = capsys.readouterr().out
    assert "valid      with warnings" in text
    line = next(line for line in text.splitlines() if "warning  commands: The vehicle refused" in line)
    assert "the first because waypoint" in line
    assert "was 400" in line


@pytest.mark.skipif(not ROOM.is_dir(), reason=f"GSLCOSIM_REFERENCE: no GSL-Bench environment in {ROOM}")
@pytest.mark.parametrize(("solver", "n_warnings"), [("auto", 1), ("{file: wind.csv}", 0)])
def test_stored_gas_beside_a_solved_wind_is_told_before_the_run(tmp_path, monkeypatch, capsys, solver, n_warnings):
    frames = next((ROOM / "gas_data").iterdir())
    gas = {"model": "playback", "playback": {"folder": str(frames)}, "sources": [{"position_m": [5, 1, 2]}]}
    values = written(tmp_path, monkeypatch, gas=gas)
    values["environment"] = {"gsl_bench": str(ROOM)}
    values["agents"][0]["vehicle"]["start_m"] = [12, 12, 0.2]
    plan = Scenario.model_validate(values | {"wind": {"solver": yaml.safe_load(solver)}})
    warnings = find_warnings(plan, tmp_path)
    assert [warning.where for warning in warnings] == ["gas.playback.folder"] * n_warnings
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(values | {"wind": {}}))
    assert main(["validate", "room.yaml"]) == 0
    assert "Warning: gas.playback.folder: expected the wind in which this gas was" in capsys.readouterr().err


def costly_warnings(tmp_path, monkeypatch, *, size_m, cell_m, **wind):
    values = written(tmp_path, monkeypatch)
    values["environment"]["layout"]["size_m"] = size_m
    values["wind"] = {"solver": "built_in", "inlet_velocity_m_s": [0.5, 0, 0], "cell_m": cell_m, **wind}
    del values["gas"]["turbulence"]
    return find_warnings(Scenario.model_validate(values), tmp_path)


def test_wind_that_takes_long_is_told_before_it_is_solved(tmp_path, monkeypatch):
    assert costly_warnings(tmp_path, monkeypatch, size_m=[6, 5, 3], cell_m=0.25) == []
    (warning,) = costly_warnings(tmp_path, monkeypatch, size_m=[6, 5, 3], cell_m=0.25, end_time_s=400000.0)
    assert warning.where == "wind.cell_m"
    assert "0.25 m, 0.0 million cells: about 43 min on two cores and 0.1 GB of memory" in str(warning)
    larger = costly_warnings(tmp_path, monkeypatch, size_m=[60, 50, 3], cell_m=0.25, end_time_s=400000.0)
    assert "0.6 million cells: about 71 h" in str(larger[0])


def test_a_room_in_centimetres_is_told(tmp_path, monkeypatch):
    (unit,) = costly_warnings(tmp_path, monkeypatch, size_m=[600, 500, 300], cell_m=10.0)
    assert unit.where == "environment.layout.size_m"
    assert "was one of 600 m" in str(unit)
    assert "metres" in str(unit)
