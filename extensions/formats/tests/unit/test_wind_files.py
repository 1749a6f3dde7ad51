"""Wind of other programs: each format is recognised and read in its order, gaps are reported, faults are refused."""

import gzip
import re
import struct

import gaden_writers as gaden
import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.model import Cell, Grid
from gslcosim_formats.data_files import format_rows, read_array_frame
from gslcosim_formats.wind_files import NoWindWarning, WindGapsWarning, load_wind

GRID = Grid(origin_m=(0.0, -1.0, 0.5), cell_m=0.5, shape=(2, 3, 4))
FOAM_HEAD = (
    'FoamFile\n{{\n version 2.0;\n format {form};\n arch "LSB;label=32;scalar=64";\n class volVectorField;\n}}\n'
)
RNG = np.random.default_rng(5)


@pytest.fixture
def wind():
    """(nx, ny, nz, 3) numbers that are all different and survive being written in six digits."""
    return (np.arange(72, dtype=np.float32).reshape(2, 3, 4, 3) + 1) / 8


def frame(path, grid=GRID, **more):
    """Return the only frame of a wind."""
    (velocity_m_s,) = load_wind(path, grid, **more).velocity_m_s
    return velocity_m_s


def x_first(wind):
    return wind.transpose(2, 1, 0, 3).reshape(-1, 3)


def write_points(path, wind, header='"U:0","U:1","U:2","Points:0","Points:1","Points:2"', *, is_place_first=False):
    rows = list(zip(wind.reshape(-1, 3).tolist(), GRID.centres_m().reshape(-1, 3).tolist(), strict=True))
    RNG.shuffle(rows)
    lines = (map(repr, [*p, *v] if is_place_first else [*v, *p]) for v, p in rows)
    path.write_text("\n".join([*([header] if header else []), *(",".join(line) for line in lines)]) + "\n")


def write_components(folder, wind, *, name="wind_0", is_binary=True):
    for axis, letter in enumerate("UVW"):
        path = folder / f"{name}.csv_{letter}"
        if is_binary:
            path.write_bytes(struct.pack("<i", 999) + x_first(wind)[:, axis].astype("<f8").tobytes())
        else:
            path.write_text(format_rows(wind[..., axis], "%.9g"))


def write_foam(folder, wind, *, is_binary=False):
    folder.mkdir(parents=True)
    for name, values in (("U", wind), ("C", GRID.centres_m())):
        vectors = values.reshape(-1, 3)
        head = FOAM_HEAD.format(form="binary" if is_binary else "ascii")
        start = f"{head}dimensions [0 1 -1 0 0 0 0];\n\ninternalField   nonuniform List<vector> \n{len(vectors)}\n("
        text = "\n" + "\n".join(f"({x!r} {y!r} {z!r})" for x, y, z in vectors.tolist()) + "\n"
        data = vectors.astype("<f8").tobytes() if is_binary else text.encode()
        (folder / name).write_bytes(start.encode() + data + b")\n;\n\nboundaryField\n{\n wall { type noSlip; }\n}\n")


@pytest.mark.parametrize(
    ("header", "is_place_first"),
    [
        ('"U:0","U:1","U:2","Points:0","Points:1","Points:2"', False),
        ('"Points:0","Points:1","Points:2","U:0","U:1","U:2"', True),
        ("U_0,U_1,U_2,Points_0,Points_1,Points_2", False),
        ("x,y,z,U_x,U_y,U_z", True),
        ("x,y,z,Ux,Uy,Uz", True),
        ("x_m,y_m,z_m,wind_x_m_s,wind_y_m_s,wind_z_m_s", True),
        ("CellCenters_0,CellCenters_1,CellCenters_2,UMean_0,UMean_1,UMean_2", True),
        ("Points_X,Points_Y,Points_Z,u,v,w", True),
        (None, True),
    ],
)
def test_tables_of_points_are_read_by_the_names_of_their_columns(tmp_path, wind, header, is_place_first):
    write_points(tmp_path / "wind_0.csv", wind, header, is_place_first=is_place_first)
    np.testing.assert_array_equal(frame(tmp_path / "wind_0.csv"), wind)


