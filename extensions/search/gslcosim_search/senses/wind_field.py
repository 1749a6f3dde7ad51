"""Wind field as a vehicle has met it: step by step on its way, and spread over the room.

Held by:
    extensions/search/tests/unit/senses/test_wind_field.py
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Observation
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.senses.instruments import Vane

Array = NDArray[np.float64]


class WindRecord:
    """The wind that a vehicle has met: means over equal steps of time, with the places.

    Call `add` with every observation. The vehicle's own velocity is added to the wind that its anemometer feels.
    Where observations are missing the wind stays as it was.

    State: at most `n_steps` means, and the sums of the step under way.
    """

    def __init__(self, vane: Vane, *, step_s: float, n_steps: int) -> None:
        """Begin without a wind; older steps than the last `n_steps` are forgotten."""
        self._vane, self._step_s, self._n_steps = vane, step_s, n_steps
        # Rows of x, y, u, v.
        self._steps: deque[Array] = deque(maxlen=n_steps)
        self._sum = np.zeros(4)
        self._n_samples = 0
        self._step_ends_s: float | None = None
        self._last_tick: int | None = None
        self.n_steps_ever = 0

    def add(self, observation: Observation) -> None:
        """Take note of an observation; a tick counts once, and an anemometer that warms up does not."""
        if observation.tick == self._last_tick or not self._vane.is_ready(observation):
            return
        self._last_tick = observation.tick
        if self._step_ends_s is None:
            self._step_ends_s = observation.time_s + self._step_s
        self._sum += self._sample(observation)
        self._n_samples += 1
        n_over = math.floor((observation.time_s - self._step_ends_s) / self._step_s + 1e-6) + 1
        if n_over > 0:
            self._steps.extend([self._sum / self._n_samples] * min(n_over, self._n_steps))
            self.n_steps_ever += n_over
            self._step_ends_s += n_over * self._step_s
            self._sum, self._n_samples = np.zeros(4), 0

    def places_m(self) -> Array:
        """Return (n, 2) where the vehicle was in each step, the oldest first, world frame [m]."""
        return self._table()[:, :2]

    def winds_m_s(self) -> Array:
        """Return (n, 2) the mean wind of each step, the oldest first, world frame [m/s]: where the air goes."""
        return self._table()[:, 2:]

    def window_m_s(self) -> Array:
        """Return (n_steps, 2) the winds of the whole window: the mean one before they are known."""
        winds_m_s = self.winds_m_s()
        return np.concatenate([np.tile(self.mean_wind_m_s(), (self._n_steps - len(winds_m_s), 1)), winds_m_s])

    def latest(self) -> tuple[float, float, float, float]:
        """Return place [m] and wind [m/s] of the newest step: x, y, u, v.

        Raises:
            IndexError: there was no whole step yet.
        """
        x_m, y_m, u_m_s, v_m_s = self._steps[-1].tolist()
        return x_m, y_m, u_m_s, v_m_s

    def mean_wind_m_s(self) -> Array:
        """Return the mean of all steps, 0 without any."""
        winds_m_s = self.winds_m_s()
        return winds_m_s.mean(axis=0) if len(winds_m_s) else np.zeros(2)

    def _table(self) -> Array:
        return np.array(self._steps).reshape(-1, 4)

    # The anemometer feels the wind less the vehicle's own velocity.
    def _sample(self, observation: Observation) -> Array:
        u_m_s, v_m_s = self._vane.wind_world_m_s(observation)
        own_u_m_s, own_v_m_s, _ = observation.velocity_world_m_s
        x_m, y_m, _ = observation.position_world_m
        return np.array([x_m, y_m, u_m_s + own_u_m_s, v_m_s + own_v_m_s])


class WindField:
    """A steady wind for every cell of a grid: measured winds hold near where they were measured, elsewhere their mean.

    W(c) = (w0 W0 + sum over j of k(c, x_j) W_j) / (w0 + sum over j of k(c, x_j)),  k = exp(-|c - x|^2 / (2 r^2))
    W_j are the means of the winds met in cell x_j, W0 is the mean of all cells' means; a fresh measurement weighs 1,
    and less by exp(-age / memory) later.

    State: for each cell the weight of its measurements and their weighted sum.

    Source:
        Ours: the kernel average of Kernel DM+V (Lilienthal et al. 2009), for winds.
    """

    def __init__(
        self, grid: CellGrid, *, reach_m: float, mean_weight: float = 0.05, memory_s: float = math.inf
    ) -> None:
        """Begin in calm air.

        Args:
            reach_m: Distance r over which a measurement holds [m].
            mean_weight: Weight w0 of the mean wind, > 0.
            memory_s: How long measurements count [s].
        """
        self.grid = grid
        self._mean_weight, self._memory_s = mean_weight, memory_s
        self._spread = [_kernel(grid.axis_m(axis), reach_m) for axis in range(2)]
        self._sums = np.zeros((*grid.shape, 3))

    def add(self, place_m: tuple[float, float], wind_m_s: tuple[float, float], *, elapsed_s: float = 0.0) -> None:
        """Take note of a wind that was met at a place, `elapsed_s` after the last one."""
        self._sums *= elementary.exp(-elapsed_s / self._memory_s)
        self._sums[self.grid.nearest_cell(place_m)] += (1.0, *wind_m_s)

    def winds_m_s(self) -> Array:
        """Return the wind in each cell, shape (nx, ny, 2), world frame [m/s]: where the air goes."""
        weight = self._sums[..., :1]
        means = np.divide(self._sums[..., 1:], weight, out=np.zeros((*self.grid.shape, 2)), where=weight > 0.0)
        # A cell counts by how much was measured there, up to one whole measurement: long stays do not drown the rest.
        met = np.concatenate([np.minimum(weight, 1.0), np.minimum(weight, 1.0) * means], axis=-1)
        total = met.sum(axis=(0, 1))
        mean_wind = total[1:] / total[0] if total[0] > 0.0 else np.zeros(2)
        along_x = elementary.product(self._spread[0], met.reshape(len(met), -1)).reshape(met.shape)
        near = elementary.product(along_x.transpose(0, 2, 1), self._spread[1]).transpose(0, 2, 1)
        return (near[..., 1:] + self._mean_weight * mean_wind) / (near[..., :1] + self._mean_weight)


def _kernel(centres_m: Array, reach_m: float) -> Array:
    return elementary.exp_each(-0.5 * np.square((centres_m[:, None] - centres_m[None, :]) / reach_m))
