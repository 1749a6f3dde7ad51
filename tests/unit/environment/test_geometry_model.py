"""Rooms and environments: read-only arrays, and a hash that tells them apart."""

from dataclasses import replace

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import WindFrames, with_wind
from gslcosim.scenario.models.scenario import LayoutSpec, WindSpec

WIND = WindSpec(cell_m=0.5)
LAYOUT = LayoutSpec(size_m=(4.0, 3.0, 2.0))


def still_air(room, n_frames=1, **timing):
    return WindFrames(velocity_m_s=np.zeros((n_frames, *room.grid.shape, 3), dtype=np.float32), **timing)


def test_arrays_of_an_environment_cannot_be_written_to():
    room = build_layout(LAYOUT, WIND)
    environment = with_wind(room, still_air(room))
    for array in (environment.occupancy, environment.wind.velocity_m_s):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0, 0] = 1


def test_the_content_hash_is_the_same_for_the_same_and_differs_for_anything_else():
    room = build_layout(LAYOUT, WIND)
    wind = still_air(room)
    gust = wind.velocity_m_s.copy()
    gust[0, 1, 2, 3, 0] = 1e-6
    solid = room.occupancy.copy()
    solid[1, 1, 1] = 1
    variants = [
        with_wind(room, wind),
        with_wind(room, replace(wind, velocity_m_s=gust)),
        with_wind(room, still_air(room, n_frames=2)),
        with_wind(room, replace(wind, period_s=2.0)),
        with_wind(room, replace(wind, is_looping=False)),
        with_wind(replace(room, occupancy=solid), wind),
        with_wind(replace(room, name="other"), wind),
        with_wind(replace(room, boxes=room.boxes[1:]), wind),
        with_wind(replace(room, openings=room.openings[1:]), wind),
        with_wind(replace(room, grid=replace(room.grid, cell_m=0.25)), wind),
    ]
    assert len({environment.content_hash for environment in variants}) == len(variants)
    again = build_layout(LAYOUT, WIND)
    assert with_wind(again, still_air(again)).content_hash == variants[0].content_hash


def test_wind_of_another_shape_is_refused():
    room = build_layout(LAYOUT, WIND)
    for shape in ((1, 6, 8, 4, 3), (8, 6, 4, 3), (0, 8, 6, 4, 3)):
        with pytest.raises(EnvironmentDataError, match="expected"):
            with_wind(room, WindFrames(velocity_m_s=np.zeros(shape, dtype=np.float32)))
