"""Observers of a solve: frames kept at regular times, and means over time."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.flow.boundaries.domain import Domain
from gslcosim.flow.pressure import F32
from gslcosim.flow.solver import FlowSolver, StepRecord
from gslcosim.flow.turbulence import Velocity, still_velocity


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


class MeanRecorder:
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


MAX_FRAMES_BYTES = 8e9  # chosen: fits beside the solver into 16 GB
_FRAME_BYTES_PER_CELL = 12


class FrameRecorder:
    """Keeps the velocities at cell centres at given times, each made divergence-free before."""

    def __init__(self, domain: Domain, *, save_every_s: float, save_from_s: float, end_s: float) -> None:
        """Make room for all frames up to the end.

        Args:
            domain: The domain.
            save_every_s: Time between frames [s].
            save_from_s: Time of the first [s].
            end_s: Latest end of the run [s].

        Raises:
            FlowError: times make no sense, or the frames would take more than `MAX_FRAMES_BYTES`.
        """
        if not (np.isfinite(save_every_s) and save_every_s > 0):
            raise FlowError(f"save_every_s: expected a time above 0 s, was {save_every_s}.")
        if not 0 <= save_from_s <= end_s:
            raise FlowError(f"save_from_s: expected from 0 to the end ({end_s} s), was {save_from_s} s.")
        n_frames = int((end_s - save_from_s) / save_every_s + 1e-9) + 1
        _check_memory(n_frames, domain)
        self._times_s = save_from_s + save_every_s * np.arange(n_frames, dtype=np.float64)
        self._frames_m_s = np.empty((n_frames, *domain.shape, 3), np.float32)
        self._n_kept = 0

    def next_stop_s(self, time_s: float) -> float:
        """Return the next time after `time_s` at which a step must end [s]."""
        later = np.searchsorted(self._times_s, time_s, side="right")
        return float(self._times_s[later]) if later < len(self._times_s) else np.inf

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Return the times of the frames kept so far [s]."""
        return self._times_s[: self._n_kept]  # pyright: ignore[reportReturnType]

    @property
    def frames_m_s(self) -> F32:
        """Return the frames kept so far, (t, nx, ny, nz, 3) [m/s]."""
        return self._frames_m_s[: self._n_kept]

    def start(self, solver: FlowSolver) -> None:
        """Keep the field before the first step, if it is asked for."""
        self._keep_if_due(solver, solver.time_s)

    def see(self, solver: FlowSolver, record: StepRecord) -> None:
        """Keep the field after a step, if it is time."""
        self._keep_if_due(solver, record.time_s)

    def _keep_if_due(self, solver: FlowSolver, time_s: float) -> None:
        if self._n_kept < len(self._times_s) and time_s >= self._times_s[self._n_kept]:
            self._frames_m_s[self._n_kept] = solver.divergence_free_centre_velocity()
            self._n_kept += 1


def _check_memory(n_frames: int, domain: Domain) -> None:
    n_bytes = n_frames * float(np.prod(domain.shape)) * _FRAME_BYTES_PER_CELL
    if n_bytes > MAX_FRAMES_BYTES:
        raise FlowError(
            f"save_every_s: {n_frames:,} frames of {' x '.join(map(str, domain.shape))} cells would take "
            f"{n_bytes / 1e9:,.1f} GB of memory, expected at most {MAX_FRAMES_BYTES / 1e9:g} GB. "
            f"Save less often, from later on (save_from_s), or use larger cells."
        )
