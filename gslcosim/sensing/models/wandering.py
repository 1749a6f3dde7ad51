"""A bias: a constant, and a part that wanders and is forgotten."""

import math
from collections.abc import Sequence

import numpy as np


class WanderingBias:
    """A first-order Gauss-Markov process in three axes, exact for any length of the step.

    db = -b/T dt + q dW;   over dt: b <- e^(-dt/T) b + N(0, q^2 T/2 (1 - e^(-2 dt/T)))
    [x] = [x s^(-1/2)] [s^(1/2)]

    b starts at 0; the bias is b and a constant of N(0, start_std), which stays. Draws x, y, z at the start and in each
    step.

    Source:
        RotorS and PX4's Gazebo plug-ins for the IMU, which Pegasus follows.
    Held by:
        tests/unit/sensing/test_navigation_sensors.py
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
        self._keeps = kept_over(dt_s, correlation_s)
        self._kick = [kick_over(dt_s, q, correlation_s) for q in walk]
        self._rng = rng
        self._constant: list[float] = (start_std * rng.standard_normal(3)).tolist()
        self._wandering = [0.0, 0.0, 0.0]

    # In plain numbers: for three of them numpy takes longer.
    def step(self) -> list[float]:
        """Advance by one step and return the bias, x, y, z."""
        draws = self._rng.standard_normal(3).tolist()
        kept, steps = self._keeps, zip(self._wandering, self._kick, draws, strict=True)
        self._wandering = [kept * b + kick * draw for b, kick, draw in steps]
        return [constant + b for constant, b in zip(self._constant, self._wandering, strict=True)]


def kept_over(dt_s: float, correlation_s: float) -> float:
    """Return what is left of a wandering bias after some time: e^(-dt/T)."""
    return math.exp(-dt_s / correlation_s)


def kick_over(dt_s: float, walk: float, correlation_s: float) -> float:
    """Return the standard deviation of what comes to a wandering bias in some time: q sqrt(T/2 (1 - e^(-2 dt/T)))."""
    return walk * math.sqrt(-correlation_s / 2 * math.expm1(-2 * dt_s / correlation_s))
