"""The lid-driven cavity against Ghia, Ghia and Shin 1982, doi:10.1016/0021-9991(82)90058-4, tables I and II."""

import numpy as np
import pytest

from gslcosim.flow import MovingWall, SlipWall
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import LOW
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import Laminar

HEIGHTS = (0.9766, 0.9688, 0.9609, 0.9531, 0.8516, 0.7344, 0.6172, 0.5, 0.4531, 0.2813, 0.1719, 0.1016, 0.0703, 0.0547)
ALONG_LID = {
    100: (0.84123, 0.78871, 0.73722, 0.68717, 0.23151, 0.00332, -0.13641, -0.20581, -0.2109, -0.15662, -0.1015,
          -0.06434, -0.04775, -0.03717),
    400: (0.75837, 0.68439, 0.61756, 0.55892, 0.29093, 0.16256, 0.02135, -0.11477, -0.17119, -0.32726, -0.24299,
          -0.14612, -0.10338, -0.08186),
    1000: (0.65928, 0.57492, 0.51117, 0.46604, 0.33304, 0.18719, 0.05702, -0.0608, -0.10648, -0.27805, -0.38289,
           -0.2973, -0.2222, -0.18109),
}  # fmt: skip
# Without x = 0.9063, whose printed value at Re 400 is a misprint.
POSITIONS = (
    0.9688, 0.9609, 0.9531, 0.9453, 0.8594, 0.8047, 0.5, 0.2344, 0.2266, 0.1563, 0.0938, 0.0781, 0.0703, 0.0625,
)  # fmt: skip
ACROSS = {
    100: (-0.05906, -0.07391, -0.08864, -0.10313, -0.22445, -0.24533, 0.05454, 0.17527, 0.17507, 0.16077, 0.12317,
          0.1089, 0.10091, 0.09233),
    400: (-0.12146, -0.15663, -0.19254, -0.22847, -0.44993, -0.38598, 0.05188, 0.30174, 0.30203, 0.28124, 0.22965,
          0.2092, 0.19713, 0.1836),
    1000: (-0.21388, -0.27669, -0.33714, -0.39188, -0.42665, -0.31966, 0.02526, 0.32235, 0.33075, 0.37095, 0.32627,
           0.30353, 0.29012, 0.27485),
}  # fmt: skip


# Largest differences from the tables along the two centre lines of a unit square under a lid of speed 1.
def cavity_error(reynolds, n, end_time_s):
    cell_m = 1 / n
    patches = [
        SlipWall(min_m=(0, 0, 0), max_m=(1, 0, 1)),
        SlipWall(min_m=(0, cell_m, 0), max_m=(1, cell_m, 1)),
        MovingWall(min_m=(0, 0, 1), max_m=(1, cell_m, 1), velocity_m_s=(1, 0, 0)),
    ]
    domain = build_domain(np.ones((n, 1, n), bool), cell_m, patches, needs_openings=False)
    solver = FlowSolver(domain, Laminar(domain, 1 / reynolds))
    while solver.time_s < end_time_s:
        solver.step(until_s=end_time_s)
    at = np.concatenate(([0], (np.arange(n) + 0.5) * cell_m, [1]))
    u = solver.velocity[0][LOW + n // 2, LOW, LOW : LOW + n]
    w = solver.velocity[2][LOW : LOW + n, LOW, LOW + n // 2]
    along = np.interp(HEIGHTS, at, np.concatenate(([0], u, [1]))) - ALONG_LID[reynolds]
    across = np.interp(POSITIONS, at, np.concatenate(([0], w, [0]))) - ACROSS[reynolds]
    return max(np.abs(along).max(), np.abs(across).max())


def test_cavity_at_reynolds_100():
    assert cavity_error(100, 32, 12.0) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("reynolds", "n", "end_time_s", "allowed"), [(400, 64, 30.0, 0.03), (1000, 64, 50.0, 0.05)])
def test_cavity_at_higher_reynolds_numbers(reynolds, n, end_time_s, allowed):
    assert cavity_error(reynolds, n, end_time_s) < allowed
