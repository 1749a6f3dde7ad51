"""What on-board sensors look at: the vehicle itself, what is around it, and pictures."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import BodyState, CameraImage
from gslcosim.frames import world_from_body_rotation
from gslcosim.quantities import Vec3
from gslcosim.sensing.rays import RayScene


@dataclass(frozen=True)
class Surroundings:
    """The truth around one vehicle at the end of a tick; what on-board sensors get in the place of a gas sample.

    `others` are the other vehicles; `images` are the pictures just taken, by the sensor's name.
    """

    body: BodyState
    scene: RayScene
    others: tuple[BodyState, ...] = ()
    images: dict[str, CameraImage] = field(default_factory=dict)

    @cached_property
    def world_from_body(self) -> NDArray[np.float64]:
        """The (3, 3) matrix that turns body-frame vectors into world-frame vectors."""
        return world_from_body_rotation(self.body.quaternion_wxyz)

    def place_world_m(self, mount_body_m: Vec3) -> Vec3:
        """Return where a mount is, world frame [m]."""
        x_m, y_m, z_m = self.body.position_world_m
        if not any(mount_body_m):
            return x_m, y_m, z_m
        dx_m, dy_m, dz_m = (self.world_from_body @ np.array(mount_body_m)).tolist()
        return x_m + dx_m, y_m + dy_m, z_m + dz_m