def test_raw_sets_of_openfoam_are_read(tmp_path, wind):
    rows = np.concatenate([GRID.centres_m().reshape(-1, 3), wind.reshape(-1, 3)], axis=1)
    text = "\n".join("\t".join(map(repr, row)) for row in rows.tolist())
    (tmp_path / "cloud_U.xy").write_text(text)
    (tmp_path / "new_U.xy").write_text(f"# x y z U_x U_y U_z\n{text}\n")
    (tmp_path / "surface.raw").write_text(f"# U  FACE_DATA 24\n#  x  y  z  U_x  U_y  U_z\n{text}\n")
    for name in ("cloud_U.xy", "new_U.xy", "surface.raw"):
        np.testing.assert_array_equal(frame(tmp_path / name), wind)


def test_samples_of_one_cell_are_averaged_and_those_at_the_border_belong_to_it(tmp_path, wind):
    path = tmp_path / "points.csv"
    write_points(path, wind)
    with path.open("a") as file:
        file.write("3.125,4.25,5.375,1.0,0.5,2.5\n")
    read = frame(path)
    np.testing.assert_array_equal(read[1, 2, 3], (wind[1, 2, 3] + [3.125, 4.25, 5.375]) / 2)
    read[1, 2, 3] = wind[1, 2, 3]
    np.testing.assert_array_equal(read, wind)


def test_cells_without_a_sample_are_counted_and_still(tmp_path, wind):
    path = tmp_path / "points.csv"
    write_points(path, wind)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:-3], "1,1,1,9,9,9"]))
    with pytest.warns(WindGapsWarning, match=r"points.csv: 3 of 24 air cells have no sample .*; 1 samples lie outside"):
        read = frame(path)
    assert (~read.any(axis=-1)).sum() == 3


def test_points_in_another_unit_are_refused(tmp_path, wind):
    path = tmp_path / "points.csv"
    write_points(path, wind)
    far = Grid(origin_m=(100.0, 0.0, 0.0), cell_m=0.5, shape=(2, 3, 4))
    with pytest.raises(EnvironmentDataError, match=r"points in the grid.*24 points.*another unit or frame"):
        frame(path, far)


@pytest.mark.parametrize("is_binary", [True, False])
def test_component_files_are_read_in_their_order(tmp_path, wind, is_binary):
    write_components(tmp_path, wind, is_binary=is_binary)
    for path in (tmp_path / "wind_0.csv_V", tmp_path / "wind", tmp_path):
        np.testing.assert_array_equal(frame(path), wind)


def test_results_of_all_versions_are_read_in_their_order(tmp_path, wind):
    (tmp_path / "wind_iteration_0").write_bytes(x_first(wind).T.astype("<f8").tobytes())
    (tmp_path / "wind_iteration_1").write_bytes(struct.pack("<2i", 3, 0) + x_first(wind).astype("<f4").tobytes())
    frames = load_wind(tmp_path, GRID, period_s=0.5, is_looping=False)
    assert (frames.period_s, frames.is_looping) == (0.5, False)
    np.testing.assert_array_equal(frames.velocity_m_s, [wind, wind])


def test_uniform_wind_blows_in_the_air_only(tmp_path):
    path = tmp_path / "uniform.csv"
    path.write_text("1,0,0\n0.5, 0.25, -0.125\n")
    occupancy = np.zeros(GRID.shape, np.uint8)
    occupancy[0, 0, 0] = Cell.SOLID
    frames = load_wind(path, GRID, occupancy=occupancy).velocity_m_s
    assert frames.shape == (2, 2, 3, 4, 3)
    assert not frames[:, 0, 0, 0].any()
    assert (frames[1][occupancy == 0] == [0.5, 0.25, -0.125]).all()


def test_arrays_of_autogdm_and_our_own_are_read_in_their_order(tmp_path, wind):
    both = np.stack([wind, 2 * wind])
    np.save(tmp_path / "cells.npy", np.stack([x_first(each) for each in both]).astype(float))
    np.save(tmp_path / "one.npy", x_first(wind).astype(float))
    np.save(tmp_path / "own.npy", both)
    np.testing.assert_array_equal(load_wind(tmp_path / "cells.npy", GRID).velocity_m_s, both)
    np.testing.assert_array_equal(load_wind(tmp_path / "own.npy", GRID).velocity_m_s, both)
    np.testing.assert_array_equal(frame(tmp_path / "one.npy"), wind)


