"""A bias: a constant, and a part that wanders and is forgotten."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.sensing.inertial_kernels import wander_inplace


class WanderingBias:
    """A first-order Gauss-Markov process in three axes, exact for any length of the step.

    db = -b/T dt + q dW;   over dt: b <- e^(-dt/T) b + N(0, q^2 T/2 (1 - e^(-2 dt/T)))
    [x] = [x s^(-1/2)] [s^(1/2)]

    b starts at 0; the bias is b and a constant of N(0, start_std), which stays. Draws x, y, z at the start and in each
    step.

    Source:
        RotorS and PX4's Gazebo plug-ins for the IMU, which Pegasus follows.
    Held by:
        tests/unit/sensing/test_imu.py, tests/unit/sensing/test_navigation_sensors.py
    """

    def __init__(
        self,
        walk: Sequence[float],
        correlation_s: float,
        dt_s: float,
        rng: np.random.Generator,
        *,
        start_std: float = 0.0,
    ) -> None:
        self._keeps = math.exp(-dt_s / correlation_s)
        self._kick = np.array(walk) * math.sqrt(-correlation_s / 2 * math.expm1(-2 * dt_s / correlation_s))
        self._rng = rng
        self._constant = start_std * rng.standard_normal(3)
        self._wandering = np.zeros(3)
        self._powers = np.empty(0)

    def step(self) -> NDArray[np.float64]:
        """Advance by one step and return the (3,) bias."""
        self._wandering = self._keeps * self._wandering + self._kick * self._rng.standard_normal(3)
        return self._constant + self._wandering

    def steps(self, n: int) -> NDArray[np.float64]:
        """Advance by n steps, far fewer than there are in a correlation time, and return the (n, 3) biases.

        See `wander_inplace`; it is `step` n times.
        """
        if len(self._powers) != n:
            self._powers = self._keeps ** np.arange(1, n + 1)
        draws = self._rng.standard_normal((n, 3))
        return wander_inplace(self._wandering, self._constant, self._kick, self._powers, draws)
