import math

import numpy as np
import pytest
from built_rooms import build_air

from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.mixing_ratio import Walls, mixing_ratio_ppm_at
from gslcosim_services.fields.spatial_index import FilamentIndex, exp_minus

ORIGIN_M = (-1.0, 0.5, 2.0)
SHAPE = (22, 14, 10)
CELL_M = 0.4
MAX_M = tuple(o + n * CELL_M for o, n in zip(ORIGIN_M, SHAPE, strict=True))


def cloud(n, *, n_gases=1, beyond=0.0, seed=1):
    """Filaments of many sizes all over the box, some of them outside of it."""
    rng = np.random.default_rng(seed)
    return Filaments(
        position_world_m=ORIGIN_M + rng.uniform(-beyond, 1 + beyond, (n, 3)) * np.array(SHAPE) * CELL_M,
        sigma_m=rng.uniform(0.05, 0.5, n),
        source_index=rng.integers(0, n_gases, n).astype(np.int32),
        amount_mol=np.linspace(1e-6, 2e-6, n_gases),
        gas_index=np.arange(n_gases, dtype=np.int32),
    )


def points(n=60):
    """Places inside and outside the box."""
    return ORIGIN_M + np.random.default_rng(2).uniform(-0.3, 1.3, (n, 3)) * np.array(SHAPE) * CELL_M


def indexed(filaments, block_m=0.5):
    index = FilamentIndex(min_m=ORIGIN_M, max_m=MAX_M, block_m=block_m)
    index.build(filaments)
    return index


@pytest.mark.parametrize("n_gases", [1, 3])
@pytest.mark.parametrize("beyond", [0.0, 0.3])
@pytest.mark.parametrize("block_m", [0.3, 1.0, 50.0])
def test_equals_the_plain_sum(n_gases, beyond, block_m):
    filaments = cloud(1500, n_gases=n_gases, beyond=beyond)
    expected = mixing_ratio_ppm_at(points(), filaments)
    assert (expected > 0).mean() > 0.4
    found = indexed(filaments, block_m).mixing_ratio_ppm_at(points())
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("beyond", [0.0, 0.3])
@pytest.mark.parametrize("solid_frac", [0.0, 0.001, 0.05])
def test_equals_the_plain_sum_behind_walls(beyond, solid_frac):
    cells = (np.random.default_rng(3).random(SHAPE) < solid_frac).astype(np.uint8)
    walls = Walls.of(build_air(cells, origin_m=ORIGIN_M, cell_m=CELL_M))
    filaments = cloud(1500, beyond=beyond)
    expected = mixing_ratio_ppm_at(points(), filaments, walls=walls)
    found = indexed(filaments).mixing_ratio_ppm_at(points(), walls=walls)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("cutoff_sigma", [3.0, 4.0, 8.0])
def test_cut_offs_are_kept(cutoff_sigma):
    filaments = cloud(300)
    expected = mixing_ratio_ppm_at(points(), filaments, cutoff_sigma=cutoff_sigma)
    found = indexed(filaments).mixing_ratio_ppm_at(points(), cutoff_sigma=cutoff_sigma)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_building_again_forgets_what_was_there():
    index = indexed(cloud(5000, seed=4))
    few = cloud(7, seed=5)
    index.build(few)
    np.testing.assert_allclose(index.mixing_ratio_ppm_at(points()), mixing_ratio_ppm_at(points(), few), rtol=1e-12)
    none = cloud(0)
    index.build(none)
    assert index.mixing_ratio_ppm_at(points()).max() == 0.0


def test_the_exponential_is_exact_to_fourteen_digits():
    exponents = np.linspace(0.0, 12.5, 5001)
    found = np.array([exp_minus(e) for e in exponents])
    np.testing.assert_allclose(found, [math.exp(-e) for e in exponents], rtol=2e-14)