@pytest.mark.parametrize("name", ["cells", "own"])
def test_one_frame_of_an_array_is_that_of_all_and_begins_again_after_the_last(tmp_path, wind, name):
    both = np.stack([wind, 2 * wind])
    np.save(tmp_path / "cells.npy", np.stack([x_first(each) for each in both]).astype(float))
    np.save(tmp_path / "own.npy", both)
    for number, expected in ((0, wind), (1, 2 * wind), (4, wind)):
        np.testing.assert_array_equal(read_array_frame(tmp_path / f"{name}.npy", GRID, number), expected)


@pytest.mark.parametrize("is_binary", [True, False])
def test_time_folders_of_openfoam_are_read(tmp_path, wind, is_binary):
    write_foam(tmp_path / "4.5", wind, is_binary=is_binary)
    write_foam(tmp_path / "5", 2 * wind, is_binary=is_binary)
    (tmp_path / "0").mkdir()
    np.testing.assert_array_equal(frame(tmp_path / "4.5"), wind)
    case = load_wind(tmp_path, GRID)
    assert case.period_s == pytest.approx(0.5)
    np.testing.assert_array_equal(case.velocity_m_s, [wind, 2 * wind])


def test_short_lists_of_openfoam_are_on_one_line(tmp_path):
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, shape=(2, 1, 1))
    texts = {"C": "nonuniform List<vector> 2((0.5 0.5 0.5) (1.5 0.5 0.5))", "U": "uniform (1 2 3)"}
    for name, text in texts.items():
        (tmp_path / name).write_text(f"{FOAM_HEAD.format(form='ascii')}internalField {text};\nboundaryField {{}}\n")
    assert (frame(tmp_path, grid) == [1.0, 2.0, 3.0]).all()


def test_sets_of_openfoam_over_time_are_a_series(tmp_path, wind):
    for i, name in enumerate(("0.25", "0.5")):
        (tmp_path / "sets" / name).mkdir(parents=True)
        write_points(tmp_path / "sets" / name / "pts_U.csv", wind + i, "x,y,z,U_0,U_1,U_2", is_place_first=True)
    frames = load_wind(tmp_path / "sets", GRID)
    assert frames.period_s == 0.25
    np.testing.assert_array_equal(frames.velocity_m_s, [wind, wind + 1])


def test_a_case_without_cell_centres_says_how_to_get_them(tmp_path, wind):
    write_foam(tmp_path / "5", wind)
    (tmp_path / "5" / "C").unlink()
    with pytest.raises(EnvironmentDataError, match="Run postProcess -func writeCellCentres"):
        load_wind(tmp_path, GRID)
    with pytest.raises(EnvironmentDataError, match="Name the folder instead"):
        load_wind(tmp_path / "5" / "U", GRID)


def test_a_series_is_in_the_order_of_its_numbers(tmp_path, wind):
    for i in range(11):
        write_points(tmp_path / f"at_cell_centers_{i}.csv", wind + i)
    for path in (tmp_path, tmp_path / "at_cell_centers"):
        np.testing.assert_array_equal(load_wind(path, GRID).velocity_m_s, [wind + i for i in range(11)])
    (tmp_path / "at_cell_centers_4.csv").unlink()
    with pytest.raises(EnvironmentDataError, match="frames 0 to 10 without a gap, was none with number 4"):
        load_wind(tmp_path, GRID)


def test_several_series_in_a_folder_are_named(tmp_path, wind):
    for name in ("calm_0.csv", "storm_0.csv"):
        write_points(tmp_path / name, wind)
    with pytest.raises(EnvironmentDataError, match=r"one series of wind, was calm, storm\. Name one of them"):
        load_wind(tmp_path, GRID)
    assert frame(tmp_path / "storm").shape == (2, 3, 4, 3)


