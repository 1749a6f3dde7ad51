"""The empty 15 x 15 x 8 m warehouse against pimpleFoam (k-epsilon with wall functions, the same 0.2 m cells)."""

import os
from pathlib import Path

import numpy as np
import pytest

from gslcosim.flow import Inlet, Outlet, solve_wind_report

REPOSITORY = Path(__file__).parents[3]
REFERENCE = Path(os.environ.get("GSLCOSIM_REFERENCE", REPOSITORY / "../shared/reference")) / "openfoam"
PATCHES = (
    Inlet(min_m=(0, 0, 0), max_m=(0, 1.6, 2.4), velocity_m_s=(1, 0, 0)),
    Outlet(min_m=(15, 13.4, 0), max_m=(15, 15, 2.4)),
)


def reference(name):
    path = REFERENCE / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"no reference data at {path}; set GSLCOSIM_REFERENCE")
    with np.load(path) as data:
        return data["velocity_m_s"], data["free"], float(data["cell_size_m"])


def agreement(ours, theirs, free):
    a, b = ours[free].ravel().astype(np.float64), theirs[free].ravel().astype(np.float64)
    return np.corrcoef(a, b)[0, 1], np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2))


@pytest.mark.slow
def test_the_wind_after_5_s_agrees():
    theirs, free, cell_m = reference("warehouse_empty_t5s")
    report = solve_wind_report(free, cell_m, PATCHES, end_time_s=5.0)
    correlation, difference = agreement(report.velocity_m_s, theirs, free)
    assert correlation >= 0.99
    assert difference <= 0.10
    assert report.divergence_relative <= 1e-4
    assert report.mass_balance_relative <= 0.005


@pytest.mark.slow
def test_the_mean_from_60_to_120_s_agrees():
    theirs, free, cell_m = reference("warehouse_empty_mean_60s_120s")
    report = solve_wind_report(free, cell_m, PATCHES, end_time_s=120.0, average_from_s=60.0)
    correlation, difference = agreement(report.velocity_m_s, theirs, free)
    assert correlation >= 0.94
    assert difference <= 0.35
