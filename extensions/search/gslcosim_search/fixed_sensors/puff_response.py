# pyright: basic
"""Response of fixed sensors to a source in wind that turns from minute to minute, by puffs that it carries."""

# ruff: noqa: ANN001, ANN202 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_search import elementary

Floats = NDArray[np.float64]

# Puffs that left farther apart in time leave gaps between them in brisk wind.
_STEP_S, _LEAST_STEPS = 5.0, 12

VON_KARMAN = 0.4
OPEN_COUNTRY_ROUGHNESS_M = 0.03
"""Roughness length of open ground with low plants, class 3 of the WMO's guide to instruments (chapter 5, annex)."""

# Below this the wind of a minute is no direction, and puffs stay where they are anyway.
_LEAST_SPEED_M_S = 0.3
# Square of the distance, in deviations, beyond which a puff counts as zero: exp(-18).
_FARTHEST_SQUARED = 36.0


def surface_fluctuations_m_s(
    speed_m_s: Floats, height_m: float, *, roughness_m: float = OPEN_COUNTRY_ROUGHNESS_M
) -> tuple[Floats, Floats]:
    """Return standard deviations of the wind across its mean and upward where they were not measured.

    u* = kappa u / ln(z / z0),  s_across = 1.92 u*,  s_up = 1.25 u*
    [m/s]

    Args:
        speed_m_s: (n,) u, the mean speed.
        height_m: z, where it is measured [m].
        roughness_m: z0 of the ground [m].

    Source:
        Panofsky and Dutton 1984, Atmospheric turbulence, table 7.1: neutral surface layer over flat ground.
    Left out:
        Stability: on clear nights both are smaller, on hot days larger.
    """
    friction_m_s = VON_KARMAN * np.maximum(speed_m_s, _LEAST_SPEED_M_S) / elementary.log(height_m / roughness_m)
    return 1.92 * friction_m_s, 1.25 * friction_m_s


@dataclass(frozen=True)
class WindRecord:
    """Wind of n periods of equal length, the same over the whole yard.

    `start_s` (n,) of each period; `period_s`; `mean_world_m_s` (n, 2) toward x and y, nan where not measured;
    `across_std_m_s`, `up_std_m_s` (n,) fluctuation within a period [m/s]. Where a start is later than the end of the
    period before, earlier puffs are dropped.
    """

    start_s: Floats
    period_s: float
    mean_world_m_s: Floats
    across_std_m_s: Floats
    up_std_m_s: Floats

    @classmethod
    def of_means(
        cls, start_s: Floats, mean_world_m_s: Floats, height_m: float, *, period_s: float = 60.0
    ) -> "WindRecord":
        """Return a record of means alone, with the fluctuations of `surface_fluctuations_m_s`; gaps are bridged."""
        mean = np.array(mean_world_m_s, dtype=np.float64)
        for axis in range(2):
            is_known = np.isfinite(mean[:, axis])
            if is_known.any():
                mean[:, axis] = np.interp(start_s, start_s[is_known], mean[is_known, axis])
        across, up = surface_fluctuations_m_s(np.linalg.norm(mean, axis=1), height_m)
        return cls(start_s, period_s, mean, across, up)

    def rows(self, first: int, end: int) -> "WindRecord":
        """Return the periods from `first` up to, but without, `end`."""
        part = slice(first, end)
        return WindRecord(
            self.start_s[part],
            self.period_s,
            self.mean_world_m_s[part],
            self.across_std_m_s[part],
            self.up_std_m_s[part],
        )


