"""Gas and wind of one instant, from folders and from rooms."""

import shutil

import gaden_writers as gaden
import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError, UsageError
from gslcosim.contract.participant import Episode
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.mixing_ratio import Walls, mixing_ratio_ppm_at
from gslcosim_services.fields.offline import (
    Instant,
    ScenarioFieldSampler,
    ViewOptions,
    build_lattice,
    find_stored_field_sampler,
)

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


@pytest.fixture
def scenario(make_scenario):
    plain = make_scenario()
    gas = plain.gas.model_copy(update={"warm_up_s": 20.0})
    return plain.model_copy(update={"gas": gas})


def test_the_lattice_is_that_of_the_world_whatever_the_walls_thickness():
    """GSL-Bench's rooms reach 0.2 m into their walls; its published grids do not."""
    lattice = build_lattice((-0.2, -0.2, 0.0), (15.2, 15.2, 8.0), 0.25)
    assert (lattice.first_m, lattice.shape) == ((0.125, 0.125, 0.125), (60, 60, 32))
    assert build_lattice((0.0, 0.0, 0.0), (15.0, 10.0, 6.0), 0.25).shape == (60, 40, 24)
    np.testing.assert_allclose(lattice.points_m()[[0, 1, 32, -1]], [
        (0.125, 0.125, 0.125), (0.125, 0.125, 0.375), (0.125, 0.375, 0.125), (14.875, 14.875, 7.875),
    ])  # fmt: skip


def test_a_lattice_wider_than_the_room_is_refused():
    with pytest.raises(UsageError, match="expected a spacing below the sides"):
        build_lattice((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 2.0)


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


def test_a_folder_of_another_kind_is_none(tmp_path):
    assert find_stored_field_sampler(tmp_path) is None


def test_gadens_frames_are_half_a_second_apart_unless_set(results):
    fields = find_stored_field_sampler(results)
    by_time = fields.gas_ppm(PLACES, Instant(time_s=0.6), THROUGH_WALLS)
    np.testing.assert_array_equal(by_time, fields.gas_ppm(PLACES, Instant(frame=1), THROUGH_WALLS))
    with pytest.raises(UsageError, match=r"from 0 s to below 1 s \(2 frames, 0.5 s apart\), was 1 s"):
        fields.gas_ppm(PLACES, Instant(time_s=1.0), THROUGH_WALLS)
    slow = find_stored_field_sampler(results, period_s=2.0)
    assert slow.gas_ppm(PLACES, Instant(time_s=3.9), THROUGH_WALLS) == pytest.approx(by_time)


def test_a_frame_that_is_not_there_is_refused(results):
    with pytest.raises(EnvironmentDataError, match=r"among 0 to 1 \(2 frames\), was 7"):
        find_stored_field_sampler(results).gas_ppm(PLACES, Instant(frame=7), THROUGH_WALLS)


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


def test_a_room_is_sampled_as_its_run_is(scenario, make_room):
    """The same instant, asked of the room and of the run's own fields."""
    room = make_room(wind_m_s=((0.3, 0.1, 0.0),))
    core = FieldsCore(scenario, room)
    core.reset(Episode(seed=scenario.seed))
    core.gas.advance(30)
    points = np.array([(5.5, 1.2, 2.0), (6.0, 1.4, 2.1)])
    expected = mixing_ratio_ppm_at(points, core.gas.filaments, walls=Walls.of(room))[:, 0]
    assert expected.min() > 0.0
    fields = ScenarioFieldSampler(room, scenario)
    for instant in (Instant(time_s=3.0), Instant(time_s=3.05), Instant(frame=30)):
        np.testing.assert_allclose(fields.gas_ppm(points, instant, ViewOptions()), expected, rtol=1e-12)
    np.testing.assert_allclose(fields.wind_m_s(points, Instant(frame=30)), [(0.3, 0.1, 0.0)] * 2, rtol=1e-6)


def test_a_rooms_grid_is_the_values_at_its_points(scenario, make_room):
    fields = ScenarioFieldSampler(make_room(wind_m_s=((0.3, 0.1, 0.0),)), scenario)
    lattice = build_lattice((4.0, 0.0, 1.0), (7.0, 2.0, 3.0), 0.5)
    for view in (ViewOptions(), THROUGH_WALLS, ViewOptions(has_line_of_sight=False, cutoff_sigma=2.0)):
        volume = fields.gas_ppm_on(lattice, Instant(time_s=0.0), view)
        points = fields.gas_ppm(lattice.points_m(), Instant(time_s=0.0), view)
        np.testing.assert_allclose(volume.reshape(-1), points, rtol=1e-9)
    assert volume.max() > 0.0


def test_an_environment_alone_has_wind_and_no_gas(make_room):
    fields = ScenarioFieldSampler(make_room(wind_m_s=((0.1, 0.0, 0.0), (0.2, 0.0, 0.0))))
    points = np.array([(5.0, 1.0, 2.0)])
    winds = [fields.wind_m_s(points, instant)[0, 0] for instant in (Instant(time_s=1.5), Instant(frame=0))]
    assert winds == pytest.approx([0.2, 0.1])
    with pytest.raises(UsageError, match="one of the wind's frames, 0 to 1, was 2"):
        fields.wind_m_s(points, Instant(frame=2))
    with pytest.raises(UsageError, match="Add --scenario SCENARIO"):
        fields.gas_ppm(points, Instant(time_s=0.0), ViewOptions())


def test_another_gas_can_be_asked_for(scenario, make_room):
    sources = (*scenario.gas.sources, scenario.gas.sources[0].model_copy(update={"gas": "methane", "ppm": 50.0}))
    both = scenario.model_copy(update={"gas": scenario.gas.model_copy(update={"sources": sources})})
    points = np.array([(5.0, 1.0, 2.0)])
    ethanol, methane = (
        ScenarioFieldSampler(make_room(), both, gas=gas).gas_ppm(points, Instant(time_s=0.0), ViewOptions())[0]
        for gas in ("ethanol", "methane")
    )
    assert methane > 2 * ethanol > 0.0
    with pytest.raises(UsageError, match="--gas: expected one of ethanol, methane, was 'xenon'"):
        ScenarioFieldSampler(make_room(), both, gas="xenon").gas_ppm(points, Instant(time_s=0.0), ViewOptions())
