"""Convergence in time of an unsteady flow, and observers of a solve: frames at regular times, and means."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import FlowError
from gslcosim.flow.domain import Domain
from gslcosim.flow.pressure import F32, HIGH, LOW
from gslcosim.flow.solver import FlowSolver, StepRecord
from gslcosim.flow.turbulence import Velocity, still_velocity

MAX_FRAMES_BYTES = 8e9  # chosen: fits beside the solver into 16 GB
_FRAME_BYTES_PER_CELL = 12
# In the empty 15 x 15 x 8 m warehouse the means of successive windows (75 s) keep differing by a fifth to a quarter,
# because the largest eddies live for minutes, while the energy stays within a twentieth.
WIND_TOLERANCE_FRAC = 0.25
ENERGY_TOLERANCE_FRAC = 0.05
# Fraction of a window during which a flow from larger cells adapts before it is averaged; chosen.
ADAPTATION_FRAC = 0.125
_BOX = (slice(LOW, -HIGH),) * 3


class FieldMean:
    """A running mean of face velocities over time."""

    def __init__(self, domain: Domain) -> None:
        self.velocity = still_velocity(domain)
        self.duration_s = 0.0

    def add(self, velocity: Velocity, duration_s: float) -> None:
        """Add padded face velocities [m/s] that lasted for a time [s]."""
        self.duration_s += duration_s
        weight = np.float32(duration_s / self.duration_s)
        for mean, now in zip(self.velocity, velocity):
            mean += weight * (now - mean)


class MeanRecorder:
    """Averages the flow from a given time on."""

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
        """Add a step."""
        if record.time_s > self._from_s:
            self._mean.add(solver.velocity, record.dt_s)


class FrameRecorder:
    """Stores the velocities at cell centres at given times, each projected to be divergence-free."""

    def __init__(self, domain: Domain, *, save_every_s: float, save_from_s: float, end_s: float) -> None:
        """Allocate all frames up to the end.

        Args:
            save_every_s: Time between frames [s].
            save_from_s: Time of the first [s].
            end_s: Latest end of the run [s].
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
        """Keep the field before the first step, if it is due."""
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


@dataclass(frozen=True, kw_only=True)
class WindowCheck:
    """Two successive windows of time, compared.

    Attributes:
        start_s: Start of the first window [s].
        middle_s: End of the first and start of the second [s].
        end_s: End of the second [s].
        change_frac: Root mean square difference of the two mean winds, over that of the second's speed.
        energy_change_frac: Difference of the two mean kinetic energies over the second.
    """

    start_s: float
    middle_s: float
    end_s: float
    change_frac: float
    energy_change_frac: float


@dataclass(frozen=True, kw_only=True)
class ConvergenceResult:
    """Result of the convergence check of a flow's statistics, with its figures.

    Attributes:
        has_settled: The statistics settled before the time limit.
        average_from_s: Start of the mean that is returned [s].
        average_until_s: Its end, also that of the run [s].
        window_s: Length of the first window [s].
        tolerance_frac: Largest change of the mean wind from window to window that counts as settled;
            that of the energy is `ENERGY_TOLERANCE_FRAC`.
        checks: All comparisons of windows, in order; the last one decided.
        coarse_start_s: Time of development on cells of twice the size before [s]; 0: the start was still air.
    """

    has_settled: bool
    average_from_s: float
    average_until_s: float
    window_s: float
    tolerance_frac: float
    checks: tuple[WindowCheck, ...]
    coarse_start_s: float = 0.0

    @property
    def uncertainty_frac(self) -> float | None:
        """Return the standard error of the mean wind, over its speed, estimated from the last two windows.

        s / sqrt(T),  s^2 = change^2 / (1 / T1 + 1 / T2)        T averaged, T1 and T2 the windows' lengths [s]

        Windows are treated as independent: changes slower than a window are not included. None without a comparison of
        two windows.
        """
        if not self.checks:
            return None
        last = self.checks[-1]
        per_s = 1 / (last.middle_s - last.start_s) + 1 / (last.end_s - last.middle_s)
        return last.change_frac / math.sqrt((self.average_until_s - self.average_from_s) * per_s)

    def summary(self) -> dict[str, Any]:
        """Return the result as plain values, including the uncertainty."""
        return {**asdict(self), "uncertainty_frac": self.uncertainty_frac}

    def __str__(self) -> str:
        """Return the result as a sentence."""
        mean = f"mean from {self.average_from_s:.1f} to {self.average_until_s:.1f} s"
        if self.coarse_start_s:
            mean += f" after {self.coarse_start_s:.1f} s on cells of twice the size"
        if self.uncertainty_frac is not None:
            mean += f", uncertain by at least {self.uncertainty_frac:.0%}"
        if not self.checks:
            return f"not settled: {self.average_until_s:.1f} s hold no two windows of {self.window_s:.1f} s; {mean}"
        last = self.checks[-1]
        return (
            f"{'settled' if self.has_settled else 'not settled'}: from {last.start_s:.1f}-{last.middle_s:.1f} s to "
            f"{last.middle_s:.1f}-{last.end_s:.1f} s the mean wind changed by {last.change_frac:.1%} and its energy by "
            f"{last.energy_change_frac:.1%} (allowed {self.tolerance_frac:.0%} and {ENERGY_TOLERANCE_FRAC:.0%}); {mean}"
        )


