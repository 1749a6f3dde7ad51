"""Gas metrics: first contact, and how gas came and went.

They are of true mixing ratios at the noses, not of readings. Gas counts when there is more of it than a
floor, that of the sensor; the referee's is `GAS_CONTACT_PPM`. With several noses the strongest counts.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_bench.metrics.series import Array, as_series


def first_contact_s(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> float | None:
    """Return the first time with gas above the floor at a nose [s]; None without.

    Args:
        t_s: (n,) times, growing [s].
        gas_ppm: (n,) or (n, n_noses) true mixing ratios at those times [ppm].
        floor_ppm: What the sensor's floor is [ppm].
    """
    times_s, is_in_gas = _in_gas(t_s, gas_ppm, floor_ppm)
    return float(times_s[is_in_gas.argmax()]) if is_in_gas.any() else None


def tracking_ratio(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> float | None:
    """Return the share of the time from first contact to the end of the series in gas above the floor.

    Each value stands for the time since the one before it, for a sample is valid at the end of its tick. Times need
    not be equally far apart.

    Args:
        t_s: (n,) times, growing [s].
        gas_ppm: (n,) or (n, n_noses) true mixing ratios at those times [ppm].
        floor_ppm: What the sensor's floor is [ppm].

    Returns:
        The share, 0 to 1; None without contact, or with one at the very end.
    """
    times_s, is_in_gas = _in_gas(t_s, gas_ppm, floor_ppm)
    first = int(is_in_gas.argmax())
    if not is_in_gas[first] or first == len(times_s) - 1:
        return None
    spans_s = np.diff(times_s)[first:]
    return float(spans_s[is_in_gas[first + 1 :]].sum() / spans_s.sum())


def _in_gas(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> tuple[Array, NDArray[np.bool_]]:
    times_s = as_series("t_s", t_s)
    gas = np.asarray(gas_ppm, dtype=np.float64)
    if gas.ndim not in (1, 2) or len(gas) != len(times_s):
        raise ShapeError(
            f"gas_ppm: expected shape ({len(times_s)},) or ({len(times_s)}, n_noses), was {gas.shape}. "
            "Pass one row for each time."
        )
    strongest_ppm = gas.reshape(len(times_s), -1).max(axis=1)
    return times_s, np.greater(strongest_ppm, floor_ppm)
