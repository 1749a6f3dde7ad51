"""Pictures of the recording as the numbers that they were made of."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.recording import colors
from gslcosim.recording.colors import GasScale
from gslcosim.recording.reading.stored_rows import StoredColumn, StoredRows


def level_of_color() -> dict[int, int]:
    """Return the level of each colour of a slice, packed as 0xRRGGBB; of two levels with one colour the lower."""
    packed = _packed(colors.slice_colors()[:, :3])
    return {int(color): level for level, color in reversed(list(enumerate(packed)))}


@dataclass(frozen=True, kw_only=True, eq=False)
class SliceDecoder:
    """Turns the pictures of a gas slice back into mixing ratios.

    A picture has `colors.N_LEVELS` levels over `colors.DECADES` powers of ten. A mixing ratio comes back as the middle
    of its level: within 1.4 %. What was below the scale comes back as 0. Recordings of older versions hold colours, of
    which two levels share one just above the lower end: within 4 % there.
    """

    shape: tuple[int, int]
    scale: GasScale

    def mixing_ratio_ppm(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return the (nx, ny) mixing ratios [ppm] of a picture of levels, or of RGBA bytes."""
        nx, ny = self.shape
        if np.size(picture) == nx * ny:
            return self._ppm_of_levels()[np.asarray(picture).reshape(ny, nx)[::-1].T]
        packed = _packed(np.asarray(picture).reshape(ny, nx, 4)[..., :3])
        known, levels = _palette()
        at = np.searchsorted(known, packed)
        level = levels[np.minimum(at, len(known) - 1)]
        # Rows of a picture run from the far side (largest y) to the near one.
        return self._ppm_of_levels()[level[::-1].T]

    def _ppm_of_levels(self) -> NDArray[np.float32]:
        middle = np.arange(colors.N_LEVELS) + 0.5
        ppm = self.scale.min_ppm * 10.0 ** (middle * colors.DECADES / (colors.N_LEVELS - 1))
        ppm[0], ppm[-1] = 0.0, self.scale.max_ppm
        return ppm.astype(np.float32)


def splats(rows: StoredRows, entity: str) -> tuple[StoredColumn, StoredColumn]:
    """Return centres (n, 3) and standard deviations (n, 3) of filaments over time [m]."""
    return rows.column(entity, "GaussianSplats3D:centers"), rows.column(entity, "GaussianSplats3D:scales")


def picture_place(rows: StoredRows, entity: str) -> tuple[tuple[int, int], float, tuple[float, float, float]] | None:
    """Return how many cells a picture over the map has along x and y, their size [m], and its corner [m]."""
    shape: Any = rows.still(entity, "GridMap:format")
    if shape is None:
        return None
    x_m, y_m, z_m = (float(c) for c in rows.still(entity, "GridMap:translation")[0])
    cell_m = float(rows.still(entity, "GridMap:cell_size")[0])
    return (int(shape[0]["width"]), int(shape[0]["height"])), cell_m, (x_m, y_m, z_m)


def _palette() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    found = level_of_color()
    known = np.array(sorted(found), dtype=np.int64)
    return known, np.array([found[int(color)] for color in known], dtype=np.int64)


def _packed(rgb: NDArray[np.uint8]) -> NDArray[np.int64]:
    return rgb.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int64)