@numba.njit(cache=True)
def _mean_of_puffs(
    points_m, east_m, north_m, across_std_m_s, up_std_m_s, first_step, source_m, source_sigma_m, step_s, n_sub, n_back
):
    n, k = across_std_m_s.shape[0], points_m.shape[0]
    total = np.zeros((n, k))
    h = source_m[2]
    norm = 2.0 * math.pi * math.sqrt(2.0 * math.pi)
    for i in range(n):
        for part in range(n_sub):
            now = i * n_sub + part
            for back in range(n_back):
                then = now - back
                if then < first_step[i]:
                    break
                age_s = (back + 0.5) * step_s
                # From the middle of the step in which it left to the end of this one.
                x = source_m[0] + east_m[now + 1] - 0.5 * (east_m[then] + east_m[then + 1])
                y = source_m[1] + north_m[now + 1] - 0.5 * (north_m[then] + north_m[then + 1])
                of = then // n_sub
                flat = source_sigma_m * source_sigma_m + (across_std_m_s[of] * age_s) ** 2
                tall = source_sigma_m * source_sigma_m + (up_std_m_s[of] * age_s) ** 2
                for j in range(k):
                    dx, dy = points_m[j, 0] - x, points_m[j, 1] - y
                    squared = dx * dx + dy * dy
                    if squared > _FARTHEST_SQUARED * flat:
                        continue
                    z = points_m[j, 2]
                    upward = elementary.exp(-0.5 * (z - h) ** 2 / tall) + elementary.exp(-0.5 * (z + h) ** 2 / tall)
                    total[i, j] += (
                        step_s * elementary.exp(-0.5 * squared / flat) * upward / (norm * flat * math.sqrt(tall))
                    )
    return 1e6 * total / n_sub


def puff_responses(
    points_m: Floats,
    wind: WindRecord,
    source_m: Floats,
    *,
    source_sigma_m: float = 0.5,
    steps_per_period: int | None = None,
    memory_s: float = 300.0,
) -> Floats:
    """Return the readings of point sensors in each period above background, per cubic metre of pure gas a second.

    C / Q = sum over puffs of dt exp(-r^2 / (2 sh^2)) (exp(-(z - h)^2 / (2 sz^2)) + exp(-(z + h)^2 / (2 sz^2)))
            / ((2 pi)^1.5 sh^2 sz)
    sh^2 = a^2 + (s_across t)^2,  sz^2 = a^2 + (s_up t)^2
    [s/m3] = [s] / [m3]; times 1e6 for ppm. t age of a puff, r distance in the plan from its centre.

    Between the middles of periods the wind changes in proportion. Fluctuations are those of the period in which a puff
    left, and the same along the wind as across.

    Args:
        points_m: (k, 3) places of the sensors, z above ground [m].
        wind: Of n periods.
        source_m: (3,) place of the source [m].
        source_sigma_m: a, deviation of the gas at the source [m].
        steps_per_period: Puffs that leave in a period, and times over which its reading is averaged; absent: one every
            5 s, and 12 at least.
        memory_s: Age at which puffs are dropped; within it they should have left the yard.

    Returns:
        (n, k) [ppm s/m3].

    Source:
        The integrated puff models of air pollution (Zannetti 1990, chapter 8), with Taylor's spread for short times.
    Left out:
        Wind that differs over the yard, buildings, heat of the ground.
    Held by:
        extensions/search/tests/unit/fixed_sensors/test_puff_response.py (in steady wind it is the plume of
        `plume_responses`)

    Raises:
        ShapeError: the arrays do not fit each other.
    """
    n = len(wind.start_s)
    if wind.mean_world_m_s.shape != (n, 2) or wind.across_std_m_s.shape != (n,) or wind.up_std_m_s.shape != (n,):
        raise ShapeError("wind: expected means (n, 2) and standard deviations (n,) of the n periods.")
    if steps_per_period is None:
        steps_per_period = max(_LEAST_STEPS, math.ceil(wind.period_s / _STEP_S))
    step_s = wind.period_s / steps_per_period
    part_s = (np.arange(steps_per_period) + 0.5) * step_s
    at_s = (wind.start_s[:, None] + part_s[None, :]).ravel()
    middle_s = wind.start_s + 0.5 * wind.period_s
    east_m, north_m = (
        np.concatenate([[0.0], np.cumsum(step_s * np.interp(at_s, middle_s, wind.mean_world_m_s[:, axis]))])
        for axis in range(2)
    )
    begins = np.concatenate([[True], np.diff(wind.start_s) > 1.5 * wind.period_s])
    first = np.maximum.accumulate(np.where(begins, np.arange(n), 0)) * steps_per_period
    return _mean_of_puffs(
        np.ascontiguousarray(points_m, dtype=np.float64),
        east_m,
        north_m,
        np.ascontiguousarray(wind.across_std_m_s),
        np.ascontiguousarray(wind.up_std_m_s),
        first,
        np.asarray(source_m, dtype=np.float64),
        source_sigma_m,
        step_s,
        steps_per_period,
        int(memory_s / step_s),
    )
