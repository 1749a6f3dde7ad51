import math
from typing import Any

import numpy as np
import pytest
from built_messages import build_sample
from surroundings import make_sensor


def read(wind, velocity=(0.0, 0.0, 0.0), *, speed_noise=0.0, direction_noise=0.0, n=1) -> Any:
    anemometer = make_sensor("anemometer", speed_noise_std_m_s=speed_noise, direction_noise_std_rad=direction_noise)
    truth = build_sample("a", "wind", wind_m_s=wind)
    readings = [anemometer.read(truth, velocity).values for _ in range(n)]
    return readings[0] if n == 1 else np.array(readings)


@pytest.mark.parametrize(
    ("wind", "comes_from_rad"),
    [
        ((1.0, 0.0, 0.0), math.pi),
        ((-1.0, 0.0, 0.0), 0.0),
        ((0.0, 1.0, 0.0), -math.pi / 2),
        ((0.0, -1.0, 0.0), math.pi / 2),
        ((-1.0, -1.0, 0.0), math.pi / 4),
    ],
)
def test_direction_is_where_the_wind_comes_from(wind, comes_from_rad):
    speed_m_s, direction_rad = read(wind)
    assert speed_m_s == pytest.approx(math.hypot(*wind))
    assert direction_rad == pytest.approx(comes_from_rad)


def test_a_vehicle_feels_its_own_motion():
    assert read((0.0, 0.0, 0.0), (0.0, 2.0, 0.0)) == pytest.approx((2.0, math.pi / 2))
    assert read((1.0, 0.5, 0.0), (1.0, 0.5, 0.0)) == (0.0, 0.0)


def test_vertical_wind_is_not_felt():
    assert read((0.0, 0.0, 3.0), (0.0, 0.0, -1.0)) == (0.0, 0.0)


def test_noise_has_its_spread_and_speed_is_never_negative():
    values = read((-2.0, 0.0, 0.0), speed_noise=0.2, direction_noise=0.1, n=4000)
    assert values.mean(0) == pytest.approx([2.0, 0.0], abs=0.02)
    assert values.std(0) == pytest.approx([0.2, 0.1], rel=0.05)
    assert read((0.0, 0.0, 0.0), speed_noise=0.2, n=200)[:, 0].min() == 0.0


def test_directions_stay_in_the_half_open_circle():
    directions = read((1.0, 0.0, 0.0), direction_noise=2.0, n=2000)[:, 1]
    assert directions.min() > -math.pi
    assert directions.max() <= math.pi
    assert abs(directions).max() > 3.0


def test_three_axes_give_the_whole_apparent_wind():
    truth = build_sample("a", "wind", wind_m_s=(1.0, -0.5, 0.2))
    reading = make_sensor("anemometer_3d", speed_noise_std_m_s=0.0).read(truth, (0.5, 0.0, 0.3))
    assert reading.values == pytest.approx((0.5, -0.5, -0.1))


def test_each_axis_has_its_own_noise():
    truth = build_sample("a", "wind", wind_m_s=(0.0, 0.0, 0.0))
    anemometer = make_sensor("anemometer_3d", speed_noise_std_m_s=0.2)
    values = np.array([anemometer.read(truth, (0.0, 0.0, 0.0)).values for _ in range(3000)])
    assert values.std(0) == pytest.approx([0.2] * 3, rel=0.06)
    assert abs(np.corrcoef(values.T) - np.eye(3)).max() < 0.08
