"""Playback of stored gas at its true speed: folders of frames, and films in one array file.

The file is numpy's `.npz` with

    time_s             (t,) times of the pictures, ascending [s]
    mixing_ratio_ppm   (t, nx, ny, nz), or (t, nx, ny) for a plane that holds at all heights [ppm by volume]
    origin_m           (3,) corner of cell (0, 0, 0), world frame [m]; of a plane the z does not matter
    cell_m             edge of the cubic cells [m]
"""

import re
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.untrusted_input import read_npz
from gslcosim.environment.model import Grid
from gslcosim_formats.stored_gas.frame_formats import MAX_CENTRE_PPM, GasFrame, read_gaden_frame, read_gsl_bench_frame
from gslcosim_services.fields.filament.filament_step import cell_index
from gslcosim_services.fields.mixing_ratio import (
    CUTOFF_SIGMA,
    Walls,
    check_points,
    mixing_ratio_ppm_at,
    to_float3,
)

GSL_BENCH_PERIOD_S = 1.0
GADEN_PERIOD_S = 0.5

_GADEN_NAME = re.compile(r"iteration_(\d+)")
_GSL_BENCH_NAME = re.compile(r"iteration_(\d+)_fil\.npy")
MOVIE_SUFFIX = ".npz"
_MAX_MOVIE_BYTES = 16 << 30
_MOVIE_ARRAYS = ("time_s", "mixing_ratio_ppm", "origin_m", "cell_m")


class GasPlayback:
    """The frames of a GADEN result folder, or of a gas folder of GSL-Bench or AutoGDM+.

    Frame i holds from i * period_s until the next one that is there. Before the first frame there is no gas; after the
    last, time loops over the whole or the last frame stays. One frame at a time is kept in memory.
    """

    def __init__(self, folder: Path, *, period_s: float, is_looping: bool = False) -> None:
        """Find the frames of a folder.

        Args:
            folder: Holds `iteration_i` or `iteration_i_fil.npy` and `iteration_i_head.npy`.
            period_s: Time between frame i and frame i + 1 [s]; see `default_period_s`.
            is_looping: Whether time begins again after the last frame.
        """
        self._paths = _find_frames(folder)
        self._numbers = np.array(sorted(self._paths))
        self._period_s = period_s
        self._is_looping = is_looping
        self._current: tuple[int, GasFrame] | None = None
        self._first: GasFrame | None = None

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of the frames that are there, ascending."""
        return tuple(self._numbers.tolist())

    @property
    def period_s(self) -> float:
        """Time between frame i and frame i + 1 [s]."""
        return self._period_s

    def number_at(self, time_s: float) -> int | None:
        """Return the number of the frame that holds at a time [s]; none before the first."""
        position = int(time_s / self._period_s + 1e-9)
        if self._is_looping:
            position %= int(self._numbers[-1]) + 1
        i = int(np.searchsorted(self._numbers, position, side="right")) - 1
        return int(self._numbers[i]) if i >= 0 else None

    def frame(self, number: int) -> GasFrame:
        """Return a frame by its number; the last one asked for is kept."""
        if number not in self._paths:
            raise EnvironmentDataError(
                f"gas frames: expected a number among {_span(self._numbers)}, was {number}. "
                f"Folder: {next(iter(self._paths.values())).parent}"
            )
        if self._current is None or self._current[0] != number:
            self._current = (number, self._read(number))
        return self._current[1]

    # What the formats repeat in every frame finds the damage that no checksum does.
    def _read(self, number: int) -> GasFrame:
        frame = _read_frame(self._paths[number])
        if self._first is None:
            self._first = _read_frame(self._paths[int(self._numbers[0])])
        expected, found = _grid_constants(self._first), _grid_constants(frame)
        if frame.version == self._first.version and found != expected:
            raise EnvironmentDataError(
                f"gas frames: expected grid, gas and moles of all filaments as in frame {self._numbers[0]}, "
                f"{expected}, was {found}. File: {self._paths[number]}"
            )
        return frame

    def frame_at(self, time_s: float) -> GasFrame | None:
        """Return the frame that holds at a time [s]; none before the first."""
        number = self.number_at(time_s)
        return None if number is None else self.frame(number)

    def mixing_ratio_ppm_at(
        self,
        points_world_m: NDArray[np.float64],
        time_s: float,
        *,
        walls: Walls | None = None,
        cutoff_sigma: float = CUTOFF_SIGMA,
    ) -> NDArray[np.float64]:
        """Return the (m,) mixing ratio [ppm by volume] at (m, 3) points and a time [s].

        Stored grids give the value of the cell that holds a point, and 0 outside; walls do not matter to them.
        """
        points = check_points(points_world_m)
        frame = self.frame_at(time_s)
        if frame is None:
            return np.zeros(len(points))
        if frame.filaments is not None:
            return mixing_ratio_ppm_at(points, frame.filaments, walls=walls, cutoff_sigma=cutoff_sigma)[:, 0]
        return values_in_cells(frame, points)


@numba.njit(cache=True, nogil=True)
def value_in_cell(ppm, origin_m, cell_m, is_plane, x, y, z):  # noqa: ANN001, ANN201 - a kernel
    """Return the value of the cell of a stored grid that holds a point; 0 outside.

    Args:
        ppm: (nx, ny, nz) values.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cells [m].
        is_plane: Whether the grid's one layer holds at all heights.
        x: Point, world frame [m]; y and z likewise.
        y: See x.
        z: See x.

    Held by:
        extensions/formats/tests/unit/stored_gas/test_movie.py
    """
    i, j = cell_index(x, origin_m[0], cell_m), cell_index(y, origin_m[1], cell_m)
    k = 0 if is_plane else cell_index(z, origin_m[2], cell_m)
    nx, ny, nz = ppm.shape
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return 0.0
    return np.float64(ppm[i, j, k])


@numba.njit(cache=True, nogil=True)
def _write_values_inplace(values, ppm, origin_m, cell_m, is_plane, points):  # noqa: ANN001, ANN202 - a kernel
    for n in range(len(values)):
        values[n] = value_in_cell(ppm, origin_m, cell_m, is_plane, points[n, 0], points[n, 1], points[n, 2])


def values_in_cells(frame: GasFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (m,) values of the cells of a stored grid that hold (m, 3) points, world frame [m]; 0 outside."""
    values = np.zeros(len(points))
    if frame.mixing_ratio_ppm is not None:
        grid = frame.grid
        origin_m, cell_m = to_float3(grid.origin_m), float(grid.cell_m)
        _write_values_inplace(values, frame.mixing_ratio_ppm, origin_m, cell_m, frame.is_plane, points)
    return values


