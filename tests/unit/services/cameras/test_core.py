"""Cameras against where things are: sizes and depths in pictures of a room with three different side lengths."""

import importlib
import io
import math
import os
import subprocess
import sys
from ctypes.util import find_library

import numpy as np
import pytest
from built_messages import build_body, build_poses
from PIL import Image

from gslcosim.base.errors import ModelError
from gslcosim.base.frames import world_from_body_rotation
from gslcosim.contract import codec
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import BodyPoses
from gslcosim.contract.participant import Episode
from gslcosim_services.cameras import offscreen_renderer
from gslcosim_services.cameras.core import CamerasCore

pytestmark = pytest.mark.debian
YAW_90 = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
RED = ("red_box", (8.0, 4.0, 2.0), (9.0, 6.0, 4.0))


@pytest.fixture
def cameras(make_room, make_scenario):
    """Build the cameras of one iris and give their driver's memory back afterwards; skipped where nothing can draw."""
    opened = []

    def build(*sensors, vehicles=({},), room=None):
        try:
            core = CamerasCore(make_scenario(*vehicles, sensors=sensors), room or make_room(obstacles=[RED]))
        except ModelError as error:
            pytest.skip(str(error))
        opened.append(core)
        core.reset(Episode(seed=0))
        return core

    yield build
    for core in opened:
        core.close()


def poses(*places, tick=0):
    bodies = (
        build_body(f"agent_{i}", position_m, quaternion_wxyz=quaternion)
        for i, (position_m, quaternion) in enumerate(places)
    )
    return {"truth/bodies": build_poses(tick, *bodies)}


def image_of(core, *places, i=0):
    return core.step(0, poses(*places))["truth/images"].frames[i].image


def pixels(image):
    return np.array(Image.open(io.BytesIO(image.data)))


def camera(name="eye", model="camera", **settings):
    size = {"width_px": 80, "height_px": 60, "vertical_fov_rad": 1.0, **settings.pop("camera", {})}
    return {"model": model, "name": name, "camera": size, **settings}


LEVEL = ((3.0, 5.0, 3.0), (1.0, 0.0, 0.0, 0.0))


def test_depths_are_those_of_the_boxes_along_the_optical_axis(cameras):
    image = image_of(cameras(camera(model="depth_camera")), LEVEL)
    depths_mm = pixels(image)
    assert (depths_mm.dtype, depths_mm.shape, image.encoding) == (np.uint16, (60, 80), "depth_png")
    assert int(depths_mm[30, 40]) == pytest.approx(5000, abs=2)
    assert int(depths_mm[30, 70]) == pytest.approx(5000 * image.focal_px / 30.5, abs=5)


def test_every_pixel_lies_where_its_calibration_says(cameras):
    eye = camera(model="depth_camera", mount_m=(0.1, 0.2, 0.3), mount_rpy_rad=(0.2, 0.1, -0.3))
    place = ((3.0, 5.0, 3.0), YAW_90)
    image = image_of(cameras(eye, vehicles=({},), room=None), place)
    depth_m = pixels(image) / 1000.0
    v, u = np.mgrid[0:60, 0:80] + 0.5
    rays = [(u - image.centre_px[0]) / image.focal_px, (v - image.centre_px[1]) / image.focal_px, np.ones_like(u)]
    points_optical_m = np.stack(rays, axis=-1) * depth_m[..., None]
    body_from_optical = world_from_body_rotation(image.quaternion_body_wxyz)
    points_body_m = points_optical_m @ body_from_optical.T + image.position_body_m
    points_m = points_body_m @ world_from_body_rotation(YAW_90).T + place[0]
    gaps_m = np.minimum(np.abs(points_m), np.abs(np.array([15.0, 10.0, 6.0]) - points_m)).min(axis=-1)
    assert np.quantile(gaps_m, 0.99) < 0.01


def test_nothing_in_range_is_zero(cameras):
    depths_mm = pixels(image_of(cameras(camera(model="depth_camera", max_range_m=6.0)), LEVEL))
    assert int(depths_mm[30, 40]) == pytest.approx(5000, abs=2)
    assert depths_mm[30, 70] == 0


def test_another_vehicle_is_seen_and_its_own_is_not(cameras):
    core = cameras(camera(model="depth_camera", mount_m=(0.2, 0.0, 0.0)), vehicles=({}, {}))
    alone = pixels(image_of(core, LEVEL, ((14.0, 9.0, 5.0), LEVEL[1])))
    met = pixels(image_of(core, LEVEL, ((5.0, 5.0, 3.0), LEVEL[1])))
    assert int(alone[30, 40]) == pytest.approx(4800, abs=2)
    assert int(met[30, 40]) == pytest.approx(1000 * (2.0 - 0.258 - 0.2), abs=5)


