"""The picture from above, and the scene for MuJoCo: both show the room that there is."""

import io

import mujoco
import numpy as np
import pytest
from PIL import Image

from gslcosim.environment import picture
from gslcosim.environment.picture import top_view_png
from gslcosim.environment.scene_file import build_mjcf

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
