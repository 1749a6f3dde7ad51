"""Fast wind and CO2 on a roof: `wind_10hz.csv`, `upwind_1hz.csv`, `downwind_1hz.csv`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim_validation.readers.columns import find_table, read_columns


@dataclass(frozen=True)
class RoofTracer:
    """Wind before a point source, and CO2 before and behind it, on one clock that starts with the wind.

    `wind_s` (n,), `wind_m_s` (n, 3) into, across and up [m/s]; `upwind_s`, `upwind_ppm` (a,); `downwind_s`,
    `downwind_ppm` (b,). Readings that are missing are nan; steps of the clock may leap.
    """

    wind_s: NDArray[np.float64]
    wind_m_s: NDArray[np.float64]
    upwind_s: NDArray[np.float64]
    upwind_ppm: NDArray[np.float64]
    downwind_s: NDArray[np.float64]
    downwind_ppm: NDArray[np.float64]


def read_roof_tracer(folder: Path) -> RoofTracer:
    """Return the set in a folder."""
    wind, upwind, downwind = (
        read_columns(find_table(folder, name)) for name in ("wind_10hz", "upwind_1hz", "downwind_1hz")
    )
    return RoofTracer(
        wind_s=wind.rising_s(may_repeat=True),
        wind_m_s=wind.matrix(["u_into_array_m_s", "v_across_m_s", "w_up_m_s"], allow_gaps=True),
        upwind_s=upwind.rising_s(may_repeat=True),
        upwind_ppm=upwind.numbers("co2_ppm", allow_gaps=True),
        downwind_s=downwind.rising_s(may_repeat=True),
        downwind_ppm=downwind.numbers("co2_ppm", allow_gaps=True),
    )
