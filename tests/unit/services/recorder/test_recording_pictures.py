"""Colours, slices, arrows and the eye show what they claim to show."""

import itertools
import math

import numpy as np
import pytest
from recording_content import still
from scripted_flight import scenario

from gslcosim.contract.messages import ConcentrationSlice, FilamentCloud
from gslcosim.contract.record import NumericArray
from gslcosim.environment.plan_view import MAX_LENGTH_SPACINGS
from gslcosim_services.recorder import blueprint
from gslcosim_services.recorder.colors import GasScale, gas_colors
from gslcosim_services.recorder.rows.columns import RecordingRows
from gslcosim_services.recorder.rows.events import ARROWS_PER_SIDE, WindLayer
from gslcosim_services.recorder.rows.gas import BIRTH_OPACITY, GasRows
from gslcosim_services.recorder.scene import slice_height_m


class Listener:
    """Takes the place of a file and keeps what it is sent, by component."""

    def __init__(self):
        self.sent = {}

    def draw(self, entity, *parts):
        """Ignore what stands still."""

    def send(self, entity, ticks, columns):
        """Keep the columns."""
        for column in columns:
            self.sent[column.component_descriptor().component] = column.as_arrow_array().to_pylist()


def _cloud(sigmas_m, slices=()):
    n = len(sigmas_m)
    return FilamentCloud(
        tick=0,
        gases=("ethanol",),
        position_world_m=NumericArray.from_array(np.zeros((n, 3), np.float32)),
        sigma_m=NumericArray.from_array(np.array(sigmas_m, np.float32)),
        gas_index=NumericArray.from_array(np.zeros(n, np.uint8)),
        slices=slices,
    )


def _sent(cloud):
    listener = Listener()
    rows = RecordingRows(listener)
    GasRows(rows, scenario()).add(0, cloud)
    rows.send()
    return listener.sent


def test_the_gas_scale_spans_three_powers_of_ten_and_saturates():
    scale = GasScale(max_ppm=10.0)
    assert scale.min_ppm == pytest.approx(0.01)
    levels = scale.levels(np.array([0.0, 0.01, 0.1, 1.0, 10.0, 1e6]))
    assert levels.tolist() == [0, 0, 85, 170, 255, 255]


def test_more_gas_is_never_darker():
    brightness = gas_colors().astype(float) @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(brightness) > -1.0)
    assert brightness[0] < 40 < 200 < brightness[-1]


def test_opacity_and_colour_of_a_filament_fall_with_its_size():
    """Opacity goes with (sigma0 / sigma)^2; centres of 10, 1.25 and 0.01 ppm have the scale's colours."""
    packed = np.array(_sent(_cloud([0.1, 0.2, 1.0]))["GaussianSplats3D:colors"][0], dtype=np.uint32)
    rgba = np.stack([(packed >> shift) & 0xFF for shift in (24, 16, 8, 0)], axis=-1)
    assert rgba[:, 3].tolist() == [int(BIRTH_OPACITY * 255), int(BIRTH_OPACITY * 255 / 4), 2]
    levels = GasScale(max_ppm=10.0).levels(np.array([10.0, 1.25, 0.01]))
    assert rgba[:, :3].tolist() == gas_colors()[levels].tolist()


def test_a_slice_is_drawn_with_north_up_and_east_right():
    ppm = np.zeros((4, 3), np.float32)
    ppm[3, 2] = 10.0
    ppm[0, 0] = 1.0
    layer = ConcentrationSlice(
        gas="ethanol",
        origin_m=(0.0, 0.0),
        cell_m=0.5,
        height_m=2.0,
        mixing_ratio_ppm=NumericArray.from_array(ppm),
    )
    picture = np.array(_sent(_cloud([0.1], (layer,)))["GridMap:data"][0][0], np.uint8).reshape(3, 4)
    assert picture.tolist() == [[0, 0, 0, 255], [0, 0, 0, 0], [170, 0, 0, 0]]


def test_arrows_point_with_the_wind_from_air_cells_of_the_layer_only(make_room):
    room = make_room(
        wind_m_s=((0.3, -0.4, 0.0),),
        obstacles=[("rack", (0.0, 0.0, 0.0), (5.0, 10.0, 3.0)), ("low", (6, 0, 0), (9, 9, 1))],
    )
    origins_m, vectors_m = WindLayer(room, 2.0).arrows_m(0)
    middles_m = origins_m + vectors_m / 2
    assert np.all(middles_m[:, 0] > 5.0)
    np.testing.assert_allclose(middles_m[:, 2], 2.125)
    np.testing.assert_allclose(
        vectors_m / np.linalg.norm(vectors_m, axis=1)[:, None], [[0.6, -0.8, 0.0]] * len(vectors_m)
    )
    n_arrows = len(WindLayer(make_room(), 2.0).arrows_m(0)[0])
    assert 0.5 * ARROWS_PER_SIDE**2 < n_arrows < ARROWS_PER_SIDE**2


def test_arrows_are_in_proportion_up_to_a_limit_and_still_air_has_none(make_room):
    room = make_room(wind_m_s=((0.1, 0.0, 0.0), (0.05, 0.0, 0.0), (0.1, 0.0, 0.0)))
    layer = WindLayer(room, 2.0)
    fast, slow = (np.linalg.norm(layer.arrows_m(frame)[1], axis=1) for frame in (0, 1))
    np.testing.assert_allclose(fast, 2 * slow, rtol=1e-6)
    assert np.all(fast <= MAX_LENGTH_SPACINGS * layer.spacing_m)
    assert not np.any(WindLayer(make_room(), 2.0).arrows_m(0)[1])


def test_the_eye_sees_every_corner_of_the_room_and_fills_its_view(make_room):
    """The camera's equations, independent of how its place was found: all corners inside, at least two at the rim."""
    room = make_room()
    eye_m, target_m = (np.array(point) for point in blueprint.fit_room_camera(room))
    forward = (target_m - eye_m) / np.linalg.norm(target_m - eye_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    corners_m = np.array(list(itertools.product(*zip(room.grid.origin_m, room.grid.max_m, strict=True)))) - eye_m
    half = math.tan(blueprint.FIELD_OF_VIEW_RAD / 2)
    height = corners_m @ up / (corners_m @ forward) / half
    width = corners_m @ right / (corners_m @ forward) / half / blueprint.ROOM_VIEW_ASPECT
    assert max(np.abs(height).max(), np.abs(width).max()) <= 1.0
    filled = max(np.ptp(height), np.ptp(width))
    assert filled > 1.9


def test_on_the_map_lies_what_reaches_its_height_and_the_edges_of_what_ends_below(make_room, record):
    obstacles = [("rack", (5, 4, 0), (6, 6, 3)), ("pallet", (2, 2, 0), (3, 3, 1)), ("lamp", (8, 8, 4), (9, 9, 5))]
    path = record(n_ticks=1, room=make_room(obstacles=obstacles))
    assert still(path, "/map/obstacles", "Boxes3D:labels") == ["rack"]
    assert still(path, "/map/below", "Boxes3D:labels") == ["pallet"]
    np.testing.assert_allclose(still(path, "/map/obstacles", "Boxes3D:half_sizes"), [[0.5, 1.0, 0.0]])
    (centre_m,) = still(path, "/map/obstacles", "Boxes3D:centers")
    assert centre_m[:2] == [5.5, 5.0]
    # Just above the slice, which lies below the height at which vehicles search.
    assert slice_height_m(2.0) < centre_m[2] < 2.0
