"""What is known of a flight that was flown elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedValues:
    """What an instrument said: (n,) times, ascending [s], and (n, k) values in the unit of its readings."""

    time_s: Floats
    values: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightLog:
    """The poses of one vehicle and what its instruments said, by the clock of the log.

    Attributes:
        time_s: (n,) times of the poses, ascending [s].
        position_world_m: (n, 3) [m].
        quaternion_wxyz: (n, 4) world from body, unit length.
        instruments: By the sensor's name in the scenario.
    """

    time_s: Floats
    position_world_m: Floats
    quaternion_wxyz: Floats
    instruments: Mapping[str, LoggedValues] = field(default_factory=dict[str, LoggedValues])


# How many numbers a reading has, by its unit in the sensor's description; others have one.
_N_VALUES = {"m/s, rad": 2, "m/s": 3, "m/s^2, rad/s": 6, "m, m/s": 6, "m, 1, m/s": 10, "uT": 3}


def n_values_of(unit: str) -> int:
    """Return how many numbers a reading of an instrument with that unit has."""
    return _N_VALUES.get(unit, 1)