def test_still_air_and_mostly_still_air_are_reported(tmp_path, wind):
    np.save(tmp_path / "still.npy", np.zeros((1, 24, 3)))
    with pytest.warns(NoWindWarning, match=r"still.npy: no wind at all, all 24 air cells are still"):
        load_wind(tmp_path / "still.npy", GRID)
    wind[:, 1:] = 0.0
    np.save(tmp_path / "mostly.npy", wind)
    with pytest.warns(WindGapsWarning, match="16 of 24 air cells have no wind in any frame"):
        load_wind(tmp_path / "mostly.npy", GRID)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("wind_0.csv", "U:0,U:1,Points:0,Points:1,Points:2\n1,2,3,4,5\n", "velocities such as U:0"),
        ("wind_0.csv", "U:0,U:1,U:2,p\n1,2,3,4\n", "places such as Points:0"),
        ("wind_0.csv", "x,y,z,u,v,w\n", "points below the header, was none"),
        ("wind_0.csv", "x,y,z,u,v,w\n0,0,1,1,2\n", "6 values in line 2, was 5"),
        ("wind_0.csv", "x,y,z,u,v,w\n0,0,1,1,2,3\n\n0,0,1,1,2,x\n", "a number in line 4, column 6, was 'x'"),
        ("wind_0.csv", "x,y,z,u,v,w\n0,0,1,1,2,nan\n", "a finite number in line 2, column 6"),
        ("wind_0.csv", "x,y,z,u,v,w\n0,0,1,1,2,1e6\n", "velocities up to 1000 m/s"),
        ("wind_0.csv", "x,y,z,u,v,w\n0,0,1e300,1,2,3\n", r"places up to 1e\+09 m away, was 1e\+300 m"),
        ("wind_0.csv", "1,2,3,4\n", "recognised as points|a table of points, lines u,v,w"),
        ("wind_0.csv", "", "was an empty file"),
        ("uniform.csv", "1,0,0\n1,0\n", "3 values in line 2"),
        ("wind.bin", b"\0\1\2", "binary, with another name"),
        ("wind.npy", b"\x93NUMPY\1\0", "recognised as a numpy array: .* a whole numpy array"),
        ("wind_iteration_0", bytes(100), r"recognised as GADEN's results: .* 576 bytes .* or 296 .* was 100"),
        ("wind_iteration_0", bytes(296), "version 3 in front of 288 bytes, was 0"),
        ("wind_0.csv_U", struct.pack("<i", 999) + bytes(100), "196 bytes for 24 cells, was 104"),
        ("wind_0.csv_U", struct.pack("<i24d", 999, *[np.inf] * 24), "finite velocities"),
        ("wind_0.csv_U", "1 2 3\n", "4 layers of 2 rows"),
    ],
)
def test_faulty_files_are_refused(tmp_path, name, content, expected):
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(EnvironmentDataError, match=expected):
        load_wind(tmp_path / name, GRID)


@pytest.mark.parametrize("array", [np.zeros((1, 23, 3)), np.zeros((0, 24, 3)), np.zeros((24, 3), int), np.zeros(5)])
def test_arrays_that_do_not_fit_are_refused(tmp_path, array):
    np.save(tmp_path / "wind.npy", array)
    with pytest.raises(EnvironmentDataError, match=r"real numbers of \(t, 24, 3\) or \(t, 2, 3, 4, 3\), was"):
        load_wind(tmp_path / "wind.npy", GRID)


def test_missing_wind_and_empty_folders_are_refused(tmp_path):
    with pytest.raises(EnvironmentDataError, match="the beginning of a series of wind, was missing"):
        load_wind(tmp_path / "nothing", GRID)
    with pytest.raises(EnvironmentDataError, match="one file or series of wind"):
        load_wind(tmp_path, GRID)


def test_a_component_without_the_others_is_refused(tmp_path, wind):
    write_components(tmp_path, wind)
    (tmp_path / "wind_0.csv_W").unlink()
    with pytest.raises(EnvironmentDataError, match=r"wind_0\.csv_W: expected a file that can be read"):
        load_wind(tmp_path, GRID)


def test_frames_that_no_memory_holds_are_refused_before_it_is_asked_for(tmp_path):
    path = tmp_path / "uniform.csv"
    path.write_text("1,0,0\n" * 3001)
    large = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, shape=(100, 100, 100))
    with pytest.raises(EnvironmentDataError, match=r"at most 3e\+09 cells in all frames, was 3001000000"):
        load_wind(path, large)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("wind_iteration_0", gaden.wind_2_6),
        ("breeze_0.csv_gaden", gaden.wind_2_6),
        ("breeze_0", gaden.wind_2_6),
        ("breeze_0.csv", gaden.wind_2_6),
        ("wind_iteration_0", lambda wind: gaden.wind_2_6(wind, minor=7)),
    ],
)
def test_winds_of_gaden_2_6_are_read_by_their_content(tmp_path, wind, name, content):
    (tmp_path / name).write_bytes(content(wind))
    for path in (tmp_path, tmp_path / name, tmp_path / re.split(r"_\d", name)[0]):
        np.testing.assert_array_equal(frame(path), wind)


