# pyright: basic

"""Gas metrics: first contact, how gas came and went, and distance of an estimated map to the true one.

Metrics of contact are of true mixing ratios at the noses, not of readings. Gas counts when there is more of it than a
floor, that of the sensor; the referee's is `GAS_CONTACT_PPM`. With several noses the strongest counts.

Metrics of maps tell errors in shape from errors in amount. Gas maps are (nx, ny) mixing ratios in the mean over time at
one height, index order ij, of equal square cells. The truth is the mean over the time of the run at the height of the
map.
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


# Cells on an axis up to which the transport is worth its time; larger maps are summed to larger cells.
MAX_CELLS = 20


def _checked(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.ndim != 2 or first.shape != second.shape:
        raise ShapeError(
            f"gas maps: expected two of one shape (nx, ny), was {first.shape} and {second.shape}. "
            "Bring them to the same cells first."
        )
    if not (np.all(first >= 0.0) and np.all(second >= 0.0)) or not np.isfinite(first.sum() + second.sum()):
        raise ShapeError("gas maps: expected numbers from 0 on, was a negative one or none. Set unknown cells to 0.")
    return first, second
