"""Gas mapping on the way: readings placed where the gas was, and the next place that tells most of the map."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Observation
from gslcosim.search.maps.kernel_dm import GasMaps
from gslcosim.search.motion.grid_paths import Free
from gslcosim.search.senses.instruments import Nose, Vane

_ROUNDING_S = 1e-6


@dataclass(frozen=True, kw_only=True)
class PlacedReading:
    """Reading of a nose, placed where the vehicle was a lag before; the wind is that of the air there [m/s]."""

    place_m: Vec3
    value: float
    time_s: float
    wind_m_s: tuple[float, float]


class ReadingCollector:
    """Takes a reading every so often, at rest and on the way, and puts it where the gas was met.

    A sensor that lags shows what it met `lag_s` ago. A MOX sensor's reading is the mixing ratio that it suggests, or
    its conductance where the run offers no such estimate. The wind is what the anemometer feels and the vehicle's own
    velocity. Readings of a sensor that warms up are left out.

    State: where the vehicle was and what wind there was over the lag, and when the last reading was taken.

    Source:
        Shifting readings back by the lag: 2 to 3 s for MOX sensors, remembered, unverified [M].
    Held by:
        tests/unit/search/maps/test_gas_mapping.py
    """

    def __init__(self, nose: Nose, vane: Vane | None = None, *, every_s: float, lag_s: float) -> None:
        """Begin without readings; without a vane the wind is zero."""
        self._nose, self._vane, self._every_s, self._lag_s = nose, vane, every_s, lag_s
        self._track: deque[tuple[float, Vec3, tuple[float, float]]] = deque()
        self._next_s = -np.inf
        self._last_tick: int | None = None

    def add(self, observation: Observation) -> PlacedReading | None:
        """Take note of an observation; return the reading, if one is due. A tick counts once."""
        if observation.tick == self._last_tick:
            return None
        self._last_tick = observation.tick
        self._track.append((observation.time_s, observation.position_world_m, self._wind(observation)))
        while len(self._track) > 1 and self._track[1][0] <= observation.time_s - self._lag_s + _ROUNDING_S:
            self._track.popleft()
        if observation.time_s < self._next_s - _ROUNDING_S or not self._nose.is_ready(observation):
            return None
        self._next_s = observation.time_s + self._every_s
        _, place_m, wind_m_s = self._track[0]
        return PlacedReading(
            place_m=place_m, value=self._nose.ppm(observation), time_s=observation.time_s, wind_m_s=wind_m_s
        )

    def _wind(self, observation: Observation) -> tuple[float, float]:
        if self._vane is None or not self._vane.is_ready(observation):
            return 0.0, 0.0
        x_m_s, y_m_s = self._vane.wind_world_m_s(observation)
        return x_m_s + observation.velocity_world_m_s[0], y_m_s + observation.velocity_world_m_s[1]


def choose_next_cell(
    maps: GasMaps, flyable: Free, lengths_m: NDArray[np.float64], *, curiosity: float, travel_per_m: float
) -> tuple[int, int] | None:
    """Return the cell to go to next: much gas, or not known, and not far; None where nothing can be flown to.

    worth(k) = r(k) + (curiosity (1 - alpha(k)) - travel L(k)) (max r - min r)
    [u] = [u] + (1 - [1/m] [m]) [u] for readings in u; where all r are equal their difference counts as 1

    Args:
        maps: Mean r and confidence alpha, (nx, ny).
        flyable: (nx, ny) cells that the vehicle can be sent to.
        way_m: (nx, ny) length L of the way there [m], infinite where there is none.
        curiosity: kappa: at 1 or more all cells are visited before the peak.
        travel_per_m: What a metre of way costs, as a share of the range of the map [1/m].

    Source:
        Sum of predicted gas and ignorance, common in informative path planning; the price of the way is ours.
    Held by:
        tests/unit/search/maps/test_gas_mapping.py
    """
    possible = flyable & np.isfinite(lengths_m)
    if not possible.any():
        return None
    spread = float(maps.mean.max() - maps.mean.min()) or 1.0
    cost = np.where(possible, travel_per_m * lengths_m, 0.0)
    worth = maps.mean + (curiosity * (1.0 - maps.confidence) - cost) * spread
    i, j = np.unravel_index(int(np.where(possible, worth, -np.inf).argmax()), worth.shape)
    return int(i), int(j)