def test_what_gaden_2_6_makes_comes_before_the_tables_beside_it(tmp_path, wind):
    write_points(tmp_path / "wind_0.csv", 2 * wind)
    write_components(tmp_path, 3 * wind)
    (tmp_path / "wind_0.csv_gaden").write_bytes(gaden.wind_2_6(wind))
    np.testing.assert_array_equal(frame(tmp_path), wind)


@pytest.mark.parametrize(
    "text", ["0.5,0,0\n0.25,0.125,0\n", "u v w\n0.5 0 0\n0.25 0.125 0", "# breeze\n0.5;0;0\n0.25;0.125;0\n"]
)
def test_a_uniform_series_is_one_by_folder_parent_beginning_and_file(tmp_path, text):
    folder = tmp_path / "parent" / "fast"
    folder.mkdir(parents=True)
    (folder / "breeze_0.csv").write_text(text)
    (folder / "breeze_1.csv").write_text("0.75 0 0")
    for path in (folder, folder.parent, folder / "breeze", folder / "breeze_"):
        read = load_wind(path, GRID).velocity_m_s
        assert read[:, 1, 1, 1].tolist() == [[0.5, 0, 0], [0.25, 0.125, 0], [0.75, 0, 0]]
    assert len(load_wind(folder / "breeze_0.csv", GRID).velocity_m_s) == 2


def test_arrays_are_a_series_too(tmp_path, wind):
    for i in (9, 10, 11):
        np.save(tmp_path / f"wind.{i:04d}.npy", x_first(wind + i).astype(float))
    np.testing.assert_array_equal(load_wind(tmp_path, GRID).velocity_m_s, [wind + 9, wind + 10, wind + 11])


def test_a_series_is_of_one_kind_and_has_each_number_once(tmp_path, wind):
    write_points(tmp_path / "wind_0.csv", wind)
    (tmp_path / "wind_1.csv").write_text("1,0,0\n")
    with pytest.raises(
        EnvironmentDataError, match=r"one kind of wind, was .* in wind_0.csv; uniform wind in wind_1.csv"
    ):
        load_wind(tmp_path, GRID)
    (tmp_path / "wind_1.csv").write_text("")
    with pytest.raises(EnvironmentDataError, match=r"wind_1.csv: expected lines of wind, was an empty file"):
        load_wind(tmp_path, GRID)
    for name in ("wind_1.csv", "wind_01.csv"):
        write_points(tmp_path / name, wind)
    with pytest.raises(EnvironmentDataError, match=r"one file with number 1, was wind_01.csv and wind_1.csv"):
        load_wind(tmp_path, GRID)


def test_a_line_of_three_numbers_for_each_cell_is_no_series_of_frames(tmp_path, wind):
    np.savetxt(tmp_path / "wind_0.csv", x_first(wind), delimiter=",")
    with pytest.raises(EnvironmentDataError, match=r"24 lines, as many as cells\. Wind of each cell needs its places"):
        load_wind(tmp_path, GRID)


@pytest.mark.parametrize(
    "blank",
    [
        *("-1e300", "-1e+300", "1e30", "-9999", "-999", "-99.99", "-999.9", "1e38", "9.969209968386869e+36", "nan"),
        *("NaN", "", "--", "32767"),
    ],
)
def test_what_stands_for_no_value_is_named_with_line_and_remedy(tmp_path, blank):
    rows = ["x,y,z,u,v,w", "0.25,-0.75,0.75,0.5,0,0", f"0.75,-0.75,0.75,{blank},0,0"]
    (tmp_path / "wind.csv").write_text("\n".join(rows))
    with pytest.raises(EnvironmentDataError, match=r"line 3, column 4.*Leave samples without a value out"):
        load_wind(tmp_path / "wind.csv", GRID)


def test_masked_samples_are_named_though_their_numbers_look_like_still_air(tmp_path):
    head = '"U:0","U:1","U:2","Points:0","Points:1","Points:2","vtkValidPointMask"'
    (tmp_path / "wind.csv").write_text(f"{head}\n1,0,0,0.25,-0.75,0.75,1\n0,0,0,0.75,-0.75,0.75,0\n")
    with pytest.raises(EnvironmentDataError, match=r"vtkValidPointMask 0, the first in line 3\. Leave samples"):
        load_wind(tmp_path / "wind.csv", GRID)


