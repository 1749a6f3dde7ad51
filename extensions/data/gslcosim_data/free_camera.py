# pyright: reportAttributeAccessIssue=false
"""Camera of any pose for films, and where points are in its pictures."""

import math
from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Quaternion
from gslcosim.environment.model import Environment
from gslcosim.environment.variants import find_door_boxes
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.vehicles import Vehicle, get_vehicle
from gslcosim.vehicles.catalogue import RotorDrawing
from gslcosim_services.cameras.core import FAR_M, NEAR_M, add_lamps
from gslcosim_services.cameras.offscreen_renderer import OffscreenRenderer
from gslcosim_services.world.scene import scene_spec

_CAMERA_NAME = "onlooker"
FIELD_OF_VIEW_RAD = 0.9
_DRAWN_PART = "shown"
_LINE_M = 0.008
_SOURCE_M = 0.12
_ARM_FRACTION = 0.1


class FreeCamera:
    """Camera of any pose that draws an environment and its vehicles. It holds driver's memory until `close`.

    Args:
        scenario: Its agents have the vehicles.
        environment: The room.
        colors: Of the agents' vehicles, red green blue to 255.
        width_px: Of the pictures.
        height_px: Of the pictures.
    """

    def __init__(
        self,
        scenario: Scenario,
        environment: Environment,
        colors: Sequence[tuple[int, int, int]],
        width_px: int,
        height_px: int,
    ) -> None:
        vehicles = [(agent.name, get_vehicle(agent.vehicle.model)) for agent in scenario.agents]
        spec, kept = scene_spec(environment, vehicles, dt_s=1.0)
        add_lamps(spec, environment)
        # Lines a metre apart, without which one does not see that something moves.
        low_m, high_m = environment.grid.origin_m, environment.grid.max_m
        for axis in (0, 1):
            other = 1 - axis
            for at_m in range(math.ceil(low_m[axis]), math.floor(high_m[axis]) + 1):
                geom = spec.worldbody.add_geom(name=f"{_DRAWN_PART}_line_{axis}_{at_m}", type=mujoco.mjtGeom.mjGEOM_BOX)
                middle_m = [0.0, 0.0, low_m[2]]
                middle_m[axis], middle_m[other] = float(at_m), (low_m[other] + high_m[other]) / 2
                half_m = [0.0, 0.0, _LINE_M]
                half_m[axis], half_m[other] = _LINE_M, (high_m[other] - low_m[other]) / 2
                geom.pos, geom.size, geom.rgba = middle_m, half_m, [0.45, 0.48, 0.52, 1.0]
        for i, source in enumerate(scenario.gas.sources):
            ball = spec.worldbody.add_geom(name=f"{_DRAWN_PART}_source_{i}", type=mujoco.mjtGeom.mjGEOM_SPHERE)
            ball.pos, ball.size, ball.rgba = source.position_m, [_SOURCE_M, 0.0, 0.0], [1.0, 0.28, 0.28, 1.0]
        for (agent, vehicle), color in zip(vehicles, colors, strict=True):
            _add_parts(spec, agent, vehicle, color)
        spec.worldbody.add_camera(name=_CAMERA_NAME, fovy=math.degrees(FIELD_OF_VIEW_RAD))
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width_px, height_px
        spec.visual.quality.offsamples = 0
        spec.visual.quality.shadowsize = 0
        self._model = spec.compile()
        del kept
        for (agent, vehicle), color in zip(vehicles, colors, strict=True):
            self._paint(agent, vehicle, color)
        extent_m, planes = self._model.stat.extent, self._model.vis.map
        planes.znear, planes.zfar = NEAR_M / extent_m, FAR_M / extent_m
        self._data = mujoco.MjData(self._model)
        self._doors = [(box, int(self._model.geom(box.name).id)) for box in find_door_boxes(environment)]
        self._size_px = (width_px, height_px)
        self._camera = self._model.camera(_CAMERA_NAME).id
        self._view = OffscreenRenderer(self._model, width_px, height_px)

    def picture(
        self,
        poses: Mapping[str, tuple[Vec3, Quaternion]],
        eye_m: Vec3,
        looks_at_m: Vec3,
        closed: Collection[str] = (),
    ) -> NDArray[np.uint8]:
        """Return the (height, width, 3) picture of the vehicles at their poses, upper row first.

        Args:
            poses: By agent its place [m] and attitude (w, x, y, z), world frame.
            eye_m: Where one looks from, world frame [m].
            looks_at_m: What is in the middle of the picture, world frame [m]; not straight above or below the eye.
            closed: The doors that are closed, of those that events move.
        """
        for box, i in self._doors:
            self._model.geom_rgba[i, 3] = box.rgba[3] if box.name in closed else 0.0
        for agent, (position_m, quaternion_wxyz) in poses.items():
            i = self._model.joint(f"{agent}/free").qposadr[0]
            self._data.qpos[i : i + 7] = (*position_m, *quaternion_wxyz)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._data.cam_xpos[self._camera] = eye_m
        self._data.cam_xmat[self._camera] = world_from_camera(eye_m, looks_at_m).ravel()
        return self._view.colors(self._data, self._camera, *self._size_px)

    # What collides is a box or a ball: where there are rotors they are shown in place of it.
    def _paint(self, agent: str, vehicle: Vehicle, color: tuple[int, int, int]) -> None:
        root = self._model.body(f"{agent}/body").id
        for i in range(self._model.ngeom):
            if self._model.body_rootid[self._model.geom_bodyid[i]] != root:
                continue
            is_part = self._model.geom(i).name.startswith(f"{agent}/{_DRAWN_PART}")
            if vehicle.rotors is None:
                self._model.geom_rgba[i] = _rgba(color)
            elif not is_part:
                self._model.geom_rgba[i, 3] = 0.0

    def close(self) -> None:
        """Give the driver's memory back."""
        self._view.close()


