# pyright: reportAttributeAccessIssue=false
"""Cameras core: colour and depth pictures from the poses of a tick, and a free camera for films."""

import io
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, cast

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base.frames import quaternion_from_rotation, rotation_from_rpy
from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import exact_ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, CameraFrame, CameraFrames, CameraImage, Quaternion
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.environment.model import Environment, Light
from gslcosim.environment.variants import DynamicEnvironment, find_door_boxes
from gslcosim.scenario.models.scenario import AgentSpec, Scenario
from gslcosim.scenario.models.sensors import CameraSensorSpec, ColourCameraSpec, DepthCameraSpec
from gslcosim.vehicles import Vehicle, get_vehicle
from gslcosim.vehicles.catalogue import RotorDrawing
from gslcosim_services.cameras.offscreen_renderer import OffscreenRenderer
from gslcosim_services.cameras.service import cameras_spec
from gslcosim_services.world.scene import scene_spec

NEAR_M = 0.02
FAR_M = 500.0
MM_PER_M = 1000.0
MAX_DEPTH_MM = 65535
JPEG_QUALITY = 90
# OpenGL shines with eight lamps at once, one of them the camera's own.
MAX_LAMPS = 7
# Columns: x, y, z of the axes that MuJoCo gives a camera (right, up, backward) and of the optical frame (right, down,
# ahead), in those of the sensor (ahead, left, up).
_SENSOR_FROM_MUJOCO = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_SENSOR_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class _Camera:
    """One camera: which of the model's it is, when it takes pictures, and its own vehicle's geoms."""

    agent: str
    spec: CameraSensorSpec
    number: int
    period_ticks: int
    own_geoms: NDArray[np.intp]


class CamerasCore:
    """Takes pictures of colours and of depths for all cameras of a run, in a MuJoCo scene of its own.

    Reads `truth/bodies` of the same tick, and `truth/events` of the last one where doors have some. Writes
    `truth/images` every tick, with the pictures of the cameras whose period is over. A camera does not see its own
    vehicle. Wheels do not turn in pictures. Lamps of the room shine without shadows, seven of them at most, evenly
    chosen, beside a dim one at the camera.

    State: which doors are closed. Draws no random numbers. One driver gives the same pictures run after run; another
    driver may differ in single pixels.
    Raises ModelError when built where neither EGL nor OSMesa works.

    Held by:
        tests/unit/services/cameras/test_core.py
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        self.spec = cameras_spec(scenario)
        self._agents = scenario.agents
        self._model = _build_model(scenario, environment)
        self._data = mujoco.MjData(self._model)
        self._room = DynamicEnvironment(environment, scenario)
        self._doors = [(box, int(self._model.geom(box.name).id)) for box in find_door_boxes(environment)]
        self._qpos = {a.name: self._model.joint(f"{a.name}/free").qposadr[0] for a in self._agents}
        self._cameras = [self._camera(agent, sensor, scenario.tick_ns) for agent, sensor in scenario.cameras]
        sizes = [sensor.camera for _, sensor in scenario.cameras]
        self._view = OffscreenRenderer(
            self._model, max(size.width_px for size in sizes), max(size.height_px for size in sizes)
        )

    def reset(self, episode: Episode) -> Outbox:
        """Close and open the doors as at the start: else pictures depend on the poses only."""
        del episode
        self._room.reset()
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Take the pictures that are due at the end of the tick."""
        self._room.obey(inbox)
        due = [camera for camera in self._cameras if tick % camera.period_ticks == 0]
        if due:
            self._place(cast(BodyPoses, inbox[keys.BODIES]))
            self._show_doors()
        return {keys.IMAGES: CameraFrames(tick=tick, frames=tuple(self._frame(camera, tick) for camera in due))}

    def close(self) -> None:
        """Give the driver's memory back."""
        self._view.close()

    def _camera(self, agent: AgentSpec, sensor: CameraSensorSpec, tick_ns: int) -> _Camera:
        root = self._model.body(f"{agent.name}/body").id
        own = [i for i in range(self._model.ngeom) if self._model.body_rootid[self._model.geom_bodyid[i]] == root]
        period_ticks = 1
        if sensor.period_s:
            period_ticks = exact_ticks_from_seconds(sensor.period_s, tick_ns, name=f"sensor {sensor.name}: period_s")
        return _Camera(
            agent=agent.name,
            spec=sensor,
            number=self._model.camera(f"{agent.name}/{sensor.name}").id,
            period_ticks=period_ticks,
            own_geoms=np.array(own),
        )

    def _place(self, bodies: BodyPoses) -> None:
        for body in bodies.bodies:
            i = self._qpos[body.agent]
            self._data.qpos[i : i + 7] = (*body.position_world_m, *body.quaternion_wxyz)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def _show_doors(self) -> None:
        for box, i in self._doors:
            self._model.geom_rgba[i, 3] = box.rgba[3] if box.name in self._room.variant.closed else 0.0

    def _frame(self, camera: _Camera, tick: int) -> CameraFrame:
        opacity = self._model.geom_rgba[camera.own_geoms, 3].copy()
        self._model.geom_rgba[camera.own_geoms, 3] = 0.0
        encoding, data = self._picture(camera)
        self._model.geom_rgba[camera.own_geoms, 3] = opacity
        size, sensor = camera.spec.camera, camera.spec
        image = CameraImage(
            encoding=encoding,
            width_px=size.width_px,
            height_px=size.height_px,
            focal_px=size.height_px / 2 / math.tan(size.vertical_fov_rad / 2),
            centre_px=(size.width_px / 2, size.height_px / 2),
            position_body_m=sensor.mount_m,
            quaternion_body_wxyz=_rotate_sensor(sensor, _SENSOR_FROM_OPTICAL),
            taken_tick=tick,
            data=data,
        )
        return CameraFrame(agent=camera.agent, sensor=sensor.name, image=image)

    def _picture(self, camera: _Camera) -> tuple[Literal["png", "jpeg", "depth_png"], bytes]:
        spec, size, file = camera.spec, camera.spec.camera, io.BytesIO()
        where = (self._data, camera.number, size.width_px, size.height_px)
        if isinstance(spec, DepthCameraSpec):
            depths_mm = np.rint(self._view.depths_m(*where) * MM_PER_M)
            limit_mm = min(MAX_DEPTH_MM, spec.max_range_m * MM_PER_M)
            depths_mm[depths_mm > limit_mm] = 0
            Image.fromarray(depths_mm.astype(np.uint16)).save(file, "PNG", compress_level=1)
            return "depth_png", file.getvalue()
        picture = Image.fromarray(np.ascontiguousarray(self._view.colors(*where)))
        encoding = spec.camera.encoding if isinstance(spec, ColourCameraSpec) else "png"
        if encoding == "jpeg":
            picture.save(file, "JPEG", quality=JPEG_QUALITY)
        else:
            picture.save(file, "PNG", compress_level=1)
        return encoding, file.getvalue()


