"""A method that notes its state in a whole run: the notes come back as arrays, and the run is otherwise the same."""

import json

import numpy as np
import yaml

from gslcosim.cli.main import main
from gslcosim.scenario import load_scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_data import open_run

AGENT = """from gslcosim.agent_kit import Agent, Command, Note


class Noting(Agent):
    def __init__(self, briefing):
        self._n = 0

    def decide(self, observation):
        self._n += 1
        note = Note(mode=f"leg {self._n}", values={"n": float(self._n)}) if NOTES else None
        return Command(tick=observation.tick, kind="hold", hold_s=1.0, note=note)
"""


def fly(folder, monkeypatch, capsys, *, notes):
    """Fly the agent for some seconds and return its run."""
    folder.mkdir()
    monkeypatch.chdir(folder)
    values = plain_values(load_scenario("tiny_room").scenario)
    values["agents"][0]["start"] = {"python": "noting.py"}
    values["referee"]["stop"]["time_limit_s"] = 5.0
    (folder / "noting.py").write_text(AGENT.replace("NOTES", str(notes)))
    (folder / "room.yaml").write_text(yaml.safe_dump(values))
    assert main(["up", "room.yaml", "--in-process", "--json"]) == 1
    return json.loads(capsys.readouterr().out), open_run(next((folder / "runs").iterdir()))


def test_notes_come_back_and_change_nothing_but_the_commands(tmp_path, monkeypatch, capsys):
    result, run = fly(tmp_path / "with", monkeypatch, capsys, notes=True)
    (notes,) = run.notes.values()
    assert notes.mode[:2] == ("leg 1", "leg 2")
    np.testing.assert_array_equal(notes.values["n"], np.arange(1.0, len(notes.tick) + 1))
    bare_result, bare = fly(tmp_path / "without", monkeypatch, capsys, notes=False)
    assert bare.notes == {}
    assert bare_result["agents"] == result["agents"]
    assert bare_result["digest"] != result["digest"]
    (name,) = run.tracks
    np.testing.assert_array_equal(bare.tracks[name].position_world_m, run.tracks[name].position_world_m)
