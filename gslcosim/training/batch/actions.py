"""Actions of policies as tasks for all searches of a batch; see `gslcosim.search.learned.actions`."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.search.learned.actions import N_HEADINGS
from gslcosim.training.batch.batch_records import CRUISE, GO_TO, HOLD

BATCHED_ACTIONS = ("velocity", "velocity_3d", "waypoint", "waypoint_3d", "heading")


class BatchActions:
    """Turns actions of one kind into tasks.

    `tasks` (n,) and `vectors` (n, 3) are what each search is to do next, as kernels take them.

    Args:
        action: One of `BATCHED_ACTIONS`.
        shape: Of the actions of all searches.
        step_m: The longest leg [m].
        speed_m_s: The highest speed of velocities [m/s].
    """

    def __init__(self, action: str, shape: tuple[int, ...], *, step_m: float, speed_m_s: float) -> None:
        self._shape = shape
        self._is_heading = action == "heading"
        self._cruises = action.startswith("velocity")
        self._step_m, self._speed_m_s = step_m, speed_m_s
        self.tasks = np.full(shape[0], CRUISE if self._cruises else GO_TO, np.int64)
        self.vectors = np.zeros((shape[0], 3))
        rad = [2 * math.pi * choice / N_HEADINGS for choice in range(N_HEADINGS + 1)]
        self._legs = np.array([[math.cos(heading_rad), math.sin(heading_rad)] for heading_rad in rad])

    def take(self, actions: NDArray[Any], searches: NDArray[np.void], cases: NDArray[np.void]) -> None:
        """Take the next actions.

        Args:
            actions: Of all searches.
            searches: (n,) records of `SEARCH`.
            cases: Records of `CASE`, to which those of the searches point.

        Raises:
            UsageError: they have another shape, or are not finite, or no choices.
        """
        given = np.asarray(actions)
        if given.shape != self._shape:
            raise UsageError(f"step: actions: expected shape {self._shape}, was {given.shape}.")
        if self._is_heading:
            if not np.isin(given, np.arange(N_HEADINGS + 1)).all():
                raise UsageError(f"step: actions: expected 0 to {N_HEADINGS}, was {given.min()} to {given.max()}.")
            self.tasks[:] = np.where(given == N_HEADINGS, HOLD, GO_TO)
            self._send(self._step_m * self._legs[given.astype(np.int64)], searches, cases)
            return
        given = given.astype(np.float64)
        if not np.isfinite(given).all():
            raise UsageError(f"step: actions: expected finite numbers, was {given[~np.isfinite(given)][0]}.")
        if self._cruises:
            self.vectors[:, : given.shape[1]] = self._speed_m_s * given
        else:
            self._send(self._step_m * given, searches, cases)

    # The next place from where the vehicle is, off the walls.
    def _send(self, offsets_m: NDArray[np.float64], searches: NDArray[np.void], cases: NDArray[np.void]) -> None:
        from_m, n_axes, i_cases = searches["position_m"].copy(), offsets_m.shape[1], searches["case"]
        heights_m = cases["search_height_m"][i_cases]
        if n_axes == 2:
            from_m[:, 2] = heights_m
        from_m[:, :n_axes] += offsets_m
        self.vectors[:] = np.clip(from_m, cases["least_m"][i_cases], cases["most_m"][i_cases])
        if n_axes == 2:
            self.vectors[:, 2] = heights_m
