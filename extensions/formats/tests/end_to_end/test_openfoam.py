"""OpenFOAM itself, where it is installed, on a tiny room: its own check of the mesh, its wind, its failures."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, MovingWall, Outlet, SlipWall
from gslcosim_formats.openfoam import find_installation, solve_wind_openfoam, write_case
from gslcosim_formats.solver_comparison import compare_solvers, compare_winds

CELL_M = 0.25
PATCHES = (
    Inlet(min_m=(0, 0.5, 0.25), max_m=(0, 1.25, 1), velocity_m_s=(1, 0, 0)),
    Outlet(min_m=(3, 1, 0), max_m=(3, 2, 1)),
)


def openfoam_or_skip():
    try:
        return find_installation()
    except FlowError as error:
        pytest.skip(str(error))


pytestmark = [pytest.mark.end_to_end, pytest.mark.slow, pytest.mark.debian]


@pytest.fixture
def room():
    free = np.ones((12, 9, 6), bool)
    free[5:7, 2:6, :3] = False
    return free


@pytest.fixture
def temporary(monkeypatch, tmp_path):
    """A folder of its own for temporary files, to see what is left in it."""
    openfoam_or_skip()
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_both_solvers_agree_and_two_ranks_give_what_one_gives(room, temporary):
    fractions = []
    comparison = compare_solvers(room, CELL_M, PATCHES, end_time_s=3.0, n_ranks=2, progress=fractions.append)
    assert comparison.agreement.correlation >= 0.97
    assert comparison.agreement.rms_relative <= 0.2
    assert np.all(comparison.openfoam_m_s[~room] == 0)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    serial_m_s = solve_wind_openfoam(room, CELL_M, PATCHES, end_time_s=3.0, n_ranks=1)
    assert np.abs(serial_m_s - comparison.openfoam_m_s).max() <= 0.01
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("turbulence", ["smagorinsky", "laminar"])
def test_other_models_and_the_mean_are_solved_too(room, temporary, turbulence):
    mean_m_s = solve_wind_openfoam(
        room, CELL_M, PATCHES, end_time_s=2.0, average_from_s=1.0, n_ranks=1, turbulence=turbulence, nu_m2_s=1e-3
    )
    last_m_s = solve_wind_openfoam(
        room, CELL_M, PATCHES, end_time_s=2.0, n_ranks=1, turbulence=turbulence, nu_m2_s=1e-3
    )
    agreement = compare_winds(mean_m_s, last_m_s, room)
    assert 0.9 <= agreement.correlation < 1


def test_moving_and_frictionless_walls_act_as_in_the_built_in_solver(temporary):
    free = np.ones((12, 9, 6), bool)
    belt = MovingWall(min_m=(0, 0, 0), max_m=(3, 2.25, 0), velocity_m_s=(0, 1, 0))
    slip = SlipWall(min_m=(0, 0, 1.5), max_m=(3, 2.25, 1.5))
    patches = (*PATCHES, belt, slip)
    comparison = compare_solvers(free, CELL_M, patches, end_time_s=2.0, n_ranks=1)
    assert comparison.agreement.correlation >= 0.97
    still = compare_solvers(free, CELL_M, PATCHES, end_time_s=2.0, n_ranks=1)
    assert still.openfoam_m_s[:, :, 0, 1].mean() < comparison.openfoam_m_s[:, :, 0, 1].mean()


def test_openfoam_finds_no_fault_in_the_mesh(room, tmp_path):
    installation = openfoam_or_skip()
    room[9, 4:6, 2] = False  # an obstacle that hangs in the air
    case = write_case(room, CELL_M, PATCHES, tmp_path / "case", end_time_s=1.0)
    check = subprocess.run(
        [installation.tool("checkMesh"), "-case", case.folder, "-allGeometry", "-allTopology"],
        env=installation.environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "Mesh OK." in check.stdout
    assert "Upper triangular ordering OK." in check.stdout
    assert "***" not in check.stdout


def test_a_case_folder_that_was_given_is_kept(room, temporary, tmp_path):
    folder = tmp_path / "case"
    solve_wind_openfoam(room, CELL_M, PATCHES, end_time_s=0.2, n_ranks=1, case_dir=folder)
    assert (folder / "0.2" / "U").is_file()
    assert (folder / "log.pimpleFoam").is_file()


def test_a_failure_keeps_the_case_and_shows_openfoams_reason(room, temporary, monkeypatch):
    shown = "/nowhere"
    monkeypatch.setenv("WM_PROJECT_DIR", shown)
    if shutil.which("pimpleFoam") is None:
        pytest.skip("pimpleFoam is not on the path: its settings are found by its own script")
    with pytest.raises(FlowError, match="pimpleFoam failed with exit status") as caught:
        solve_wind_openfoam(room, CELL_M, PATCHES, end_time_s=1.0, n_ranks=1)
    assert "controlDict" in str(caught.value)
    log = Path(str(caught.value).rpartition("Log: ")[2])
    assert "controlDict" in log.read_text()
    assert temporary in log.parents
