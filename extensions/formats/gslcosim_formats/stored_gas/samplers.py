"""Samples of stored gas and its wind, of one instant.

GSL-Bench environment folder  occupancy/, gas_data/<name>/iteration_i_fil.npy, wind_data/<name>.npy if it has wind
GADEN result folder           iteration_i, wind/wind_iteration_i, OccupancyGrid3D.csv in it or above it
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim.base.errors import EnvironmentDataError, UsageError
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.model import Grid
from gslcosim_formats.data_files import read_array_frame, read_result
from gslcosim_formats.environment_folders import load_gsl_bench_geometry
from gslcosim_formats.field_samplers import FieldSampler, Instant, ViewOptions, read_in_chunks
from gslcosim_formats.stored_gas.frame_formats import GasFrame, find_occupancy, read_walls
from gslcosim_formats.stored_gas.playback import GasPlayback, default_period_s, values_in_cells
from gslcosim_services.fields.gas_field import PointGrid
from gslcosim_services.fields.mixing_ratio import CUTOFF_SIGMA, Walls, check_points, mixing_ratio_ppm_on_grid
from gslcosim_services.fields.spatial_index import FilamentIndex

# From a project of GADEN down to the frames of one of its simulations.
MAX_FOLDER_DEPTH = 4

StoredWind = Callable[[NDArray[np.float64], GasFrame], NDArray[np.float64]]


class StoredFieldSampler(FieldSampler):
    """Gas frames of a folder, with the walls and the wind that belong to them."""

    def __init__(self, playback: GasPlayback, *, walls: Callable[[], Walls], wind: StoredWind) -> None:
        self._playback = playback
        self._walls = walls
        self._wind = wind

    @override
    def grid(self, instant: Instant) -> Grid:
        return self._frame(instant).grid

    @override
    def gas_ppm(self, points_world_m: NDArray[np.float64], instant: Instant, view: ViewOptions) -> NDArray[np.float64]:
        points, frame = check_points(points_world_m), self._frame(instant)
        if frame.filaments is None:
            return values_in_cells(frame, points)
        index = FilamentIndex(min_m=frame.grid.origin_m, max_m=frame.grid.max_m)
        index.build(frame.filaments)
        walls = _check_walls_fit(self._walls(), frame) if view.has_line_of_sight else None
        cutoff_sigma = CUTOFF_SIGMA if view.cutoff_sigma is None else view.cutoff_sigma
        return read_in_chunks(
            lambda some: index.mixing_ratio_ppm_at(some, walls=walls, cutoff_sigma=cutoff_sigma)[:, 0], points
        )

    @override
    def gas_ppm_on(self, grid: PointGrid, instant: Instant, view: ViewOptions) -> NDArray[np.float64]:
        filaments = self._frame(instant).filaments
        if filaments is None or view.has_line_of_sight:
            return self.gas_ppm(grid.points_m(), instant, view).reshape(grid.shape)
        cutoff_sigma = CUTOFF_SIGMA if view.cutoff_sigma is None else view.cutoff_sigma
        return mixing_ratio_ppm_on_grid(
            filaments,
            first_point_m=grid.first_m,
            spacing_m=grid.spacing_m,
            shape=grid.shape,
            cutoff_sigma=cutoff_sigma,
        )

    @override
    def wind_m_s(self, points_world_m: NDArray[np.float64], instant: Instant) -> NDArray[np.float64]:
        return self._wind(check_points(points_world_m), self._frame(instant))

    def _frame(self, instant: Instant) -> GasFrame:
        return self._playback.frame(self._number(instant))

    # A time past the last frame is a mistake here; a run goes on with the last frame.
    def _number(self, instant: Instant) -> int:
        if instant.time_s is None:
            assert instant.frame is not None, "an Instant has either"
            return instant.frame
        numbers, period_s = self._playback.numbers, self._playback.period_s
        end_s = (numbers[-1] + 1) * period_s
        number = self._playback.number_at(instant.time_s)
        if number is None or instant.time_s >= end_s:
            raise UsageError(
                f"--time: expected a time from {numbers[0] * period_s:g} s to below {end_s:g} s "
                f"({len(numbers)} frames, {period_s:g} s apart), was {instant.time_s:g} s."
            )
        return number


def find_stored_field_sampler(folder: Path, *, period_s: float | None = None) -> StoredFieldSampler | None:
    """Find gas and wind of GSL-Bench or GADEN in a folder; nothing when it holds neither.

    Args:
        folder: An environment of GSL-Bench, its gas folder, or a result folder of GADEN, or a folder some way above it.
        period_s: Time between frames [s]; absent: 1 for GSL-Bench, 0.5 for GADEN, their usual values.
    """
    gas_folder = _find_gas_folder(folder)
    if gas_folder is None:
        return None
    is_gsl_bench = any(gas_folder.glob("iteration_*_fil.npy"))
    playback = GasPlayback(gas_folder, period_s=default_period_s(gas_folder) if period_s is None else period_s)
    if is_gsl_bench:
        room_folder = _find_room_folder(gas_folder)
        return StoredFieldSampler(
            playback,
            walls=lambda: _read_gsl_bench_walls(room_folder),
            wind=lambda points, frame: _gsl_bench_wind(room_folder, frame, points),
        )
    return StoredFieldSampler(
        playback,
        walls=lambda: _read_gaden_walls(gas_folder),
        wind=lambda points, frame: _gaden_wind(gas_folder, frame, points),
    )


def _find_gas_folder(folder: Path) -> Path | None:
    with_frames = sorted(path for path in _list_subfolders(folder) if any(path.glob("iteration_*")))
    if len(with_frames) > 1:
        names = ", ".join(str(path) for path in with_frames)
        raise EnvironmentDataError(f"gas frames: expected one folder of them, was {names}. Name one of these.")
    return with_frames[0] if with_frames else None


# The folder itself and those a few levels below it, but none within a folder of frames.
def _list_subfolders(folder: Path, n_levels: int = MAX_FOLDER_DEPTH) -> Iterator[Path]:
    yield folder
    if n_levels and not any(folder.glob("iteration_*")):
        for path in folder.iterdir():
            if path.is_dir():
                yield from _list_subfolders(path, n_levels - 1)


# Gas lies in gas_data, or in a folder of that, beside the room's occupancy.
def _find_room_folder(gas_folder: Path) -> Path:
    above = gas_folder.resolve()
    rooms = [path for path in (above, *above.parents[:2]) if (path / "occupancy").is_dir()]
    return rooms[0] if rooms else gas_folder


def _read_gsl_bench_walls(room_folder: Path) -> Walls:
    room = load_gsl_bench_geometry(room_folder)
    return Walls.of_occupancy(room.occupancy, room.grid)


def _gsl_bench_wind(room_folder: Path, frame: GasFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    files = sorted((room_folder / "wind_data").glob("*.npy"))
    if len(files) != 1:
        found = ", ".join(path.name for path in files) or "none (GSL-Bench publishes no wind)"
        raise EnvironmentDataError(f"wind: expected one file wind_data/*.npy, was {found}. Folder: {room_folder}")
    wind = read_array_frame(files[0], frame.grid, frame.wind_index)
    return trilinear_wind_at_points(wind, frame.grid.origin_m, frame.grid.cell_m, points)


def _read_gaden_walls(gas_folder: Path) -> Walls:
    path = find_occupancy(gas_folder)
    if path is None:
        raise EnvironmentDataError(
            "walls: expected an OccupancyGrid3D.csv in the result folder or above it, was none. Put it there, or let "
            f"gas be seen through walls: --no-line-of-sight. Folder: {gas_folder}"
        )
    return read_walls(path)


def _gaden_wind(gas_folder: Path, frame: GasFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    wind = read_result(gas_folder / "wind" / f"wind_iteration_{frame.wind_index}", frame.grid)
    return trilinear_wind_at_points(wind, frame.grid.origin_m, frame.grid.cell_m, points)


# Walls of another room would hide the wrong gas.
def _check_walls_fit(walls: Walls, frame: GasFrame) -> Walls:
    grid = frame.grid
    found, expected = [*walls.origin_m, walls.cell_m], [*grid.origin_m, grid.cell_m]
    is_same_place = np.allclose(found, expected, rtol=0.0, atol=1e-3 * grid.cell_m)
    if walls.occupancy.shape != grid.shape or not is_same_place:
        raise EnvironmentDataError(
            f"walls: expected those of the frames, {grid.shape} cells of {grid.cell_m:g} m from {grid.origin_m} m, was "
            f"{walls.occupancy.shape} cells of {walls.cell_m:g} m from {tuple(map(float, walls.origin_m))} m. Let gas "
            "be seen through walls with --no-line-of-sight, or put the room of the frames beside them."
        )
    return walls
