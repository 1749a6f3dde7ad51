"""A measured film of gas: mixing ratios on a grid, each with its time, in one array file.

The file is numpy's `.npz` with

    time_s             (t,) times of the pictures, ascending [s]
    mixing_ratio_ppm   (t, nx, ny, nz), or (t, nx, ny) for a plane that holds at all heights [ppm by volume]
    origin_m           (3,) corner of cell (0, 0, 0), world frame [m]; of a plane the z does not matter
    cell_m             edge of the cubic cells [m]
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.stored.frame import LARGEST_CENTRE_PPM, GasFrame
from gslcosim.safe_files import open_regular_file

MOVIE_SUFFIX = ".npz"
_ARRAYS = ("time_s", "mixing_ratio_ppm", "origin_m", "cell_m")


class GasMovie:
    """Pictures of gas, played by their times.

    A picture holds from its time until that of the next; before the first there is no gas. After the last it stays, or
    time begins anew: then the last lasts as long as the one before it. Nothing is interpolated.
    """

    def __init__(self, path: Path, *, is_looping: bool = False) -> None:
        """Read a film.

        Raises:
            EnvironmentDataError: the file is missing, faulty, or holds impossible values.
        """
        arrays = _load(path)
        times_s, ppm = np.asarray(arrays["time_s"], np.float64), arrays["mixing_ratio_ppm"]
        self._is_plane = ppm.ndim == 3
        ppm = ppm[..., None] if self._is_plane else ppm
        problem = _problem_of(times_s, ppm, arrays["origin_m"], arrays["cell_m"])
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

    def frame_at(self, time_s: float) -> GasFrame | None:
        """Return the picture that holds at a time [s]; none before the first."""
        if self._is_looping and self.duration_s > 0.0 and time_s >= self._times_s[0]:
            time_s = float(self._times_s[0]) + (time_s - float(self._times_s[0])) % self.duration_s
        i = int(np.searchsorted(self._times_s, time_s + 1e-9, side="right")) - 1
        if i < 0:
            return None
        return GasFrame(
            version="movie",
            grid=self._grid,
            gas=None,
            source_position_m=None,
            wind_index=0,
            filaments=None,
            mixing_ratio_ppm=self._ppm[i],
            is_plane=self._is_plane,
        )


def _load(path: Path) -> dict[str, NDArray]:
    try:
        with open_regular_file(path) as file, np.load(file, allow_pickle=False) as stored:
            missing = [name for name in _ARRAYS if name not in stored]
            arrays = {} if missing else {name: stored[name] for name in _ARRAYS}
    # A faulty archive raises what zipfile, zlib, the parser of heads or numpy's types do.
    except Exception as error:
        raise EnvironmentDataError(f"gas movie: cannot be read ({error}). File: {path}") from error
    if missing:
        raise EnvironmentDataError(
            f"gas movie: expected arrays {', '.join(_ARRAYS)}, was without {', '.join(missing)}. File: {path}"
        )
    # A member without an array's head comes back as its bytes.
    kinds = {name: getattr(array, "dtype", np.dtype(bytes)) for name, array in arrays.items()}
    wrong = [f"{name} of {kind}" for name, kind in kinds.items() if kind.kind not in "fiu"]
    if wrong:
        raise EnvironmentDataError(f"gas movie: expected arrays of numbers, was {', '.join(wrong)}. File: {path}")
    return arrays


def _problem_of(times_s: NDArray, ppm: NDArray, origin_m: NDArray, cell_m: NDArray) -> str | None:
    if ppm.ndim != 4 or not ppm.size:
        return f"mixing ratios of shape (t, nx, ny) or (t, nx, ny, nz), was {ppm.dtype} {ppm.shape}"
    if times_s.shape != ppm.shape[:1] or not np.isfinite(times_s).all() or (np.diff(times_s) <= 0.0).any():
        return f"one ascending time for each of {len(ppm)} pictures, was {times_s.shape}, or not ascending"
    if not ((ppm >= 0) & (ppm <= LARGEST_CENTRE_PPM)).all():
        return "mixing ratios from 0 to 1e6 ppm, was others among them"
    if origin_m.shape != (3,) or not np.isfinite(origin_m).all() or cell_m.shape != () or not 0 < float(cell_m) < 1e6:
        return f"origin_m of three numbers and cell_m greater than 0, was {origin_m} and {cell_m}"
    return None
