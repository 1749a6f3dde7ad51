"""Plumes in compiled code are those of arrays, to the last bit."""

import numpy as np
import pytest

from gslcosim.base.scalar_kernels import norm2
from gslcosim_formats.gaussian_plume import OPEN_COUNTRY, GaussianPlume
from gslcosim_training.batch.plume_kernels import PLUME_RECORD, steady_ppm_at


@pytest.mark.parametrize("has_ground", [True, False])
@pytest.mark.parametrize("stability", list(OPEN_COUNTRY))
def test_steady_plumes_are_equal_however_many_points_are_asked_for(stability, has_ground):
    plume = GaussianPlume(
        position_world_m=(1.0, 2.0, 1.5),
        release_m3_s=1e-6,
        wind_world_m_s=(0.7, -0.31, 0.2),
        stability=stability,
        has_ground=has_ground,
    )
    speed_m_s = norm2(0.7, -0.31)
    row = np.zeros((), PLUME_RECORD)
    row["position_world_m"], row["release_m3_s"], row["speed_m_s"] = plume.position_world_m, 1e-6, speed_m_s
    row["along"], row["spread"] = np.array([0.7, -0.31]) / speed_m_s, OPEN_COUNTRY[stability]
    row["has_ground"] = has_ground
    points_m = np.random.default_rng(0).uniform((0, 0, 0), (12, 9, 3), (400, 3))
    kernels_ppm = steady_ppm_at(row[()], points_m)
    assert (kernels_ppm > 0).sum() > 100
    assert np.array_equal(kernels_ppm, plume.mixing_ratio_ppm_at(points_m))
    one_by_one = [plume.mixing_ratio_ppm_at(points_m[i : i + 1])[0] for i in range(50)]
    assert np.array_equal(kernels_ppm[:50], one_by_one)