def default_period_s(folder: Path) -> float:
    """Return the time between frames that such a folder usually has [s]: 1 for GSL-Bench, 0.5 for GADEN."""
    return GSL_BENCH_PERIOD_S if any(folder.glob("iteration_*_fil.npy")) else GADEN_PERIOD_S


def _read_frame(path: Path) -> GasFrame:
    return read_gsl_bench_frame(path) if path.suffix == ".npy" else read_gaden_frame(path)


def _grid_constants(frame: GasFrame) -> tuple[Grid, str | None, float | None]:
    amount_mol = None if frame.filaments is None else float(frame.filaments.amount_mol[0])
    return (frame.grid, frame.gas, amount_mol)


def _find_frames(folder: Path) -> dict[int, Path]:
    found: dict[int, Path] = {}
    names = sorted(folder.iterdir()) if folder.is_dir() else []
    for path in names:
        match = _GSL_BENCH_NAME.fullmatch(path.name) or _GADEN_NAME.fullmatch(path.name)
        if match and path.is_file():
            found[int(match[1])] = path
    if not found:
        raise EnvironmentDataError(
            f"gas frames: expected files iteration_0, iteration_1, … or iteration_0_fil.npy, …, was none. "
            f"Folder: {folder}"
        )
    return found


def _span(numbers: NDArray[np.int64]) -> str:
    return f"{numbers[0]} to {numbers[-1]} ({len(numbers)} frames)"


