"""Where a vehicle may be sent: the room's bounds and its free cells."""

from dataclasses import dataclass

import numpy as np

from gslcosim.environment.model import Cell, Environment

Vec3 = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class FlightSpace:
    """The places a vehicle of a certain radius may be sent to."""

    environment: Environment
    radius_m: float

    def refusal(self, name: str, position_world_m: Vec3) -> str | None:
        """Return why a place is refused, or nothing when it is allowed.

        A place must lie inside the room, at least the vehicle's radius from floor and ceiling, and in a free cell.

        Args:
            name: What the place is, for the text.
            position_world_m: The place, world frame [m].
        """
        return self._refusal(name, position_world_m, self.radius_m)

    def start_refusal(self, name: str, position_world_m: Vec3) -> str | None:
        """Return why a vehicle cannot start at a place; as `refusal`, but it may stand on the floor."""
        return self._refusal(name, position_world_m, 0.0)

    def _refusal(self, name: str, position_world_m: Vec3, margin_m: float) -> str | None:
        grid = self.environment.grid
        margins_m = (0.0, 0.0, margin_m)
        for axis, value, low, high, margin in zip(
            "xyz", position_world_m, grid.origin_m, grid.max_m, margins_m, strict=True
        ):
            if not low + margin <= value <= high - margin:
                return f"{name}: expected {axis} within {low + margin:g} to {high - margin:g} m, was {value:g} m."
        cell = np.minimum(grid.cell_of(np.array(position_world_m)), np.array(grid.shape) - 1)
        if self.environment.occupancy[tuple(cell)] == Cell.SOLID:
            place = ", ".join(f"{value:g}" for value in position_world_m)
            return f"{name}: expected a free place, was ({place}) m{self._inside_text(position_world_m)}."
        return None

    def support_height_m(self, position_world_m: Vec3) -> float:
        """Return the height of the floor or the highest box top below a place, world frame [m]."""
        x_m, y_m, z_m = position_world_m
        tops_m = [
            box.max_m[2]
            for box in self.environment.boxes
            if box.kind in ("floor", "obstacle")
            and box.min_m[0] <= x_m <= box.max_m[0]
            and box.min_m[1] <= y_m <= box.max_m[1]
            and box.max_m[2] <= z_m + 1e-9
        ]
        return max([self.environment.grid.origin_m[2], *tops_m])

    # Names the solid, where the cell belongs to a named one.
    def _inside_text(self, position_world_m: Vec3) -> str:
        for box in self.environment.boxes:
            if all(a <= p <= b for a, p, b in zip(box.min_m, position_world_m, box.max_m, strict=True)):
                return f", inside {box.name}"
        return ", inside a solid cell"