def settling_window_s(domain: Domain, driven_m_s: float = 0.0) -> float:
    """Return the window that the flow's statistics need: the time in which the inlets' momentum turns the room over.

    t = V^(2/3) / sqrt(M),  M = sum Q_i U_i      at least L / U (longest side), at most V / Q (one change of air)
    [s] = [m2] / [m2/s]

    A jet of momentum flux M drives a room of cross-section A = V^(2/3) at about sqrt(M / A), and A^(1/2) over that
    speed is t. In a duct without other air it is the flow-through time. Our derivation; with repeating inlets the
    window is rounded up to a whole number of the longest period. `driven_m_s` is the scale of speeds that heat drives
    [m/s]: U where it is faster than the inlets.
    """
    volume_m3 = domain.n_air * (domain.cell_m * domain.cell_m * domain.cell_m)
    flows_m3_s, momentum_m4_s2 = [0.0], 0.0
    for placed in domain.inlets:
        assert placed.inflow is not None
        speed_m_s = placed.inflow.typical_speed_m_s
        flows_m3_s.append(placed.n_cells * (domain.cell_m * domain.cell_m) * speed_m_s)
        momentum_m4_s2 += flows_m3_s[-1] * speed_m_s
    crossing_s = max(domain.shape) * domain.cell_m / max(domain.reference_speed_m_s, driven_m_s, 1e-6)
    if momentum_m4_s2 == 0:
        return crossing_s
    turnover_s = elementary.pow(volume_m3, 2.0 / 3.0) / math.sqrt(momentum_m4_s2)
    window_s = min(max(turnover_s, crossing_s), volume_m3 / sum(flows_m3_s))
    period_s = max((p.inflow.period_s for p in domain.inlets if p.inflow), default=0.0)
    return math.ceil(window_s / period_s) * period_s if period_s else window_s


class _Window:
    # Mean wind and mean kinetic energy [m2/s2] over a window that began at `start_s`.
    def __init__(self, domain: Domain, start_s: float) -> None:
        self.start_s = start_s
        self.mean = FieldMean(domain)
        self.energy_m2_s2 = 0.0

    def add(self, velocity: Velocity, duration_s: float, energy_m2_s2: float) -> None:
        self.mean.add(velocity, duration_s)
        self.energy_m2_s2 += duration_s / self.mean.duration_s * (energy_m2_s2 - self.energy_m2_s2)

    def join(self, later: "_Window") -> None:
        self.add(later.mean.velocity, later.mean.duration_s, later.energy_m2_s2)


