"""From pixels to a prior: colours, patches, the camera's geometry there and back, and what the prior must do."""

import io
import math

import numpy as np
import pytest
from PIL import Image

from gslcosim.base.frames import quaternion_from_rotation, rotation_from_rpy
from gslcosim.contract.messages import CameraImage
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.senses.vision import (
    SeenObject,
    SeenObjects,
    Viewpoint,
    classify_colours,
    decode_pixels,
    find_patches,
    floor_positions,
    labels,
    prior_from_objects,
    seen_objects,
)

GREY, BLUE, ORANGE = (115, 115, 120), (41, 69, 140), (158, 117, 77)
EYE_BODY_M = (0.1, 0.0, 0.05)
# Columns: right, down, ahead of the optical frame in the body's axes.
BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
GRID = CellGrid((0.0, 0.0), 0.25, (32, 24))
VIEW = Viewpoint(position_m=(3.0, 2.0, 1.2), yaw_rad=0.7)


def picture(pixels, *, pitch_rad=0.3, encoding="png"):
    """A picture of these pixels by a camera that is pitched down."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "PNG")
    height, width = len(pixels), len(pixels[0])
    rotation = rotation_from_rpy((0.0, pitch_rad, 0.0)) @ BODY_FROM_OPTICAL
    return CameraImage(
        encoding=encoding, width_px=width, height_px=height, focal_px=0.7 * height,
        centre_px=(width / 2, height / 2), position_body_m=EYE_BODY_M,
        quaternion_body_wxyz=quaternion_from_rotation(rotation), taken_tick=0, data=file.getvalue(),
    )  # fmt: skip


def plain(width=48, height=40, colour=GREY):
    return np.tile(np.array(colour, np.uint8), (height, width, 1))


def projected(image, view, place_m, pitch_rad=0.3):
    """Where a place appears in a picture, by transforms read from world to pixels."""
    c, s = math.cos(view.yaw_rad), math.sin(view.yaw_rad)
    world_from_body = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    body_m = world_from_body.T @ (np.array(place_m) - np.array(view.position_m))
    body_from_optical = rotation_from_rpy((0.0, pitch_rad, 0.0)) @ BODY_FROM_OPTICAL
    x, y, z = body_from_optical.T @ (body_m - np.array(EYE_BODY_M))
    return np.array([image.centre_px[0] + image.focal_px * x / z, image.centre_px[1] + image.focal_px * y / z])


@pytest.mark.parametrize("floor_m", [0.0, 0.4])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.4])
def test_what_is_projected_into_a_picture_comes_back(yaw_rad, floor_m):
    image, view = picture(plain()), Viewpoint(position_m=(3.0, 2.0, 1.2), yaw_rad=yaw_rad)
    for ahead_m, left_m in ((1.5, 0.3), (3.0, -0.8), (6.0, 0.0)):
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        place_m = (3.0 + c * ahead_m - s * left_m, 2.0 + s * ahead_m + c * left_m)
        point_px = projected(image, view, (*place_m, floor_m))
        assert floor_positions(image, view, point_px[None], floor_m=floor_m)[0] == pytest.approx(place_m)


def test_lines_of_sight_to_the_sky_meet_no_floor():
    image = picture(plain(), pitch_rad=0.0)
    assert np.isnan(floor_positions(image, VIEW, np.array([[24.0, 5.0], [24.0, 20.0]]))).all()


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((200, 10, 10), "red"), ((200, 10, 60), "red"), (ORANGE, "orange"), ((220, 200, 20), "yellow"),
        ((20, 160, 40), "green"), ((20, 160, 160), "cyan"), (BLUE, "blue"), ((120, 20, 160), "purple"),
    ],
)  # fmt: skip
def test_a_colour_has_its_name_however_bright_it_is_lit(rgb, name):
    for share in (1.0, 0.6, 0.3):
        dimmed = np.array([[[round(share * channel) for channel in rgb]]], np.uint8)
        assert labels()[int(classify_colours(dimmed)[0, 0])] == name


def test_grey_white_and_black_have_no_colour():
    for rgb in (GREY, (219, 219, 214), (255, 255, 255), (0, 0, 0), (3, 9, 2)):
        assert classify_colours(np.array([[rgb]], np.uint8))[0, 0] == -1


def test_patches_hang_together_and_small_ones_are_left_out():
    pixels = plain()
    pixels[5:10, 5:10] = BLUE
    pixels[10:14, 5:10] = ORANGE
    pixels[5:8, 30:40] = BLUE
    pixels[30, 30] = BLUE
    pixels[20:22, 5:10], pixels[22:24, 10:15] = BLUE, BLUE  # touch in a corner only
    found = [(label, int(mask.sum())) for label, mask in find_patches(classify_colours(pixels))]
    assert found == [("blue", 25), ("blue", 30), ("orange", 20), ("blue", 10), ("blue", 10)]


def drawn_box(pixels, image, view, corners_m, height_m, colour):
    """Draw the front of a box between two places on the floor, column by column."""
    low_px = [projected(image, view, (*corner_m, 0.0)) for corner_m in corners_m]
    high_px = [projected(image, view, (*corner_m, height_m)) for corner_m in corners_m]
    (u_0, _), (u_1, _) = sorted(px.tolist() for px in low_px)
    for u in range(math.ceil(u_0), math.floor(u_1)):
        share = (u + 0.5 - low_px[0][0]) / (low_px[1][0] - low_px[0][0])
        top, bottom = (pair[0][1] + share * (pair[1][1] - pair[0][1]) for pair in (high_px, low_px))
        pixels[max(0, round(top)) : round(bottom), u] = colour


def ahead(view, distance_m, left_m):
    c, s = math.cos(view.yaw_rad), math.sin(view.yaw_rad)
    return view.position_m[0] + c * distance_m - s * left_m, view.position_m[1] + s * distance_m + c * left_m


def test_a_box_is_found_where_it_stands():
    pixels = plain(160, 120)
    image = picture(pixels)
    corners_m = ahead(VIEW, 2.5, 0.4), ahead(VIEW, 2.5, -0.4)
    drawn_box(pixels, image, VIEW, corners_m, 0.8, BLUE)
    (found,) = seen_objects(picture(pixels), VIEW)
    assert found.label == "blue"
    assert found.centre_m == pytest.approx(ahead(VIEW, 2.5, 0.0), abs=0.08)
    assert found.range_m == pytest.approx(2.5, abs=0.1)
    width_m = math.dist(found.feet_m[0], found.feet_m[-1])
    assert width_m == pytest.approx(0.8, abs=0.1)


def test_a_foot_that_is_hidden_or_cut_off_shows_no_place():
    pixels = plain(160, 120)
    image = picture(pixels)
    drawn_box(pixels, image, VIEW, (ahead(VIEW, 5.0, 0.4), ahead(VIEW, 5.0, -0.4)), 2.0, BLUE)
    drawn_box(pixels, image, VIEW, (ahead(VIEW, 2.5, 0.6), ahead(VIEW, 2.5, -0.6)), 0.9, ORANGE)
    assert [thing.label for thing in seen_objects(picture(pixels), VIEW)] == ["orange"]
    below = plain(160, 120)
    below[60:, 40:80] = BLUE
    assert seen_objects(picture(below), VIEW) == []


def test_depths_are_no_colours():
    with pytest.raises(ValueError, match="depths"):
        decode_pixels(picture(plain(), encoding="depth_png"))


def thing(label, x_m, y_m, range_m=2.0):
    return SeenObject(label=label, feet_m=np.array([[x_m, y_m]]), range_m=range_m)


def test_a_thing_seen_twice_is_one_and_the_nearer_view_counts():
    seen = SeenObjects(merge_m=0.8)
    assert seen.add([thing("blue", 2.0, 2.0, 4.0), thing("orange", 2.1, 2.0, 4.0)])
    assert not seen.add([thing("blue", 2.3, 2.0, 5.0)])
    assert seen.add([thing("blue", 2.5, 2.0, 1.0)])
    assert [(known.label, known.centre_m[0]) for known in seen.things] == [("blue", 2.5), ("orange", 2.1)]
    assert seen.add([thing("blue", 6.0, 2.0, 3.0)])
    assert len(seen.things) == 3
    assert not seen.add([])


def test_beside_a_likely_thing_a_source_is_as_much_likelier_as_the_odds_say():
    centre_m = GRID.centre_m((8, 8))
    p = prior_from_objects(GRID, [thing("blue", *centre_m)], {"blue": 20.0}, spread_m=0.5)
    assert p.sum() == pytest.approx(1.0)
    assert p[8, 8] / p[30, 20] == pytest.approx(20.0, rel=1e-6)
    assert p[10, 8] / p[30, 20] == pytest.approx(1.0 + 19.0 * math.exp(-0.5), rel=1e-6)


def test_unlikely_things_lower_the_prior_and_two_views_of_one_do_not_raise_it():
    decoy = prior_from_objects(GRID, [thing("orange", 2.125, 2.125)], {"blue": 20.0}, other_odds=0.25)
    assert decoy[8, 8] / decoy[30, 20] == pytest.approx(0.25, rel=1e-6)
    once = prior_from_objects(GRID, [thing("blue", 2.0, 2.0)], {"blue": 20.0})
    twice = prior_from_objects(GRID, [thing("blue", 2.0, 2.0), thing("blue", 2.0, 2.0)], {"blue": 20.0})
    assert np.array_equal(once, twice)
