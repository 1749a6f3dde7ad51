"""Means of the flow over time."""

import numpy as np

from gslcosim.flow.solver import FlowSolver, StepRecord
from gslcosim.flow.turbulence import Velocity, still_velocity
from gslcosim.flow.walls.domain import Domain


class FieldMean:
    """A running mean of face velocities over time."""

    def __init__(self, domain: Domain) -> None:
        self.velocity = still_velocity(domain)
        self.duration_s = 0.0

    def add(self, velocity: Velocity, duration_s: float) -> None:
        """Take in padded face velocities [m/s] that lasted for a time [s]."""
        self.duration_s += duration_s
        weight = np.float32(duration_s / self.duration_s)
        for mean, now in zip(self.velocity, velocity):
            mean += weight * (now - mean)


class MeanFrom:
    """Averages the flow from a time on."""

    def __init__(self, domain: Domain, from_s: float) -> None:
        self._from_s = from_s
        self._mean = FieldMean(domain)

    def next_stop_s(self, time_s: float) -> float:
        """Return the next time after `time_s` at which a step must end [s]."""
        return self._from_s if time_s < self._from_s else np.inf

    @property
    def velocity(self) -> Velocity:
        """Return the mean so far, padded face velocities [m/s]."""
        return self._mean.velocity

    def see(self, solver: FlowSolver, record: StepRecord) -> None:
        """Take in a step."""
        if record.time_s > self._from_s:
            self._mean.add(solver.velocity, record.dt_s)
