"""Shield of a batch: the kernel of one velocity over many."""

# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN202 - kernels have no types

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.learned.shield import VelocityShield, shield_velocity
from gslcosim_training.batch.reference_free_kernels import reference_free_njit


@reference_free_njit()
def _shield(velocities, observations, columns, directions, i_sin, i_cos, keep_m, reach_m):
    for i in range(len(velocities)):
        numbers = observations[i]
        sin, cos = float(numbers[i_sin]), float(numbers[i_cos])
        shield_velocity(velocities[i], numbers, columns, directions, sin, cos, keep_m, reach_m)


def shield_rows(shield: VelocityShield, observations: NDArray[np.float32]) -> Callable[[NDArray[np.float64]], None]:
    """Return what shields the velocities of all searches, in units of the highest speed, in place.

    Args:
        shield: Of the batch's agents.
        observations: (n, n_numbers) upon which the velocities were chosen.

    Held by:
        extensions/training/tests/unit/batch/test_shields.py
    """
    columns, directions = np.array(shield.columns, np.int64), np.array(shield.directions)

    def apply(velocities: NDArray[np.float64]) -> None:
        _shield(velocities, observations, columns, directions, *shield.yaw, shield.keep_m, shield.reach_m)

    return apply
