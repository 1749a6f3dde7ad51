"""What is exported comes back the same: occupancy exactly, wind to the last digit of a float32."""

import json

import mujoco
import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell, WindFrames, with_wind
from gslcosim.environment.store import save_environment
from gslcosim.scenario.models.geometry import SimpleWarehouseSpec
from gslcosim.scenario.models.scenario import WindSpec
from gslcosim_formats.environment_folders import import_gaden, import_gsl_bench
from gslcosim_formats.export import GADEN_WINDS, export_environment
from gslcosim_formats.wind_files import load_wind

ROOM = SimpleWarehouseSpec(size_m=(9.0, 8.0, 4.0), seed=1)


@pytest.fixture(scope="module")
def environment():
    """A small warehouse with a rack and three frames of wind that differ everywhere, but in its solids."""
    room = build_layout(ROOM, WindSpec(cell_m=0.5))
    assert len(set(room.grid.shape)) == 3
    wind = np.random.default_rng(3).normal(size=(3, *room.grid.shape, 3)).astype(np.float32)
    wind[:, room.occupancy == Cell.SOLID] = 0.0
    return with_wind(room, WindFrames(velocity_m_s=wind, period_s=0.5, is_looping=False))


def check_same(back, environment):
    """Fail unless occupancy, grid and wind are those that were exported."""
    assert back.grid.shape == environment.grid.shape
    assert back.grid.cell_m == environment.grid.cell_m
    assert back.grid.origin_m == pytest.approx(environment.grid.origin_m)
    np.testing.assert_array_equal(back.occupancy, environment.occupancy)
    np.testing.assert_array_equal(back.wind.velocity_m_s, environment.wind.velocity_m_s)


@pytest.mark.parametrize("gaden_wind", GADEN_WINDS)
def test_gaden_and_back(environment, tmp_path, gaden_wind):
    folder = tmp_path / environment.name
    export = export_environment(environment, folder, "gaden", gaden_wind=gaden_wind)
    assert all(path.is_file() for path in export.files)
    assert export.notices == (
        "GADEN's files hold neither inlets nor timing: frames are 0.5 s apart and the wind does not loop; "
        "set wind_time_step and allow_looping.",
    )
    back = import_gaden(folder, period_s=0.5, is_looping=False)
    check_same(back, environment)
    assert back.name == environment.name
    outlets = [opening for opening in environment.openings if opening.kind == "outlet"]
    assert [(o.min_m, o.max_m) for o in back.openings] == [
        (pytest.approx(o.min_m), pytest.approx(o.max_m)) for o in outlets
    ]


def test_gsl_bench_and_back(environment, tmp_path):
    export = export_environment(environment, tmp_path / "out", "gsl_bench")
    head, grid, wind = (path.relative_to(tmp_path / "out").as_posix() for path in export.files)
    name = environment.name
    assert (head, grid, wind) == (
        f"occupancy/{name}_head.txt", f"occupancy/{name}_grid.npy", f"wind_data/{name}.npy"
    )  # fmt: skip
    codes = np.load(tmp_path / "out" / grid)
    assert codes.shape == tuple(environment.occupancy.shape[axis] for axis in (2, 0, 1))
    assert json.loads((tmp_path / "out" / head).read_text())["num_cells"] == list(environment.grid.shape)
    check_same(import_gsl_bench(tmp_path / "out"), environment)


def test_openfoam_points_and_back(environment, tmp_path):
    export = export_environment(environment, tmp_path / "out", "openfoam_points")
    assert [path.name for path in export.files] == ["U_0.csv", "U_1.csv", "U_2.csv"]
    assert export.files[0].read_text().startswith("x,y,z,Ux,Uy,Uz\n")
    back = load_wind(tmp_path / "out", environment.grid, occupancy=environment.occupancy)
    np.testing.assert_array_equal(back.velocity_m_s, environment.wind.velocity_m_s)


@pytest.mark.extras
def test_vtk_itself_reads_what_is_written(environment, tmp_path):
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    *frames, series = export_environment(environment, tmp_path / "out", "vtk").files
    assert [path.suffix for path in frames] == [".vti"] * 3
    for i, path in enumerate(frames):
        reader = vtkXMLImageDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        image = reader.GetOutput()
        assert image.GetDimensions() == tuple(n + 1 for n in environment.grid.shape)
        assert image.GetOrigin() == pytest.approx(environment.grid.origin_m)
        assert image.GetSpacing() == (environment.grid.cell_m,) * 3
        cells = {name: cell_array(image, name, environment.grid) for name in ("wind", "speed", "occupancy")}
        np.testing.assert_array_equal(cells["wind"], environment.wind.velocity_m_s[i])
        np.testing.assert_array_equal(cells["occupancy"], environment.occupancy)
        np.testing.assert_allclose(cells["speed"], np.linalg.norm(cells["wind"], axis=-1))
        assert f'timestep="{i * 0.5}"' in series.read_text()
        assert f'file="{path.name}"' in series.read_text()


