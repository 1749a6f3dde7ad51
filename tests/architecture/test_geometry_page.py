"""The page on rooms from the user's own geometry does what it says."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from gslcosim.cli.main import main
from gslcosim.environment.store import load_environment
from gslcosim_formats.scenario_keys import GeometrySpec

PAGE = Path(__file__).parents[2] / "docs" / "own-geometry.md"


def block(language):
    return re.search(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


@pytest.mark.slow
def test_the_calls_make_a_room_equal_to_the_one_that_was_exported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_room.yaml").write_text(block("yaml"))
    *calls, view = [shlex.split(call)[1:] for call in block("").splitlines()]
    for call in calls:
        assert main(call) == 0, capsys.readouterr().err
    assert view == ["view", "my_room", "--screenshot", "my_room.png"]
    original, own = load_environment(Path("tunnel")), load_environment(Path("my_room"), with_meshes=True)
    np.testing.assert_array_equal(own.occupancy, original.occupancy)
    assert [(opening.name, opening.kind) for opening in own.openings] == [("fan", "inlet"), ("grille", "outlet")]
    assert own.meshes
    assert own.wind.velocity_m_s[0, :, 5, 8, 0].mean() > 0.5


def test_every_key_is_explained():
    assert re.findall(r"^\| `(\w+)` \|", PAGE.read_text(), re.MULTILINE) == list(GeometrySpec.model_fields)
