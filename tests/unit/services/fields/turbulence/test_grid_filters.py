"""Nearest cells and Gaussian means are those of scipy, to the bit."""

import numpy as np
import pytest
from scipy import ndimage

from gslcosim_services.fields.turbulence.grid_filters import distance_to, find_nearest, smooth_gaussian


@pytest.fixture(params=range(20))
def random(request):
    return np.random.default_rng(request.param)


@pytest.fixture
def mask(random):
    shape = tuple(random.integers(1, 14, 3))
    mask = random.random(shape) < random.choice([0.005, 0.05, 0.5])
    mask[tuple(random.integers(0, n) for n in shape)] = True
    return mask


def test_the_nearest_cell_is_that_of_scipy_where_several_are_as_near(mask):
    expected = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    np.testing.assert_array_equal(find_nearest(mask), expected)


def test_distances_are_those_of_scipy(mask):
    np.testing.assert_array_equal(distance_to(mask), ndimage.distance_transform_edt(~mask))


def test_gaussian_means_are_those_of_scipy(random):
    values, width = random.normal(size=tuple(random.integers(1, 14, 3))), random.uniform(0.1, 6.0)
    expected = ndimage.gaussian_filter(values, width, mode="constant", truncate=3.0)
    np.testing.assert_allclose(smooth_gaussian(values, width), expected, rtol=0.0, atol=1e-15)
