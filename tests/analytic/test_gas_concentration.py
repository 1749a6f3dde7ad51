"""GSL-Bench's published concentration grids, from its filaments."""

import os
from pathlib import Path

import numpy as np
import pytest

from gslcosim.base.gases import air_density_mol_m3
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.mixing_ratio import mixing_ratio_ppm_at, mixing_ratio_ppm_on_grid

REFERENCE = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[2] / ".." / "shared" / "reference"))
FIRST_POINT_M = (0.125, 0.125, 0.125)
SPACING_M = 0.25
SHAPE = (60, 60, 32)
# Environment: place of the largest value, largest, sum, values at cells [20, 4, 8] and [48, 12, 16], filaments.
TABLE = {
    "001": ((22, 4, 9), 21.307411739322, 18075.831830370, 15.7816916828, 1.69729515427, 1816),
    "003": ((23, 5, 9), 23.843415760885, 18384.227137287, 16.6424018485, 3.37505107766, 1844),
    "005": ((21, 4, 8), 31.411539804991, 18055.424615788, 24.2861619011, 2.27254422999, 1802),
}


@pytest.fixture(params=sorted(TABLE))
def frame(request):
    """Filaments of frame 400 of one environment, and the published grid."""
    folders = sorted((REFERENCE / "gsl-bench" / "environments" / request.param / "gas_data").glob("*"))
    if not folders:
        pytest.skip(f"no GSL-Bench data under {REFERENCE} (set GSLCOSIM_REFERENCE)")
    records = np.load(folders[0] / "iteration_400_fil.npy")
    head = np.load(folders[0] / "iteration_400_head.npy")[0]
    air_mol_m3 = head["num_moles_all_gases_in_cm3"] * 1e6
    filaments = Filaments(
        position_world_m=np.stack([records[f"pose_{axis}"] for axis in "xyz"], axis=1),
        sigma_m=records["sigma"] * 0.01,
        source_index=np.zeros(len(records), np.int32),
        # The files have air of their own.
        amount_mol=np.array([head["filament_num_moles_of_gas"] * air_density_mol_m3() / air_mol_m3]),
        gas_index=np.zeros(1, np.int32),
    )
    published = np.load(REFERENCE / "gsl-bench" / "ppm_data" / f"ppm_env_{request.param}.npz")["arr_0"]
    return request.param, filaments, published


def test_grids_are_reproduced(frame):
    name, filaments, published = frame
    grid = mixing_ratio_ppm_on_grid(filaments, first_point_m=FIRST_POINT_M, spacing_m=SPACING_M, shape=SHAPE)
    np.testing.assert_allclose(grid, published, rtol=1e-9, atol=1e-9 * published.max())
    argmax, largest, total, near, far, n_filaments = TABLE[name]
    assert np.unravel_index(grid.argmax(), SHAPE) == argmax
    assert (grid.max(), grid.sum()) == pytest.approx((largest, total), rel=1e-9)
    assert (grid[20, 4, 8], grid[48, 12, 16]) == pytest.approx((near, far), rel=1e-9)
    assert len(filaments.sigma_m) == n_filaments


def test_readings_at_points_are_reproduced(frame):
    _, filaments, published = frame
    cells = np.array([(20, 4, 8), (48, 12, 16), (5, 5, 5), (59, 0, 31), (30, 40, 10)])
    points = np.array(FIRST_POINT_M) + cells * SPACING_M
    found = mixing_ratio_ppm_at(points, filaments)[:, 0]
    np.testing.assert_allclose(found, published[tuple(cells.T)], rtol=1e-9)


def test_sizes_follow_the_growth_law_of_the_data(frame):
    """(sigma^2 - 100 cm2) / (10 cm2/s) is a whole number of 0.1 s steps for every record."""
    _, filaments, _ = frame
    age_s = (filaments.sigma_m**2 - 0.1**2) / 0.001
    assert 0.0 <= age_s.min() < age_s.max() < 400.4
    np.testing.assert_allclose(age_s * 10, np.round(age_s * 10), atol=1e-4)
