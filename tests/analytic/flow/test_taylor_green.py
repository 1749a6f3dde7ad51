"""A decaying array of vortices between frictionless walls has a closed form: the error falls with the cell squared."""

import numpy as np
import pytest

from gslcosim.flow import SlipWall
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import LOW
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import Laminar, still_velocity

PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


def frictionless_box(size_m):
    patches = []
    for axis in range(3):
        for at in (0.0, size_m[axis]):
            low, high = [0.0, 0.0, 0.0], list(size_m)
            low[axis] = high[axis] = at
            patches.append(SlipWall(min_m=tuple(low), max_m=tuple(high)))
    return patches


# Error of u = sin a cos b exp(-2 nu t), v = -cos a sin b exp(-2 nu t) on n x n cells of [0, pi]^2, one cell deep.
def vortex_error(n, plane, *, nu_m2_s, end_time_s):
    cell_m = np.pi / n
    first, second = PLANES[plane]
    shape = [1, 1, 1]
    shape[first] = shape[second] = n
    size_m = [s * cell_m for s in shape]
    domain = build_domain(np.ones(shape, bool), cell_m, frictionless_box(size_m), needs_openings=False)
    faces, centres = np.arange(n + 1) * cell_m, (np.arange(n) + 0.5) * cell_m
    exact = {
        first: np.outer(np.sin(faces), np.cos(centres)),
        second: -np.outer(np.cos(centres), np.sin(faces)),
    }
    velocity = still_velocity(domain)
    where = {}
    for component, values in exact.items():
        index = [LOW, LOW, LOW]
        index[first] = slice(LOW, LOW + values.shape[0])
        index[second] = slice(LOW, LOW + values.shape[1])
        where[component] = tuple(index)
        velocity[component][where[component]] = values
    solver = FlowSolver(domain, Laminar(domain, nu_m2_s), initial_velocity=velocity, tolerance=1e-6)
    while solver.time_s < end_time_s:
        solver.step(until_s=end_time_s)
    decay = np.exp(-2 * nu_m2_s * end_time_s)
    errors = [solver.velocity[c][where[c]] - decay * exact[c] for c in exact]
    return np.sqrt(np.mean([np.mean(e**2) for e in errors]))


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("nu_m2_s", [1e-3, 0.1])
def test_the_error_falls_with_the_cell_squared(plane, nu_m2_s):
    coarse, middle, fine = (vortex_error(n, plane, nu_m2_s=nu_m2_s, end_time_s=1.0) for n in (8, 16, 32))
    assert fine < 2.5e-3
    assert np.log2(coarse / fine) / 2 > 1.7
    assert np.log2(middle / fine) > 1.8