def _build_model(scenario: Scenario, environment: Environment) -> mujoco.MjModel:
    vehicles = [(agent.name, get_vehicle(agent.vehicle.model)) for agent in scenario.agents]
    spec, kept = scene_spec(environment, vehicles, dt_s=1.0)
    add_lamps(spec, environment)
    for agent, sensor in scenario.cameras:
        spec.body(f"{agent.name}/body").add_camera(
            name=f"{agent.name}/{sensor.name}",
            pos=sensor.mount_m,
            quat=_rotate_sensor(sensor, _SENSOR_FROM_MUJOCO),
            fovy=math.degrees(sensor.camera.vertical_fov_rad),
        )
    sizes = [sensor.camera for _, sensor in scenario.cameras]
    spec.visual.global_.offwidth = max(size.width_px for size in sizes)
    spec.visual.global_.offheight = max(size.height_px for size in sizes)
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 0
    model = spec.compile()
    del kept
    model.vis.map.znear, model.vis.map.zfar = NEAR_M / model.stat.extent, FAR_M / model.stat.extent
    return model


def add_lamps(spec: mujoco.MjSpec, environment: Environment) -> None:
    """Add the lamps of a room to a scene, without shadows: as many as OpenGL has, evenly chosen."""
    for light in _lamps(environment):
        spec.worldbody.add_light(name=f"lamp_{light.name}", pos=light.position_m, castshadow=False)


def _lamps(environment: Environment) -> tuple[Light, ...]:
    every = math.ceil(len(environment.lights) / MAX_LAMPS)
    return environment.lights[::every] if every else ()


def _rotate_sensor(sensor: CameraSensorSpec, sensor_from_camera: NDArray[np.float64]) -> Quaternion:
    return quaternion_from_rotation(rotation_from_rpy(sensor.mount_rpy_rad) @ sensor_from_camera)


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
        _add_floor_lines(spec, environment)
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


# Lines a metre apart, without which one does not see that something moves.
def _add_floor_lines(spec: mujoco.MjSpec, environment: Environment) -> None:
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
