"""A recording is drawn without a screen, and what is missing for it is named."""

import contextlib
import json
import struct
import subprocess
import sys

import psutil
import pytest
from deadlines import EVENT_S
from PIL import Image

from gslcosim.base.errors import RecordingError
from gslcosim.base.processes import build_parent_death_prefix
from gslcosim.recordings import viewer
from gslcosim.recordings.viewer import open_viewer, screenshot


@pytest.fixture(scope="module")
def vulkan():
    """Skip where nothing can draw."""
    probe = subprocess.run(
        [sys.executable, "-m", "gslcosim.cli.rendering_probe"], capture_output=True, text=True, check=False
    )
    if probe.returncode != 0 or not json.loads(probe.stdout)["vulkan"]["is_there"]:
        pytest.skip("no Vulkan driver (on Debian: mesa-vulkan-drivers)")


def test_without_a_screen_the_remedy_is_reported(record, monkeypatch):
    path = record()
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RecordingError, match=r"expected a screen, was none.*--web.*--screenshot"):
        open_viewer(path)


@pytest.mark.parametrize("show", [open_viewer, lambda path: screenshot(path, path.with_suffix(".png"))])
def test_a_missing_recording_is_named(tmp_path, show):
    with pytest.raises(RecordingError, match=r"expected a file, was none\.\nFile: .*nothing\.rrd"):
        show(tmp_path / "nothing.rrd")


@pytest.mark.slow
@pytest.mark.usefixtures("vulkan")
@pytest.mark.debian
def test_a_picture_has_the_asked_size(record, tmp_path):
    png = tmp_path / "picture.png"
    screenshot(record(), png, window_size=(800, 500))
    header = png.read_bytes()[:24]
    assert header[1:4] == b"PNG"
    assert struct.unpack(">II", header[16:]) == (800, 500)


@pytest.mark.slow
def test_without_a_driver_the_package_to_install_is_named(record, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "none.json"))
    png = tmp_path / "picture.png"
    png.write_bytes(b"an older picture")
    with pytest.raises(RecordingError, match="mesa-vulkan-drivers"):
        screenshot(record(), png, window_size=(400, 300))
    assert not png.exists()


def _busy_viewer(folder, *, n_failures, word):
    """Write a program that does not end the first times it is called and then draws; it notes the sizes asked for."""
    calls, picture = folder / "calls", folder / "drawn.png"
    Image.new("RGB", (3200, 2000), "red").save(picture)
    program = folder / "viewer"
    # The picture's path and the size are arguments behind their options.
    program.write_text(
        f"""#!/bin/sh
while [ "$1" != --screenshot-to ]; do shift; done
echo "$4" >> '{calls}'
if [ "$(wc -l < '{calls}')" -le {n_failures} ]; then echo '{word}' >&2; exec sleep 60; fi
cat '{picture}' > "$2"
"""
    )
    program.chmod(0o755)
    return program, calls


@pytest.mark.slow
@pytest.mark.parametrize("word", ["", "Failed to render screenshot: the requested wait timed out"])
def test_a_viewer_that_does_not_draw_is_started_again_with_a_smaller_window(record, tmp_path, monkeypatch, word):
    path, png = record(n_ticks=1), tmp_path / "picture.png"
    program, calls = _busy_viewer(tmp_path, n_failures=2, word=word)
    monkeypatch.setattr(viewer, "rerun_program", lambda: program)
    # A viewer without a word is known by its time: a shell draws at once on the busiest machine.
    monkeypatch.setattr(viewer, "SCREENSHOT_TIMEOUT_S", EVENT_S if word else 5.0)
    screenshot(path, png)
    assert calls.read_text().split() == ["1600x1000", "800x500", "800x500"]
    with Image.open(png) as picture:
        assert picture.size == (1600, 1000)
        assert picture.getpixel((800, 500)) == (255, 0, 0)


@pytest.mark.slow
def test_a_viewer_that_never_draws_is_refused_with_a_remedy(record, tmp_path, monkeypatch):
    path, png = record(n_ticks=1), tmp_path / "picture.png"
    program, _ = _busy_viewer(tmp_path, n_failures=9, word="Failed to render")
    monkeypatch.setattr(viewer, "rerun_program", lambda: program)
    with pytest.raises(RecordingError, match=r"was still drawing in 3 tries.*--window-size"):
        screenshot(path, png)
    assert not png.exists()


@pytest.mark.slow
@pytest.mark.skipif(not build_parent_death_prefix(), reason="setpriv tells Linux to end it")
@pytest.mark.usefixtures("vulkan")
def test_a_command_that_is_killed_leaves_no_renderer(record, tmp_path):
    call = [sys.executable, "-m", "gslcosim", "view", str(record()), "--screenshot", str(tmp_path / "picture.png")]
    with subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as command:
        process = psutil.Process(command.pid)
        renderers: list[psutil.Process] = []
        while not renderers and command.poll() is None:
            with contextlib.suppress(psutil.Error):
                renderers = [each for each in process.children() if "--screenshot-to" in each.cmdline()]
        command.kill()
    assert renderers
    assert not psutil.wait_procs(renderers, timeout=EVENT_S)[1]