def test_blanks_of_arrays_and_results_are_named_by_their_cell(tmp_path, wind):
    wind[1, 2, 3, 0] = 9.96921e36
    np.save(tmp_path / "own.npy", wind)
    np.save(tmp_path / "cells.npy", x_first(wind))
    (tmp_path / "wind_iteration_0").write_bytes(gaden.wind_2_6(wind))
    for name in ("own.npy", "cells.npy", "wind_iteration_0"):
        with pytest.raises(EnvironmentDataError, match=r"9\.96921e\+36 in cell \[1, 2, 3\], which is no value"):
            load_wind(tmp_path / name, GRID)


def write_case(folder, wind, times, places):
    for i, name in enumerate(times):
        write_foam(folder / name, (i + 1) * wind)
        if name not in places:
            (folder / name / "C").unlink()
    for name in set(places) - set(times):
        write_foam(folder / name, wind)
        (folder / name / "U").unlink()


@pytest.mark.parametrize("place", ["0", "1e-05", "0.1", "10", "constant"])
def test_centres_in_one_place_are_those_of_all_times(tmp_path, wind, place):
    times = ["0", "1e-05", "0.1", "10"]
    write_case(tmp_path, wind, times, [place])
    with pytest.warns(WindGapsWarning, match="not evenly spaced"):
        read = load_wind(tmp_path, GRID).velocity_m_s
    np.testing.assert_array_equal(read, [wind, 2 * wind, 3 * wind, 4 * wind])
    np.testing.assert_array_equal(frame(tmp_path / "10"), 4 * wind)


def test_times_without_velocities_are_named(tmp_path, wind):
    write_case(tmp_path, wind, ["0", "1", "2"], ["0"])
    (tmp_path / "1" / "U").rename(tmp_path / "1" / "p")
    with pytest.warns(WindGapsWarning, match="the times 1 have no U and are left out"):
        assert len(load_wind(tmp_path, GRID).velocity_m_s) == 2


def test_a_mesh_that_moves_needs_its_centres_in_each_time(tmp_path, wind):
    write_case(tmp_path, wind, ["0", "1", "2"], ["0", "1"])
    path = tmp_path / "1" / "C"
    path.write_text(path.read_text().replace("(0.25 ", "(0.26 "))
    with pytest.raises(EnvironmentDataError, match="C in each time of a mesh that moves, was none in 2"):
        load_wind(tmp_path, GRID)
    (tmp_path / "2" / "C").write_text(path.read_text())
    assert len(load_wind(tmp_path, GRID).velocity_m_s) == 3
    (tmp_path / "1" / "C").unlink()
    (tmp_path / "2" / "C").unlink()
    (tmp_path / "2" / "polyMesh").mkdir()
    (tmp_path / "2" / "polyMesh" / "points").touch()
    with pytest.raises(EnvironmentDataError, match="mesh that moves"):
        load_wind(tmp_path, GRID)


@pytest.mark.parametrize("part", ["processor0", "processors4", "processors4_0-1"])
def test_a_case_in_parts_is_never_its_initial_condition(tmp_path, wind, part):
    write_case(tmp_path, wind, ["0"], ["0"])
    write_case(tmp_path / part, wind, ["0", "5"], ["0"])
    for path in (tmp_path, tmp_path / part, tmp_path / part / "5"):
        with pytest.raises(EnvironmentDataError, match="Run reconstructPar"):
            load_wind(path, GRID)
    write_case(tmp_path, wind, ["5"], ["5"])
    assert len(load_wind(tmp_path, GRID).velocity_m_s) == 2


def test_compressed_fields_and_repeated_vectors_are_read(tmp_path, wind):
    write_foam(tmp_path / "0", wind)
    for name in ("U", "C"):
        (tmp_path / "0" / f"{name}.gz").write_bytes(gzip.compress((tmp_path / "0" / name).read_bytes()))
        (tmp_path / "0" / name).unlink()
    np.testing.assert_array_equal(frame(tmp_path), wind)
    text = f"{FOAM_HEAD.format(form='ascii')}internalField nonuniform List<vector> 24{{(1 2 3)}};\n"
    (tmp_path / "0" / "U").write_text(text)
    assert (frame(tmp_path) == [1, 2, 3]).all()
    (tmp_path / "0" / "U").unlink()
    packed = (tmp_path / "0" / "U.gz").read_bytes()
    (tmp_path / "0" / "U.gz").write_bytes(packed[:-20])
    with pytest.raises(EnvironmentDataError, match="a whole gzip file"):
        load_wind(tmp_path, GRID)
