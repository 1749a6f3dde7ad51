import math

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_search.learned.encoding import amount, find_frame_problem, scaled_speed, turn_actions
from gslcosim_search.learned.wind_frame import N_WIND_FRAME, WIND_FRAME_NAMES, WindFrame, find_columns

PLANAR = ("x", "y", "vx", "vy", "time", "nose_ppm.amount", "wind.speed", "wind.from_sin", "wind.from_cos")
SPATIAL = (*PLANAR[:6], "wind.x", "wind.y", "wind.z")
HALF_M, LIMIT_S = (5.0, 4.0), 100.0


class Searcher:
    """Flies a wind frame through true winds, places and mixing ratios."""

    def __init__(self, names=PLANAR):
        self.is_planar = names is PLANAR
        self.frame = WindFrame(names, half_x_m=HALF_M[0], half_y_m=HALF_M[1], time_limit_s=LIMIT_S)

    def see(self, *, time_s, wind_m_s=(0.8, 0.0), place_m=(0.0, 0.0), velocity_m_s=(0.0, 0.0), ppm=0.0):
        apparent = np.subtract(wind_m_s, velocity_m_s)
        if self.is_planar:
            from_rad = math.atan2(-apparent[1], -apparent[0])
            wind = [scaled_speed(math.hypot(*apparent)), math.sin(from_rad), math.cos(from_rad)]
        else:
            wind = [scaled_speed(apparent[0]), scaled_speed(apparent[1]), 0.0]
        numbers = np.zeros(len(PLANAR) + N_WIND_FRAME, np.float32)
        numbers[: len(PLANAR)] = [
            place_m[0] / HALF_M[0], place_m[1] / HALF_M[1], *map(scaled_speed, velocity_m_s), time_s / LIMIT_S,
            amount(ppm), *wind,
        ]  # fmt: skip
        self.frame.advance(numbers)
        return dict(zip(WIND_FRAME_NAMES, numbers[len(PLANAR) :].tolist(), strict=True))


@pytest.mark.parametrize("names", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_the_wind_is_that_of_the_air_whatever_the_vehicle_flies(names):
    seen = Searcher(names).see(time_s=0.0, wind_m_s=(0.0, 0.6), velocity_m_s=(1.0, -0.5))
    assert (seen["wind_frame.upwind_sin"], seen["wind_frame.upwind_cos"]) == pytest.approx((-1.0, 0.0), abs=1e-4)
    assert seen["wind_frame.speed"] == pytest.approx(scaled_speed(0.6), abs=1e-4)
    # Upwind is down on a map, so the vehicle flies upwind at 0.5 m/s, and to the left (east) at 1 m/s.
    assert seen["wind_frame.v_upwind"] == pytest.approx(scaled_speed(0.5), abs=1e-4)
    assert seen["wind_frame.v_left"] == pytest.approx(scaled_speed(1.0), abs=1e-4)


def test_what_is_seen_does_not_depend_on_where_the_wind_comes_from():
    turned = []
    for rad in (0.0, 0.7, 2.9):
        cos, sin, searcher = math.cos(rad), math.sin(rad), Searcher()

        def turn(x, y, cos=cos, sin=sin):
            return (cos * x - sin * y, sin * x + cos * y)

        for i in range(6):
            seen = searcher.see(
                time_s=float(i), wind_m_s=turn(0.7, 0.1 * i), place_m=turn(0.3 * i, 0.1 * i),
                velocity_m_s=turn(0.3, 0.1), ppm=2.0 if i == 2 else 0.0,
            )  # fmt: skip
        turned.append([seen[name] for name in WIND_FRAME_NAMES[2:]])
    np.testing.assert_allclose(turned[1:], [turned[0]] * 2, atol=1e-5)


def test_bouts_are_counted_and_remembered_where_and_when_they_were():
    searcher = Searcher()
    seen = searcher.see(time_s=0.0)
    assert [seen[name] for name in WIND_FRAME_NAMES[5:]] == [0.0] * 5
    for time_s, ppm in ((1.0, 1.0), (2.0, 5.0), (3.0, 0.15), (4.0, 0.0)):
        seen = searcher.see(time_s=time_s, ppm=ppm, place_m=(0.0, 1.0))
    assert seen["bouts.count"] == pytest.approx(1 / 4)
    assert seen["bouts.amplitude"] == pytest.approx(amount(5.0))
    # Last gas after 3 s: 0.15 ppm ends no bout, and would begin none.
    seen = searcher.see(time_s=13.0, place_m=(1.0, 0.0), ppm=0.15)
    assert seen["bouts.since"] == pytest.approx(0.5, abs=1e-4)
    # Upwind is west: the gas was 1 m upwind, and 1 m north, which is to the right.
    assert (seen["bouts.upwind"], seen["bouts.left"]) == pytest.approx((1 / 3, -1 / 3), abs=1e-4)
    assert searcher.see(time_s=14.0, ppm=3.0)["bouts.count"] == pytest.approx(2 / 5)


@pytest.mark.parametrize(
    ("names", "what"), [(PLANAR[:5] + PLANAR[6:], "a sensor of a mixing ratio"), (PLANAR[:6], "an anemometer")]
)
def test_what_is_missing_is_named(names, what):
    with pytest.raises(UsageError, match=f"wind_frame: expected {what} among the sensors, found none"):
        find_columns(names)


def test_actions_are_turned_from_the_wind_frame():
    turned = turn_actions(np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.3]], np.float32), [(0.0, -1.0), (0.0, -1.0)])
    np.testing.assert_allclose(turned, [[0.0, -1.0, 0.3], [1.0, 0.0, 0.3]], atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "frame", "words"),
    [
        ("velocity", "wind", None),
        ("heading", "world", None),
        ("heading", "wind", "expected world for heading, was wind"),
        ("velocity", "sea", "expected one of world, wind, was 'sea'"),
    ],
)
def test_frames_fit_kinds_of_actions(kind, frame, words):
    found = find_frame_problem(kind, frame)
    assert found is None if words is None else found is not None and found.startswith(words)
