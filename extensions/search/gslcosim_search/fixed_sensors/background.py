"""Background of fixed sensors: readings where no plume of a known source reaches them."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Fewer readings are too few for a median of a group of their own.
_MIN_READINGS = 5


def background_beside_plumes(
    readings_ppm: Floats, predicted_ppm: Floats, group: NDArray, *, negligible_ppm: float
) -> Floats:
    """Return the background of each reading: the median of its sensor in its group where no plume is predicted.

    Where a sensor has fewer than five such readings in a group, such as a day, it gets its median over all groups;
    where it has none at all, the median of the other sensors.

    Args:
        readings_ppm: (n, k) readings, nan where there is none.
        predicted_ppm: (n, k) mixing ratios that the source is predicted to add.
        group: (n,) labels of rows that share a background, such as days.
        negligible_ppm: Plumes below this count as none; an instrument's own error is a good value.

    Returns:
        (n, k) [ppm]; nan where no sensor has a reading without plume.
    """
    is_clean = (predicted_ppm < negligible_ppm) & np.isfinite(readings_ppm)
    background = np.full(readings_ppm.shape, np.nan)
    of_sensor = np.full(readings_ppm.shape[1], np.nan)
    for k in range(readings_ppm.shape[1]):
        if is_clean[:, k].any():
            of_sensor[k] = np.median(readings_ppm[is_clean[:, k], k])
        for label in np.unique(group):
            rows = (group == label) & is_clean[:, k]
            if rows.sum() >= _MIN_READINGS:
                background[group == label, k] = np.median(readings_ppm[rows, k])
    if np.isfinite(of_sensor).any():
        of_sensor = np.where(np.isfinite(of_sensor), of_sensor, np.nanmedian(of_sensor))
    return np.where(np.isfinite(background), background, of_sensor)