def _rgba(color: tuple[int, int, int], opacity: float = 1.0) -> list[float]:
    return [*(channel / 255 for channel in color), opacity]


def _add_parts(spec: mujoco.MjSpec, agent: str, vehicle: Vehicle, color: tuple[int, int, int]) -> None:
    if vehicle.rotors is None:
        return
    body, scale = spec.body(f"{agent}/body"), vehicle.drawn_scale
    half_m = vehicle.drawing.hull_half_m if isinstance(vehicle.drawing, RotorDrawing) else (0.05, 0.05, 0.03)
    hull = body.add_geom(name=f"{agent}/{_DRAWN_PART}_hull", type=mujoco.mjtGeom.mjGEOM_BOX)
    hull.size, hull.rgba, hull.mass = [scale * side_m for side_m in half_m], _rgba(color), 0.0
    for i, place_m in enumerate(vehicle.rotors.rotor_places_m):
        tip_m = [scale * part_m for part_m in place_m]
        arm = body.add_geom(name=f"{agent}/{_DRAWN_PART}_arm_{i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE)
        arm.fromto, arm.size = (
            [0.0, 0.0, 0.0, *tip_m],
            [scale * _ARM_FRACTION * vehicle.rotors.rotor_radius_m, 0.0, 0.0],
        )
        arm.rgba, arm.mass = _rgba(color), 0.0
        disc = body.add_geom(name=f"{agent}/{_DRAWN_PART}_rotor_{i}", type=mujoco.mjtGeom.mjGEOM_CYLINDER)
        disc.pos, disc.size = tip_m, [scale * vehicle.rotors.rotor_radius_m, _LINE_M, 0.0]
        disc.rgba, disc.mass = [0.9, 0.92, 0.95, 0.55], 0.0


def world_from_camera(eye_m: Vec3, looks_at_m: Vec3) -> NDArray[np.float64]:
    """Return the (3, 3) rotation of a camera that looks at a place, upright: columns right, up and backward."""
    backward = np.subtract(eye_m, looks_at_m)
    backward = backward / np.linalg.norm(backward)
    right = np.cross((0.0, 0.0, 1.0), backward)
    right = right / np.linalg.norm(right)
    return np.column_stack([right, np.cross(backward, right), backward])


def project_points(
    points_m: NDArray[np.float64], eye_m: Vec3, looks_at_m: Vec3, width_px: int, height_px: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where points are in a picture of an onlooker, (n, 2) right and down [pixels], and how far ahead (n,) [m].

    Args:
        points_m: (n, 3) world frame [m].
        eye_m: As for the picture.
        looks_at_m: As for the picture.
        width_px: Of the picture.
        height_px: Of the picture.
    """
    in_camera = (points_m - np.array(eye_m)) @ world_from_camera(eye_m, looks_at_m)
    ahead_m = -in_camera[:, 2]
    focal_px = height_px / 2 / math.tan(FIELD_OF_VIEW_RAD / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        right_px = width_px / 2 + focal_px * in_camera[:, 0] / ahead_m
        down_px = height_px / 2 - focal_px * in_camera[:, 1] / ahead_m
    return np.column_stack([right_px, down_px]), ahead_m
