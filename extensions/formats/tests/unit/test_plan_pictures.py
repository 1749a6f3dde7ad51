"""The picture from above, its scale, and the scene for MuJoCo: they show the room that there is."""

import io

import mujoco
import numpy as np
import pytest
from PIL import Image

from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.plan_view import PlanView
from gslcosim.scenario.models.geometry import LayoutSpec
from gslcosim.scenario.models.scenario import WindSpec
from gslcosim_formats import plan_pictures as picture
from gslcosim_formats.plan_pictures import PixelScale, top_view_png
from gslcosim_formats.scene_file import build_mjcf

CRATE = ("crate", (1.0, 1.0, 0.0), (5.0, 3.0, 2.0))


def pixels_of(png):
    return np.asarray(Image.open(io.BytesIO(png)))


def at(pixels, x_m, y_m, room):
    scale = picture.LONG_SIDE_PX / max(room.grid.max_m[:2])
    return tuple(
        pixels[round(pixels.shape[0] - picture.MARGIN_PX - y_m * scale), round(picture.MARGIN_PX + x_m * scale)]
    )


def test_x_is_to_the_right_and_y_is_up(make_room):
    room = make_room(obstacles=[CRATE])
    pixels = pixels_of(top_view_png(room, sources_m=[(13.0, 8.0, 1.0)]))
    assert pixels.shape[1] > pixels.shape[0]
    assert at(pixels, 3.0, 2.0, room) not in (picture.FLOOR, picture.SOURCE)
    assert at(pixels, 13.0, 8.0, room) == picture.SOURCE
    assert at(pixels, 13.0, 2.0, room) == picture.FLOOR


def test_wind_is_drawn_where_it_blows(make_room):
    still, windy = (pixels_of(top_view_png(make_room(wind_m_s=[wind]))) for wind in ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0)))
    assert not (still == picture.WIND).all(axis=-1).any()
    assert (windy == picture.WIND).all(axis=-1).sum() > 1000


def test_the_scene_has_each_box_with_its_name_and_place(make_room):
    room = make_room(obstacles=[CRATE])
    model = mujoco.MjModel.from_xml_string(build_mjcf(room))
    assert model.ngeom == len(room.boxes)
    crate = model.geom("crate")
    assert crate.pos == pytest.approx((3.0, 2.0, 1.0))
    assert crate.size == pytest.approx((2.0, 1.0, 1.0))


def test_lamps_are_named_in_the_scene():
    room = build_layout(LayoutSpec(size_m=(6.0, 5.0, 3.0), lights=(2, 1)), WindSpec(cell_m=0.5))
    model = mujoco.MjModel.from_xml_string(build_mjcf(room))
    assert [model.light(i).name for i in range(model.nlight)] == ["light_0_0", "light_1_0"]


@pytest.mark.parametrize("size_px", [(640, 480), (200, 900)])
def test_the_room_fills_the_picture_but_for_its_margin(make_room, size_px):
    plan = PlanView.of(make_room(), 1.0)
    scale = PixelScale.fit(plan, size_px, 20)
    x0, x1, y0, y1 = plan.extent_m
    (left, bottom), (right, upper) = scale.pixel((x0, y0)), scale.pixel((x1, y1))
    assert min(left, upper) == pytest.approx(20)
    assert left + right == pytest.approx(size_px[0])
    assert upper + bottom == pytest.approx(size_px[1])
    assert (right - left) / (x1 - x0) == pytest.approx((bottom - upper) / (y1 - y0))
    assert scale.corner_px == pytest.approx((left, upper), abs=1.0)
    assert scale.room_px == pytest.approx((right - left, bottom - upper), abs=0.5)
