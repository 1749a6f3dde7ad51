"""Distances in compiled code are those of Python's `math`, to the last bit."""

import math

import numpy as np

from gslcosim_training.batch.free_space import norm2, norm3


def test_norms_are_those_of_math():
    rng = np.random.default_rng(1)
    vectors = (rng.normal(size=(3000, 3)) * 10.0 ** rng.integers(-9, 9, (3000, 3))).tolist()
    vectors += [[0.0, 0.0, 0.0], [0.0, -3.0, 4.0], [1e-140, 1e-140, 0.0]]
    for x, y, z in vectors:
        assert norm3(x, y, z) == math.hypot(x, y, z)
        assert norm2(x, y) == math.hypot(x, y)
        assert norm3(x - y, y - z, z - x) == math.dist((x, y, z), (y, z, x))
