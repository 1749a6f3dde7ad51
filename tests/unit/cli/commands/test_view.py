"""`gslcosim view`"""

import sys
from types import ModuleType

import pytest

from gslcosim.base import extensions
from gslcosim.cli import arguments
from gslcosim.cli.main import main


@pytest.fixture
def viewer(monkeypatch):
    """The viewer replaced by one that keeps what it is asked for."""
    module = ModuleType("gslcosim.recordings.viewer")
    asked = []
    module.open_viewer = lambda path: asked.append(("open", path))
    module.screenshot = lambda path, png, *, window_size: asked.append(("screenshot", path, png, window_size))
    monkeypatch.setitem(sys.modules, "gslcosim.recordings.viewer", module)
    return asked


@pytest.fixture
def recording(tmp_path):
    """The recording of one run."""
    path = tmp_path / "runs" / "hall-1" / "recording.rrd"
    path.parent.mkdir(parents=True)
    path.touch()
    return path


def test_the_newest_run_is_opened(viewer, recording):
    assert main(["view", "--runs-dir", str(recording.parents[1])]) == 0
    assert viewer == [("open", recording)]


def test_a_run_or_a_recording_is_opened(viewer, recording):
    assert main(["view", str(recording.parent)]) == main(["view", str(recording)]) == 0
    assert viewer == [("open", recording)] * 2


def test_a_picture_is_written_in_the_wanted_size(viewer, recording, tmp_path, capsys):
    picture = tmp_path / "run.png"
    assert main(["view", str(recording), "--screenshot", str(picture), "--window-size", "800x600"]) == 0
    assert viewer == [("screenshot", recording, picture, (800, 600))]
    assert capsys.readouterr().out == f"{picture}\n"


def test_without_a_run_there_is_a_remedy(viewer, tmp_path, capsys):
    assert main(["view", "--runs-dir", str(tmp_path)]) == 2
    assert "Fly one: gslcosim up warehouse_empty" in capsys.readouterr().err


def test_more_than_a_run_is_refused_without_an_extension_that_shows_it(viewer, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(arguments, "load_options", lambda path: iter(()))
    monkeypatch.setattr(extensions, "list_registrations", tuple)
    (tmp_path / "environment.yaml").touch()
    for runs in (["a", "b"], [str(tmp_path)]):
        assert main(["view", *runs]) == 2
        assert "expected one run without an extension that shows more" in (text := capsys.readouterr().err)
        assert "It is in the extension data, which is not installed" in text
    assert viewer == []
