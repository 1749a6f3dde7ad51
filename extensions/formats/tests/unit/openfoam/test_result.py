"""Results are read back to the cells they belong to, in one piece or in parts; what is missing is said."""

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, Outlet
from gslcosim_formats.openfoam import read_wind, write_case
from gslcosim_formats.openfoam.case import write_labels

SHAPE = (4, 3, 2)
PATCHES = (
    Inlet(min_m=(0, 0, 0), max_m=(0, 3, 2), velocity_m_s=(1, 0, 0)),
    Outlet(min_m=(4, 0, 0), max_m=(4, 3, 2)),
)


@pytest.fixture
def free():
    free = np.ones(SHAPE, bool)
    free[1, 1, 0] = False
    return free


@pytest.fixture
def velocity_m_s(free):
    velocity_m_s = np.random.default_rng(0).normal(size=(*SHAPE, 3))
    velocity_m_s[~free] = 0
    return velocity_m_s


def write_vectors(path, vectors):
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = "\n".join(f"({x:.8g} {y:.8g} {z:.8g})" for x, y, z in vectors)
    path.write_text(
        f"FoamFile {{ class volVectorField; }}\ndimensions [0 1 -1 0 0 0 0];\n\n"
        f"internalField   nonuniform List<vector> \n{len(vectors)}\n(\n{lines}\n)\n;\n\nboundaryField\n{{\n}}\n"
    )


@pytest.fixture
def case(free, tmp_path):
    return lambda **options: write_case(free, 1.0, PATCHES, tmp_path / "case", end_time_s=2.5, **options)


def test_a_result_in_one_piece_is_read(case, free, velocity_m_s):
    solved = case(n_ranks=1)
    write_vectors(solved.folder / "2.5" / "U", velocity_m_s[free])
    assert read_wind(solved) == pytest.approx(velocity_m_s, rel=1e-6)
    assert read_wind(solved).dtype == np.float32


def test_parts_are_put_together(case, free, velocity_m_s):
    solved = case(n_ranks=2, average_from_s=1.0)
    cells = np.random.default_rng(1).permutation(int(free.sum()))
    for rank, numbers in enumerate((cells[:10], cells[10:])):
        part = solved.folder / f"processor{rank}"
        write_vectors(part / "2.5" / "UMean", velocity_m_s[free][numbers])
        write_labels(part / "constant" / "polyMesh" / "cellProcAddressing", numbers, note="")
    assert read_wind(solved) == pytest.approx(velocity_m_s, rel=1e-6)


def test_the_last_time_is_read(case, free, velocity_m_s):
    solved = case(n_ranks=1)
    write_vectors(solved.folder / "10" / "U", velocity_m_s[free])
    write_vectors(solved.folder / "2.5" / "U", 0 * velocity_m_s[free])
    assert np.abs(read_wind(solved)).max() > 0


def test_a_solve_without_a_result_is_said_to_have_none(case):
    with pytest.raises(FlowError, match=r"expected a folder named by the end of the solve \[s\], found none"):
        read_wind(case(n_ranks=1))


def test_values_that_are_not_finite_are_refused(case, free, velocity_m_s):
    solved = case(n_ranks=1)
    vectors = velocity_m_s[free]
    vectors[3, 1] = np.nan
    write_vectors(solved.folder / "2.5" / "U", vectors)
    with pytest.raises(FlowError, match="expected a finite U in every cell"):
        read_wind(solved)


def test_a_list_that_ends_early_is_refused(case, free, velocity_m_s):
    solved = case(n_ranks=1)
    path = solved.folder / "2.5" / "U"
    write_vectors(path, velocity_m_s[free])
    path.write_text(path.read_text().replace("List<vector> \n23", "List<vector> \n24"))
    with pytest.raises(FlowError, match="expected 72 numbers, found 69"):
        read_wind(solved)


def test_a_result_that_is_not_text_is_refused(case):
    solved = case(n_ranks=1)
    (solved.folder / "2.5").mkdir()
    (solved.folder / "2.5" / "U").write_bytes(b"FoamFile { format binary; }\n\x00\xff\x01")
    with pytest.raises(FlowError, match=r"writeFormat ascii"):
        read_wind(solved)
