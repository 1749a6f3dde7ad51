"""`gslcosim view` of more than a run as it was recorded."""

from gslcosim.cli.main import main


def test_the_folder_of_an_environment_is_shown_without_a_run(tmp_path, monkeypatch):
    """Its recording is there while it is looked at, and gone afterwards."""
    assert main(["environment", "generate", "tiny_room", "--out", str(tmp_path / "room")]) == 0
    sizes = []
    monkeypatch.setattr(
        "gslcosim.recordings.viewer.open_viewer", lambda path: sizes.append((path, path.stat().st_size))
    )
    assert main(["view", str(tmp_path / "room")]) == 0
    ((path, size),) = sizes
    assert size > 10_000
    assert not path.exists()
