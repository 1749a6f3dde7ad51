"""Scene for rays: an environment's boxes, sorted into bins, and the other vehicles."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import BodyState
from gslcosim.environment.model import Environment
from gslcosim.environment.openings import solid_boxes
from gslcosim.scenario import Scenario

# Edge of a bin [m]: a few boxes each, and few bins along a ray.
BIN_M = 1.0


class RayScene:
    """Everything that reflects rays: boxes exactly, other vehicles as upright cylinders around their centres.

    A cylinder has the vehicle's radius and its greatest half height; the vehicle's tilt is left out.

    Held by:
        tests/unit/services/sensing/test_range_finders.py
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        boxes = solid_boxes(environment)
        self._boxes_m = np.array([(*box.min_m, *box.max_m) for box in boxes], np.float64)
        self._origin_m = self._boxes_m[:, :3].min(axis=0)
        sides_m = self._boxes_m[:, 3:].max(axis=0) - self._origin_m
        self._shape = np.array([max(1, math.ceil(side / BIN_M)) for side in sides_m.tolist()], np.int64)
        self._first, self._members = self._bins()
        bodies = {agent.name: agent.vehicle.facts.body for agent in scenario.agents}
        self._sizes_m = {name: (body.radius_m, body.half_height_m) for name, body in bodies.items()}

    @property
    def boxes(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """The boxes, and where each bin's begin and which they are, as `distance_among_boxes` takes them."""
        return self._boxes_m, self._first, self._members

    @property
    def bins(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Corner of the first bin, world frame [m], and the number of bins along each axis."""
        return self._origin_m, self._shape

    def ranges_m(
        self,
        start_m: NDArray[np.float64],
        directions: NDArray[np.float64],
        others: Iterable[BodyState],
        limit_m: float,
    ) -> NDArray[np.float64]:
        """Return the (n,) distances along rays, `limit_m` where nothing is nearer [m].

        Args:
            start_m: (3,) where the rays start, world frame [m].
            directions: (n, 3) unit vectors, world frame.
            others: The vehicles that they may meet.
            limit_m: Farthest distance of interest [m].
        """
        cylinders_m = np.array(
            [(*body.position_world_m, *self._sizes_m[body.agent]) for body in others], np.float64
        ).reshape(-1, 5)
        from gslcosim_services.sensing.ray_kernels import cast_rays  # the table of sensors needs no compiler

        return cast_rays(
            self._boxes_m, self._first, self._members, self._origin_m, BIN_M, self._shape,
            cylinders_m, start_m, directions, limit_m,
        )  # fmt: skip

    def _bins(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        members: list[list[int]] = [[] for _ in range(int(np.prod(self._shape)))]
        low = np.floor((self._boxes_m[:, :3] - self._origin_m) / BIN_M - 1e-9).astype(int).clip(0, self._shape - 1)
        high = np.floor((self._boxes_m[:, 3:] - self._origin_m) / BIN_M + 1e-9).astype(int).clip(0, self._shape - 1)
        for n, ((i0, j0, k0), (i1, j1, k1)) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    for k in range(k0, k1 + 1):
                        members[int((i * self._shape[1] + j) * self._shape[2] + k)].append(n)
        first = np.cumsum([0, *(len(indices) for indices in members)]).astype(np.int64)
        return first, np.array([index for indices in members for index in indices], np.int64)