class GasMovie:
    """Pictures of gas, played by their times.

    A picture holds from its time until that of the next; before the first there is no gas. After the last it stays, or
    time begins again: then the last lasts as long as the one before it. Nothing is interpolated.
    """

    def __init__(self, path: Path, *, is_looping: bool = False) -> None:
        """Read a film."""
        arrays = _load_movie(path)
        times_s, ppm = np.asarray(arrays["time_s"], np.float64), arrays["mixing_ratio_ppm"]
        self._is_plane = ppm.ndim == 3
        ppm = ppm[..., None] if self._is_plane else ppm
        problem = _find_movie_problem(times_s, ppm, arrays["origin_m"], arrays["cell_m"])
        if problem:
            raise EnvironmentDataError(f"gas movie: expected {problem}. File: {path}")
        self._times_s = times_s
        self._ppm = ppm.astype(np.float32)
        x, y, z = np.asarray(arrays["origin_m"], np.float64).tolist()
        nx, ny, nz = ppm.shape[1:]
        self._grid = Grid(origin_m=(x, y, z), cell_m=float(arrays["cell_m"]), shape=(nx, ny, nz))
        self._is_looping = is_looping

    @property
    def duration_s(self) -> float:
        """Time from the first picture to the end of the last [s]."""
        last_s = float(self._times_s[-1] - self._times_s[-2]) if len(self._times_s) > 1 else 0.0
        return float(self._times_s[-1] - self._times_s[0]) + last_s

    def number_at(self, time_s: float) -> int | None:
        """Return the number of the picture that holds at a time [s]; none before the first."""
        if self._is_looping and self.duration_s > 0.0 and time_s >= self._times_s[0]:
            time_s = float(self._times_s[0]) + (time_s - float(self._times_s[0])) % self.duration_s
        i = int(np.searchsorted(self._times_s, time_s + 1e-9, side="right")) - 1
        return i if i >= 0 else None

    def frame_at(self, time_s: float) -> GasFrame | None:
        """Return the picture that holds at a time [s]; none before the first."""
        number = self.number_at(time_s)
        return None if number is None else self.frame(number)

    def frame(self, number: int) -> GasFrame:
        """Return a picture by its number, from 0."""
        return GasFrame(
            version="movie",
            grid=self._grid,
            gas=None,
            source_position_m=None,
            wind_index=0,
            filaments=None,
            mixing_ratio_ppm=self._ppm[number],
            is_plane=self._is_plane,
        )


def _load_movie(path: Path) -> dict[str, NDArray]:
    try:
        stored = read_npz(path, max_bytes=_MAX_MOVIE_BYTES)
    except (OSError, ValueError) as error:
        raise EnvironmentDataError(f"gas movie: cannot be read ({error}). File: {path}") from error
    if missing := [name for name in _MOVIE_ARRAYS if name not in stored]:
        raise EnvironmentDataError(
            f"gas movie: expected arrays {', '.join(_MOVIE_ARRAYS)}, was without {', '.join(missing)}. File: {path}"
        )
    arrays = {name: stored[name] for name in _MOVIE_ARRAYS}
    wrong = [f"{name} of {array.dtype}" for name, array in arrays.items() if array.dtype.kind not in "fiu"]
    if wrong:
        raise EnvironmentDataError(f"gas movie: expected arrays of numbers, was {', '.join(wrong)}. File: {path}")
    return arrays


def _find_movie_problem(times_s: NDArray, ppm: NDArray, origin_m: NDArray, cell_m: NDArray) -> str | None:
    if ppm.ndim != 4 or not ppm.size:
        return f"mixing ratios of shape (t, nx, ny) or (t, nx, ny, nz), was {ppm.dtype} {ppm.shape}"
    if times_s.shape != ppm.shape[:1] or not np.isfinite(times_s).all() or (np.diff(times_s) <= 0.0).any():
        return f"one ascending time for each of {len(ppm)} pictures, was {times_s.shape}, or not ascending"
    if not ((ppm >= 0) & (ppm <= MAX_CENTRE_PPM)).all():
        return "mixing ratios from 0 to 1e6 ppm, was others among them"
    if origin_m.shape != (3,) or not np.isfinite(origin_m).all() or cell_m.shape != () or not 0 < float(cell_m) < 1e6:
        return f"origin_m of three numbers and cell_m greater than 0, was {origin_m} and {cell_m}"
    return None
