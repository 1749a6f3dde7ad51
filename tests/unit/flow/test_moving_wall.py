"""A lid drags the air with it, the same way on every side of the box."""

import numpy as np
import pytest

from gslcosim.flow import MovingWall
from gslcosim.flow.domain import build_domain
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import Laminar

SHAPE = (8, 6, 5)
CELL_M = 0.1


# The air after a second under a lid on top that moves along x; axes and ends exchanged as asked.
def driven(*, axes=(0, 1, 2), is_high=True, speed_m_s=1.0):
    shape = [SHAPE[a] for a in axes]
    size_m = [n * CELL_M for n in shape]
    normal, along = axes.index(2), axes.index(0)
    low, high = [0.0, 0.0, 0.0], list(size_m)
    low[normal] = high[normal] = size_m[normal] if is_high else 0.0
    velocity = [0.0, 0.0, 0.0]
    velocity[along] = speed_m_s
    lid = MovingWall(min_m=tuple(low), max_m=tuple(high), velocity_m_s=tuple(velocity))
    domain = build_domain(np.ones(shape, bool), CELL_M, [lid], needs_openings=False)
    solver = FlowSolver(domain, Laminar(domain, 0.01), tolerance=1e-6)
    while solver.time_s < 1.0:
        solver.step(until_s=1.0)
    return solver.centre_velocity()


@pytest.mark.parametrize("axes", [(1, 0, 2), (0, 2, 1), (2, 1, 0), (1, 2, 0), (2, 0, 1)])
def test_a_lid_on_any_side_gives_the_same_flow(axes):
    expected = driven().transpose(*axes, 3)[..., list(axes)]
    assert np.abs(driven(axes=axes) - expected).max() < 1e-4


def test_a_lid_below_gives_the_mirrored_flow():
    mirrored = np.flip(driven(is_high=False), axis=2).copy()
    mirrored[..., 2] *= -1
    assert np.abs(mirrored - driven()).max() < 1e-4


def test_the_air_follows_the_lid_and_returns_below():
    wind = driven()
    assert wind[4, 3, -1, 0] > 0.2
    assert wind[4, 3, 1, 0] < 0
    assert np.abs(driven(speed_m_s=-1.0)[::-1, :, :, 0] + wind[..., 0]).max() < 1e-4
