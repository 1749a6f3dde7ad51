"""A recording is drawn without a screen, and what is missing for it is named."""

import json
import struct
import subprocess
import sys

import pytest

from gslcosim.errors import RecordingError
from gslcosim.recording.viewer import open_viewer, screenshot


@pytest.fixture(scope="module")
def vulkan():
    """Skip where nothing can draw."""
    probe = subprocess.run(
        [sys.executable, "-m", "gslcosim.cli.rendering_probe"], capture_output=True, text=True, check=False
    )
    if probe.returncode != 0 or not json.loads(probe.stdout)["vulkan"]["is_there"]:
        pytest.skip("no Vulkan driver (on Debian: mesa-vulkan-drivers)")


def test_without_a_screen_the_remedy_is_told(record, monkeypatch):
    path = record()
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RecordingError, match=r"expected a screen, was none.*--screenshot"):
        open_viewer(path)


@pytest.mark.parametrize("show", [open_viewer, lambda path: screenshot(path, path.with_suffix(".png"))])
def test_a_missing_recording_is_named(tmp_path, show):
    with pytest.raises(RecordingError, match=r"expected a file, was none\.\nFile: .*nothing\.rrd"):
        show(tmp_path / "nothing.rrd")


@pytest.mark.slow
@pytest.mark.usefixtures("vulkan")
def test_a_picture_has_the_asked_size(record, tmp_path):
    png = tmp_path / "picture.png"
    screenshot(record(), png, window_size=(800, 500))
    header = png.read_bytes()[:24]
    assert header[1:4] == b"PNG"
    assert struct.unpack(">II", header[16:]) == (1600, 1000)


@pytest.mark.slow
def test_without_a_driver_the_package_to_install_is_named(record, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "none.json"))
    png = tmp_path / "picture.png"
    png.write_bytes(b"an older picture")
    with pytest.raises(RecordingError, match="mesa-vulkan-drivers"):
        screenshot(record(), png, window_size=(400, 300))
    assert not png.exists()
