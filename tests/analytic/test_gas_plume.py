"""Many filaments in uniform wind are the Gaussian plume."""

import math

import numpy as np
import pytest
from built_gas import build_filaments, build_plume, build_source
from built_rooms import build_air

from gslcosim.environment.model import Cell
from gslcosim_services.fields.filament.plume import filament_amount_mol
from gslcosim_services.fields.mixing_ratio import mixing_ratio_ppm_at, mixing_ratio_ppm_on_grid, strength_ppm_m3

WIND_M_S = 0.5
GROWTH_M2_S = 0.004
DIFFUSIVITY_M2_S = 0.01
SIGMA0_M = 0.1
RATE_PER_S = 3000.0


@pytest.fixture(scope="module")
def plume():
    """A plume in steady state in an open box of 12 x 8 x 6 m."""
    cells = np.full((48, 32, 24), Cell.OUTLET, np.uint8)
    cells[1:-1, 1:-1, 1:-1] = Cell.FREE
    environment = build_air(cells, (WIND_M_S, 0.0, 0.0))
    source = build_source((1.0, 4.0, 3.0), rate=RATE_PER_S, ppm=0.01, sigma_m=SIGMA0_M)
    made = build_plume(
        environment, (source,), step_s=0.2, growth_m2_s=GROWTH_M2_S, diffusivity_m2_s=DIFFUSIVITY_M2_S, seed=4
    )
    made.advance(150)
    return made


def release_ppm_m3_s():
    return RATE_PER_S * strength_ppm_m3(np.array([filament_amount_mol(0.01, SIGMA0_M)]))[0]


def plume_ppm(x_m, y_m, z_m):
    """Steady plume with spread along the wind: the integral over the age of Gaussian puffs."""
    t = np.linspace(0.0, 30.0, 6001)
    s2 = SIGMA0_M**2 + (GROWTH_M2_S + 2 * DIFFUSIVITY_M2_S) * t
    puffs = np.exp(-((x_m - WIND_M_S * t) ** 2 + y_m**2 + z_m**2) / (2 * s2)) / (2 * math.pi * s2) ** 1.5
    return release_ppm_m3_s() * np.trapezoid(puffs, t)


@pytest.mark.parametrize(
    "offset_m", [(3.0, 0.0, 0.0), (5.0, 0.0, 0.0), (5.0, 0.4, 0.0), (5.0, 0.0, -0.4), (6.0, -0.5, 0.3)]
)
def test_uniform_wind_gives_the_gaussian_plume(plume, offset_m):
    along_m = np.linspace(-1.0, 1.0, 41)
    points = np.add((1.0, 4.0, 3.0), offset_m) + along_m[:, None] * (1.0, 0.0, 0.0)
    found = mixing_ratio_ppm_at(points, plume.filaments)[:, 0].mean()
    expected = np.mean([plume_ppm(offset_m[0] + a, *offset_m[1:]) for a in along_m])
    assert found == pytest.approx(expected, rel=0.04)


def test_spread_across_the_wind_follows_its_law(plume):
    """sigma_y^2 = sigma0^2 + gamma t + 2 D t, from the places and sizes of filaments of one age."""
    filaments = plume.filaments
    age_s = (filaments.sigma_m**2 - SIGMA0_M**2) / GROWTH_M2_S
    for t in (2.0, 5.0, 10.0):
        chosen = np.abs(age_s - t) < 0.5
        offset_m = filaments.position_world_m[chosen, 1:] - (4.0, 3.0)
        s2 = (filaments.sigma_m[chosen] ** 2).mean() + offset_m.var()
        error = 2 * DIFFUSIVITY_M2_S * t * math.sqrt(2 / offset_m.size)
        assert s2 == pytest.approx(SIGMA0_M**2 + (GROWTH_M2_S + 2 * DIFFUSIVITY_M2_S) * t, abs=4 * error)


def test_the_grid_holds_all_gas_that_was_released():
    """The integral of one filament's mixing ratio over all space is its volume, up to the cut-off (1.5e-5)."""
    puff = build_filaments([(0.1, -0.2, 0.3)], [0.3])
    spacing_m = 0.1
    grid = mixing_ratio_ppm_on_grid(puff, first_point_m=(-2.0, -2.5, -1.8), spacing_m=spacing_m, shape=(41, 47, 43))
    assert grid.sum() * spacing_m**3 == pytest.approx(strength_ppm_m3(puff.amount_mol)[0], rel=2e-5)