class ConvergenceMonitor:
    """Compares the flow window by window until its statistics have settled.

    Two windows agree when neither the mean wind nor the mean kinetic energy changes by more than its tolerance. If the
    energy agrees but the wind does not, the flow fluctuates too slowly for the window: the two are merged and the next
    is as long as both. While the energy still changes, the flow is starting up and the older window is dropped; from
    the first agreement of the energy on, the flow `has_developed`.
    """

    def __init__(
        self,
        domain: Domain,
        *,
        tolerance_frac: float,
        coarse_start_s: float = 0.0,
        max_time_s: float = math.inf,
        driven_m_s: float = 0.0,
    ) -> None:
        """Start to monitor a flow at its time 0.

        Args:
            tolerance_frac: Largest change of the mean wind that counts as settled.
            coarse_start_s: Time of development before, on cells of twice the size [s].
            max_time_s: Time limit of the solve [s]; for a developed flow two windows fit into it.
            driven_m_s: Scale of the speeds that heat drives [m/s].
        """
        self._domain = domain
        self._tolerance_frac = tolerance_frac
        self._coarse_start_s = coarse_start_s
        self._window_s = settling_window_s(domain, driven_m_s)
        from_s = max((p.inflow.steady_from_s for p in domain.inlets if p.inflow), default=0.0)
        if coarse_start_s:
            from_s = ADAPTATION_FRAC * min(self._window_s, max_time_s)
            self._window_s = min(self._window_s, (max_time_s - from_s) / 2)
        self._length_s = self._window_s
        self._previous: _Window | None = None
        self._current = _Window(domain, from_s)
        self._checks: list[WindowCheck] = []
        self.has_settled = False
        self.has_developed = False

    def next_stop_s(self, time_s: float) -> float:
        """Return the next time after `time_s` at which a step must end [s]."""
        start_s = self._current.start_s
        return start_s if time_s < start_s else start_s + self._length_s

    def see(self, solver: FlowSolver, record: StepRecord) -> None:
        """Add a step, and compare windows at the end of one."""
        if record.time_s <= self._current.start_s:
            return
        self._current.add(solver.velocity, record.dt_s, record.kinetic_energy_m2_s2)
        # The last window may end at the limit, up to rounding errors of its sum.
        if record.time_s >= (self._current.start_s + self._length_s) * (1 - 1e-12):
            self._close(record.time_s)

    def result(self) -> tuple[Velocity, ConvergenceResult]:
        """Return the mean over the last two windows, padded face velocities [m/s], and the result of the check.

        A first window without a comparison is the start-up: it is left out if there is a second one.
        """
        window = self._current
        is_start_up = not self._checks and window.mean.duration_s > 0 and not self._coarse_start_s
        if self._previous is not None and not is_start_up:
            if window.mean.duration_s:
                self._previous.join(window)
            window = self._previous
        settling = ConvergenceResult(
            has_settled=self.has_settled,
            average_from_s=window.start_s,
            average_until_s=window.start_s + window.mean.duration_s,
            window_s=self._window_s,
            tolerance_frac=self._tolerance_frac,
            checks=tuple(self._checks),
            coarse_start_s=self._coarse_start_s,
        )
        return window.mean.velocity, settling

    def _close(self, time_s: float) -> None:
        previous, current = self._previous, self._current
        self._current = _Window(self._domain, time_s)
        if previous is None:
            self._previous = current
            return
        check = _compare(previous, current, time_s)
        self._checks.append(check)
        if check.energy_change_frac > ENERGY_TOLERANCE_FRAC:
            self._previous = current
            return
        self.has_developed = True
        self.has_settled = check.change_frac <= self._tolerance_frac
        previous.join(current)
        if not self.has_settled:
            self._length_s = previous.mean.duration_s


def _compare(first: _Window, second: _Window, end_s: float) -> WindowCheck:
    difference, size = 0.0, 0.0
    for before, after in zip(first.mean.velocity, second.mean.velocity):
        difference += float(np.sum(np.square(after[_BOX] - before[_BOX]), dtype=np.float64))
        size += float(np.sum(np.square(after[_BOX]), dtype=np.float64))
    return WindowCheck(
        start_s=first.start_s,
        middle_s=second.start_s,
        end_s=end_s,
        change_frac=math.sqrt(difference / size) if size else 0.0,
        energy_change_frac=abs(second.energy_m2_s2 - first.energy_m2_s2) / (second.energy_m2_s2 or 1.0),
    )
