"""Gas and wind of one instant, from folders of stored frames."""

import shutil

import gaden_writers as gaden
import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError, UsageError
from gslcosim_formats.field_samplers import Instant, ViewOptions, build_lattice
from gslcosim_formats.stored_gas.samplers import find_stored_field_sampler

THROUGH_WALLS = ViewOptions(has_line_of_sight=False)
PLACES = gaden.POSITIONS_M[:2]


@pytest.fixture
def results(tmp_path):
    """A result folder of GADEN with filaments in frames 0 and 1 and wind 2, and a wall of one cell around nothing."""
    folder = tmp_path / "result"
    (folder / "wind").mkdir(parents=True)
    for i in range(2):
        (folder / f"iteration_{i}").write_bytes(gaden.compressed(gaden.version_2(minor=5)))
    return folder


def test_the_folder_above_the_results_will_do(results):
    deep = results.parent / "project" / "scenario" / "result"
    deep.mkdir(parents=True)
    results = results.rename(deep / "FilamentSimulation_1")
    for folder in (results, results.parent, results.parents[3]):
        fields = find_stored_field_sampler(folder)
        assert fields.gas_ppm(PLACES, Instant(frame=1), THROUGH_WALLS)[0] == pytest.approx(10.0, rel=0.2)


def test_gas_data_is_found_from_the_environment_down(results, tmp_path):
    """GSL-Bench's folders: the environment, its gas_data, and the one set of frames in it."""
    environment = tmp_path / "001"
    (environment / "gas_data").mkdir(parents=True)
    frames = results.rename(environment / "gas_data" / "wh_empty_001")
    for folder in (tmp_path, environment, environment / "gas_data", frames):
        assert find_stored_field_sampler(folder).grid(Instant(frame=0)).shape == gaden.CELLS
    shutil.copytree(frames, environment / "gas_data" / "another")
    with pytest.raises(EnvironmentDataError, match=r"expected one folder of them, was .*another.*wh_empty_001"):
        find_stored_field_sampler(environment)


def test_the_wind_of_gsl_benchs_folder_is_that_of_the_frames_number(gsl_bench_folder):
    """Cells are numbered x first; a frame without a wind of its number has one from the beginning again."""
    (gsl_bench_folder / "gas_data").mkdir()
    (gsl_bench_folder / "wind_data").mkdir()
    (gsl_bench_folder / "occupancy").mkdir()
    for path in gsl_bench_folder.glob("iteration_0_*.npy"):
        path.rename(gsl_bench_folder / "gas_data" / path.name)
    nx, ny, nz = gaden.CELLS
    numbers = np.arange(nx * ny * nz)
    wind_m_s = np.stack((numbers % nx, numbers // nx % ny, numbers // (nx * ny)), axis=1)
    path = gsl_bench_folder / "wind_data" / "room.npy"
    np.save(path, [wind_m_s.astype(float)])
    centre_m = np.add(gaden.MIN_M, np.multiply((3.5, 2.5, 1.5), gaden.CELL_M))[np.newaxis]
    fields = find_stored_field_sampler(gsl_bench_folder)
    assert fields.wind_m_s(centre_m, Instant(frame=0))[0] == pytest.approx([3.0, 2.0, 1.0])
    np.save(path, [wind_m_s[1:].astype(float)])
    with pytest.raises(EnvironmentDataError, match=r"room\.npy: expected real numbers of \(t, 140, 3\)"):
        fields.wind_m_s(centre_m, Instant(frame=0))
    path.unlink()
    with pytest.raises(EnvironmentDataError, match=r"was none \(GSL-Bench publishes no wind\)"):
        fields.wind_m_s(centre_m, Instant(frame=0))


def test_gadens_frames_are_half_a_second_apart_unless_set(results):
    fields = find_stored_field_sampler(results)
    by_time = fields.gas_ppm(PLACES, Instant(time_s=0.6), THROUGH_WALLS)
    np.testing.assert_array_equal(by_time, fields.gas_ppm(PLACES, Instant(frame=1), THROUGH_WALLS))
    with pytest.raises(UsageError, match=r"from 0 s to below 1 s \(2 frames, 0.5 s apart\), was 1 s"):
        fields.gas_ppm(PLACES, Instant(time_s=1.0), THROUGH_WALLS)
    slow = find_stored_field_sampler(results, period_s=2.0)
    assert slow.gas_ppm(PLACES, Instant(time_s=3.9), THROUGH_WALLS) == pytest.approx(by_time)


def test_grids_are_the_values_at_their_points(results):
    fields = find_stored_field_sampler(results)
    room = fields.grid(Instant(frame=0))
    lattice = build_lattice(room.origin_m, room.max_m, 0.2)
    volume = fields.gas_ppm_on(lattice, Instant(frame=0), THROUGH_WALLS)
    assert volume.max() > 0.0
    points = fields.gas_ppm(lattice.points_m(), Instant(frame=0), THROUGH_WALLS).reshape(lattice.shape)
    np.testing.assert_allclose(volume, points, rtol=1e-10)


def test_without_an_occupancy_there_is_no_line_of_sight(results):
    with pytest.raises(EnvironmentDataError, match=r"expected an OccupancyGrid3D\.csv .* --no-line-of-sight"):
        find_stored_field_sampler(results).gas_ppm(PLACES, Instant(frame=0), ViewOptions())


def write_solid_occupancy(folder, cells):
    nx, ny, nz = cells
    max_m = (low + n * gaden.CELL_M for low, n in zip(gaden.MIN_M, cells, strict=True))
    head = (
        f"#env_min(m) {' '.join(map(str, gaden.MIN_M))}\n#env_max(m) {' '.join(map(str, max_m))}\n"
        f"#num_cells {nx} {ny} {nz}\n#cell_size(m) {gaden.CELL_M}\n"
    )
    solid = "\n".join(["\n".join([" ".join(["1"] * ny)] * nx) + "\n;"] * nz)
    (folder / "OccupancyGrid3D.csv").write_text(head + solid)


def test_walls_of_another_room_are_refused(results):
    write_solid_occupancy(results.parent, (7, 5, 5))
    with pytest.raises(EnvironmentDataError, match=r"expected those of the frames, \(7, 5, 4\) cells of 0\.5 m"):
        find_stored_field_sampler(results).gas_ppm(PLACES, Instant(frame=0), ViewOptions())


def test_walls_hide_stored_gas(results):
    write_solid_occupancy(results.parent, gaden.CELLS)
    fields = find_stored_field_sampler(results)
    assert fields.gas_ppm(PLACES, Instant(frame=0), THROUGH_WALLS).min() > 0.0
    assert fields.gas_ppm(PLACES, Instant(frame=0), ViewOptions()).max() == 0.0


def test_the_wind_of_a_frame_is_the_one_it_names(results):
    nx, ny, nz = gaden.CELLS
    for i in (0, gaden.WIND):
        wind = np.repeat([[0.1 * i], [0.2], [-0.3]], nx * ny * nz, axis=1)
        (results / "wind" / f"wind_iteration_{i}").write_bytes(wind.astype("<f8").tobytes())
    wind_m_s = find_stored_field_sampler(results).wind_m_s(PLACES, Instant(frame=0))
    np.testing.assert_allclose(wind_m_s, [[0.1 * gaden.WIND, 0.2, -0.3]] * 2, rtol=1e-6)
