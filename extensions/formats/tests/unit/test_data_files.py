"""`OccupancyGrid3D.csv`: the order of its cells, what is tolerated, and what is refused with its place."""

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.model import Cell, Grid
from gslcosim_formats.data_files import format_occupancy, read_occupancy

GRID = Grid(origin_m=(0.0, -1.0, 0.5), cell_m=0.5, shape=(2, 3, 4))
HEAD = "#env_min(m) 0 -1 0.5\n#env_max(m) 1 0.5 2.5\n#num_cells 2 3 4\n#cell_size(m) 0.5\n"
LAYERS = "0 0 0 \n0 0 0 \n;\n0 0 0 \n0 0 0 \n;\n0 0 0 \n1 0 0 \n;\n0 0 2 \n0 0 0 \n;\n"


@pytest.fixture
def codes():
    """Codes that differ along every axis."""
    cells = np.zeros(GRID.shape, np.uint8)
    cells[1, 0, 2] = Cell.SOLID
    cells[0, 2, 3] = Cell.OUTLET
    return cells


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "OccupancyGrid3D.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_occupancy(path)

    return read


def test_cells_are_read_in_their_order(read, codes):
    grid, cells = read(HEAD + LAYERS)
    assert grid == GRID
    assert cells.dtype == np.uint8
    np.testing.assert_array_equal(cells, codes)


def test_what_is_written_is_what_gaden_writes(codes):
    assert format_occupancy(GRID, codes) == HEAD + LAYERS


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "  \n\n"),
        lambda text: "\ufeff" + text.replace(" ", "\t"),
        lambda text: text.replace("-1 0.5\n", "-1e0 5.0E-1\n", 1).replace("0 0 2", "0.0 0e0 2.0"),
        lambda text: text.removesuffix(";\n"),
    ],
    ids=["crlf", "blanks", "tabs and byte order mark", "scientific", "no last mark"],
)
def test_other_ways_to_write_the_same_are_read(read, codes, change):
    grid, cells = read(change(HEAD + LAYERS))
    assert grid == GRID
    np.testing.assert_array_equal(cells, codes)


def test_corners_may_miss_the_cells_by_less_than_one(read):
    """GADEN rounds the number of cells up."""
    grid, _ = read((HEAD + LAYERS).replace("#env_max(m) 1 0.5 2.5", "#env_max(m) 0.8 0.26 2.5"))
    assert grid == GRID


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("#num_cells 2 3 4", "#num_cells 2 3", "#num_cells and 3 numbers in line 3, one of 4 lines of head"),
        ("#num_cells 2 3 4", "#num_cells 2 3.5 4", "whole numbers of cells in line 3"),
        ("#num_cells 2 3 4", "#num_cells 0 3 4", "finite, positive size"),
        ("#num_cells 2 3 4", "#num_cells 200000 300000 400000", r"at most 1e\+09 cells"),
        ("#num_cells 2 3 4", "#num_cells 1e300 3 4", "whole numbers of cells"),
        ("#num_cells 2 3 4", "#num_cells 2 3 5", "cells that fill the space between the corners"),
        ("#env_min", "#minimum", "#env_min and 3 numbers in line 1"),
        ("#cell_size(m) 0.5", "#cell_size(m) nan", "a finite number in line 4"),
        ("#cell_size(m) 0.5", "#cell_size(m) -0.5", "finite, positive size"),
        ("0 0 0 \n", "0 x 0 \n", "a number in line 5, column 2, was 'x'"),
        ("0 0 2 \n", "0 0 7 \n", "0 free, 1 obstacle or 2 outlet in line 14, column 3, was 7"),
        ("0 0 2 \n", "0 0.5 2 \n", "in line 14, column 2, was 0.5"),
        ("1 0 0 \n", "1 0 \n", "3 values in line 12, was 2"),
        ("1 0 0 \n", "", "row 1 of layer 3 at line 12: ';'"),
        ("1 0 0 \n", "1 0 0 \n1 0 0 \n", "row 3 of layer 3 at line 13"),
        ("0 0 2 \n0 0 0 \n;\n", "", "4 layers of 2 rows, was 3 layers and 0 rows"),
        ("0 0 2 \n0 0 0 \n;\n", "0 0 2 \n", "was 3 layers and 1 rows"),
        ("0 0 2 \n0 0 0 \n;\n", "0 0 2 \n0 0 0 \n;\n0 0 0\n", "row 1 of layer 5"),
    ],
)
def test_a_faulty_file_is_refused_with_its_place(read, old, new, expected):
    text = HEAD + LAYERS
    assert old in text
    with pytest.raises(EnvironmentDataError, match=expected):
        read(text.replace(old, new, 1))


def test_files_that_are_no_text_or_missing_are_refused(read, tmp_path):
    with pytest.raises(EnvironmentDataError, match="4 lines of head"):
        read("")
    with pytest.raises(EnvironmentDataError, match="expected a text, was other bytes at 3"):
        read(b"#en\xff")
    with pytest.raises(EnvironmentDataError, match="a file that can be read"):
        read_occupancy(tmp_path / "missing.csv")