@pytest.mark.parametrize(("encoding", "format_name"), [("png", "PNG"), ("jpeg", "JPEG")])
def test_colours_travel_compressed(cameras, encoding, format_name):
    image = image_of(cameras(camera(camera={"encoding": encoding})), LEVEL)
    picture = Image.open(io.BytesIO(image.data))
    assert (picture.format, picture.size, picture.mode) == (format_name, (80, 60), "RGB")
    assert np.ptp(np.array(picture), axis=(0, 1)).max() > 20


def test_pictures_come_at_their_rate(cameras):
    core = cameras(camera(period_s=0.2), camera("depth", model="depth_camera", period_s=0.3))
    seen = [[f.sensor for f in core.step(t, poses(LEVEL, tick=t))["truth/images"].frames] for t in range(5)]
    assert seen == [["eye", "depth"], [], ["eye"], ["depth"], ["eye"]]


def test_pictures_are_the_same_to_the_bit_from_a_new_scene(cameras):
    first, second = (cameras(camera(), camera("depth", model="depth_camera")) for _ in range(2))
    places = [((3.0 + 0.1 * i, 5.0, 3.0), YAW_90) for i in range(3)]
    payloads = [
        [codec.encode(core.step(0, poses(place))["truth/images"]) for place in places] for core in (first, second)
    ]
    assert payloads[0] == payloads[1]
    assert len(set(payloads[0])) == 3


def test_where_nothing_can_draw_it_says_what_to_install(monkeypatch, make_room, make_scenario):
    monkeypatch.setattr(offscreen_renderer.importlib, "import_module", _fails)
    with pytest.raises(ModelError) as refusal:
        CamerasCore(make_scenario(sensors=[camera()]), make_room())
    assert str(refusal.value) == (
        "cameras: expected EGL or OSMesa to draw with, was none (egl: no mujoco.egl; osmesa: no mujoco.osmesa). "
        "On Debian: sudo apt-get install libegl1 libgl1-mesa-dri, or libosmesa6."
    )


def _fails(name, package=None, real=importlib.import_module):
    if name.startswith("mujoco."):
        raise ImportError(f"no {name}")
    return real(name, package)


# One box's upper face 2 m below a camera that looks down: which way was taken, and the depth in the middle.
ALONE = """
import mujoco
from gslcosim_services.cameras.offscreen_renderer import OffscreenRenderer
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><geom type='box' size='9 9 1' pos='0 0 -3'/><camera/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
view = OffscreenRenderer(model, 64, 48)
print(type(view._gl).__module__, round(view.depths_m(data, 0, 64, 48)[24, 32], 3))
view.close()
"""
NO_DRIVER = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("renderer", "environment"),
    [("egl", {}), ("osmesa", {"MUJOCO_GL": "osmesa"}), ("osmesa", NO_DRIVER)],
    ids=["egl", "osmesa_by_choice", "osmesa_where_egl_fails"],
)
def test_either_way_to_draw_works_alone(renderer, environment):
    """In processes of their own: a process keeps to the first way that it has found."""
    if find_library("EGL" if renderer == "egl" else "OSMesa") is None:
        pytest.skip(f"no library for {renderer}")
    kept = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    call = [sys.executable, "-W", "error", "-c", ALONE]
    done = subprocess.run(call, env=kept | environment, capture_output=True, text=True, check=False)
    assert done.stdout.split() == [f"mujoco.{renderer}", "2.0"], done.stderr


def test_a_door_is_seen_while_it_is_closed(room_with_gate):
    eye = "agents[0].sensors=[{model: depth_camera, name: eye, max_range_m: 9}]"
    moves = ("{what: door_opens, at_s: 10, door: gate}", "{what: door_closes, at_s: 20, door: gate}")
    try:
        core = CamerasCore(*room_with_gate(*moves, changes=[eye]))
    except ModelError as error:
        pytest.skip(str(error))
    core.reset(Episode(seed=0))
    seen_mm = []
    for tick, events in enumerate([(), (0,), (), (1,)]):
        at_rest = poses(((1.5, 2.0, 1.0), (1.0, 0.0, 0.0, 0.0)), tick=tick)["truth/bodies"].bodies[0]
        bodies = BodyPoses(tick=tick, bodies=(at_rest.model_copy(update={"agent": "beetle"}),))
        inbox = {"truth/bodies": bodies, EVENTS: EventsBeginning(tick=max(0, tick - 1), beginning=events)}
        depths_mm = pixels(core.step(tick, inbox)["truth/images"].frames[0].image)
        seen_mm.append(int(depths_mm[depths_mm.shape[0] // 2, depths_mm.shape[1] // 2]))
    core.close()
    assert seen_mm == pytest.approx([1500, 4500, 4500, 1500], abs=5)
