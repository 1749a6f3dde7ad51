"""Stored gas at its true speed: frames of a folder, by time."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.reading.concentration import CUTOFF_SIGMA, Walls, checked_points, mixing_ratio_ppm_at
from gslcosim.fields.stored.frame import GasFrame
from gslcosim.fields.stored.gaden_frames import read_gaden_frame
from gslcosim.fields.stored.gsl_bench_frames import read_gsl_bench_frame

GSL_BENCH_PERIOD_S = 1.0
GADEN_PERIOD_S = 0.5

_GADEN_NAME = re.compile(r"iteration_(\d+)")
_GSL_BENCH_NAME = re.compile(r"iteration_(\d+)_fil\.npy")


class GasPlayback:
    """The frames of a GADEN result folder, or of a gas folder of GSL-Bench or AutoGDM+.

    Frame i holds from i * period_s until the next one that is there. Before the first frame there is no gas; after the
    last, time loops over the whole or the last frame stays. One frame at a time is kept in memory.
    """

    def __init__(self, folder: Path, *, period_s: float, is_looping: bool = False) -> None:
        """Find the frames of a folder.

        Args:
            folder: Holds `iteration_i` or `iteration_i_fil.npy` and `iteration_i_head.npy`.
            period_s: Time between frame i and frame i + 1 [s]; see `usual_period_s`.
            is_looping: Whether time begins anew after the last frame.

        Raises:
            EnvironmentDataError: the folder holds no frames.
        """
        self._paths = _frames_in(folder)
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
        """Return a frame by its number; the last one asked for is kept.

        Raises:
            EnvironmentDataError: there is no such frame, or its file is faulty.
        """
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
        frame = _frame_in(self._paths[number])
        if self._first is None:
            self._first = _frame_in(self._paths[int(self._numbers[0])])
        expected, found = _constants(self._first), _constants(frame)
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
        points = checked_points(points_world_m)
        frame = self.frame_at(time_s)
        if frame is None:
            return np.zeros(len(points))
        if frame.filaments is not None:
            return mixing_ratio_ppm_at(points, frame.filaments, walls=walls, cutoff_sigma=cutoff_sigma)[:, 0]
        return values_in_cells(frame, points)


def values_in_cells(frame: GasFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (m,) values of the cells of a stored grid that hold (m, 3) points, world frame [m]; 0 outside."""
    values = np.zeros(len(points))
    cells = frame.grid.cell_of(points)
    if frame.is_plane:
        cells[:, 2] = 0
    is_inside = frame.grid.contains_cell(cells)
    if frame.mixing_ratio_ppm is not None:
        values[is_inside] = frame.mixing_ratio_ppm[tuple(cells[is_inside].T)]
    return values


def usual_period_s(folder: Path) -> float:
    """Return the time between frames that such a folder usually has [s]: 1 for GSL-Bench, 0.5 for GADEN."""
    return GSL_BENCH_PERIOD_S if any(folder.glob("iteration_*_fil.npy")) else GADEN_PERIOD_S


def _frame_in(path: Path) -> GasFrame:
    return read_gsl_bench_frame(path) if path.suffix == ".npy" else read_gaden_frame(path)


def _constants(frame: GasFrame) -> tuple[Grid, str | None, float | None]:
    amount_mol = None if frame.filaments is None else float(frame.filaments.amount_mol[0])
    return (frame.grid, frame.gas, amount_mol)


def _frames_in(folder: Path) -> dict[int, Path]:
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