def cell_array(image, name, grid):
    """Return an array of VTK, whose cells have x fastest, as [x, y, z]."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    values = vtk_to_numpy(image.GetCellData().GetArray(name))
    return np.swapaxes(values.reshape(*grid.shape[::-1], *values.shape[1:]), 0, 2)


def test_mjcf_has_all_boxes(environment, tmp_path):
    (scene,) = export_environment(environment, tmp_path / "out", "mjcf").files
    assert mujoco.MjModel.from_xml_path(str(scene)).ngeom == len(environment.boxes)


def test_stl_has_the_room(environment, tmp_path):
    (file,) = export_environment(environment, tmp_path / "out", "stl").files
    text = file.read_text()
    assert [line.split()[1] for line in text.splitlines() if line.startswith("solid ")] == [
        box.name for box in environment.boxes
    ]
    (gaden,) = (p for p in export_environment(environment, tmp_path / "gaden", "gaden").files if p.suffix == ".stl")
    assert gaden.read_text() == text


def test_a_folder_with_files_is_refused(environment, tmp_path):
    (tmp_path / "wind_3.csv_U").touch()
    with pytest.raises(EnvironmentDataError, match="Choose a new or empty folder"):
        export_environment(environment, tmp_path, "gaden")
    assert [path.name for path in tmp_path.iterdir()] == ["wind_3.csv_U"]


@pytest.mark.extras
@pytest.mark.parametrize("to", ["netcdf", "zarr"])
def test_gridded_files_hold_every_cell_with_its_coordinates_and_units(environment, tmp_path, to):
    xarray = pytest.importorskip("xarray")
    (path,) = export_environment(environment, tmp_path / "out", to).files
    with xarray.open_dataset(path, engine={"netcdf": "h5netcdf", "zarr": "zarr"}[to]) as dataset:
        wind = np.stack([dataset[f"wind_{axis}_m_s"].values for axis in "xyz"], axis=-1)
        np.testing.assert_array_equal(wind, environment.wind.velocity_m_s)
        np.testing.assert_array_equal(dataset["occupancy"].values, environment.occupancy)
        np.testing.assert_allclose(dataset["y_m"].values, environment.grid.axis_centres_m(1))
        assert dataset["time_s"].values.tolist() == [0.0, 0.5, 1.0]
        assert dataset["wind_x_m_s"].attrs["units"] == "m s-1"
        assert dataset.attrs["history"]


def _filled_coordinates(path):
    """Coordinates of a file with a value for gaps, which CF 2.5.1 forbids."""
    h5netcdf = pytest.importorskip("h5netcdf")
    with h5netcdf.File(path, "r") as file:
        names = [*file.dimensions, *str(file.attrs.get("coordinates", "")).split()]
        assert names
        return [name for name in names if "_FillValue" in file.variables[name].attrs]


@pytest.mark.extras
def test_coordinates_have_no_value_for_gaps_whoever_writes_the_file(environment, tmp_path):
    """Neither in our file, nor where a user saves our folder or a part of it by xarray."""
    xarray = pytest.importorskip("xarray")
    (path,) = export_environment(environment, tmp_path / "out", "netcdf").files
    assert _filled_coordinates(path) == []
    dataset = xarray.open_dataset(save_environment(environment, tmp_path / "room") or tmp_path / "room")
    for part in (dataset, dataset.isel(time_s=0), dataset[["wind_x_m_s"]]):
        part.to_netcdf(tmp_path / "saved.nc", engine="h5netcdf")
        assert _filled_coordinates(tmp_path / "saved.nc") == []


@pytest.mark.extras
def test_xarray_opens_an_environment_folder(environment, tmp_path):
    xarray = pytest.importorskip("xarray")
    folder = save_environment(environment, tmp_path / "environment")
    dataset = xarray.open_dataset(folder or tmp_path / "environment", drop_variables=["occupancy"])
    np.testing.assert_array_equal(dataset["wind_z_m_s"].values, environment.wind.velocity_m_s[..., 2])
    assert "occupancy" not in dataset
