# pyright: reportAttributeAccessIssue=false
"""Cameras core: colour and depth pictures from the poses of a tick."""

import io
import math
from dataclasses import dataclass
from typing import Literal, cast

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base import elementary
from gslcosim.base.frames import quaternion_from_rotation, rotation_from_rpy
from gslcosim.base.ticks import exact_ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, CameraFrame, CameraFrames, CameraImage, Quaternion
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.environment.model import Environment
from gslcosim.environment.variants import DynamicEnvironment, find_door_boxes
from gslcosim.scenario.models.scenario import AgentSpec, Scenario
from gslcosim.scenario.models.sensors import CameraSensorSpec, ColourCameraSpec, DepthCameraSpec
from gslcosim.vehicles import get_vehicle
from gslcosim_services.cameras.offscreen_renderer import OffscreenRenderer
from gslcosim_services.cameras.service import cameras_spec
from gslcosim_services.world.scene import scene_spec

NEAR_M = 0.02
FAR_M = 500.0
MM_PER_M = 1000.0
MAX_DEPTH_MM = 65535
JPEG_QUALITY = 90
# OpenGL has eight lamps at once, one of them the camera's own.
MAX_LAMPS = 7
# Columns: axes of MuJoCo's camera (right, up, backward) and of the optical frame (right, down, ahead), in the axes of
# the sensor (ahead, left, up).
_SENSOR_FROM_MUJOCO = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_SENSOR_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class _Camera:
    """One camera: its index in the model, its period, and the geoms of its own vehicle."""

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
        """Close and open the doors as at the start; pictures depend on nothing else but the poses."""
        del episode
        self._room.reset()
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Take the pictures that are due at the end of the tick."""
        self._room.obey(inbox)
        due = [camera for camera in self._cameras if tick % camera.period_ticks == 0]
        if due:
            self._place(cast(BodyPoses, inbox[keys.BODIES]))
            for box, i in self._doors:
                self._model.geom_rgba[i, 3] = box.rgba[3] if box.name in self._room.variant.closed else 0.0
        return {keys.IMAGES: CameraFrames(tick=tick, frames=tuple(self._frame(camera, tick) for camera in due))}

    def close(self) -> None:
        """Release the driver's memory."""
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
            focal_px=size.height_px / 2 / elementary.tan(size.vertical_fov_rad / 2),
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
    every = max(1, math.ceil(len(environment.lights) / MAX_LAMPS))
    for light in environment.lights[::every]:
        spec.worldbody.add_light(name=f"lamp_{light.name}", pos=light.position_m, castshadow=False)


def _rotate_sensor(sensor: CameraSensorSpec, sensor_from_camera: NDArray[np.float64]) -> Quaternion:
    return quaternion_from_rotation(elementary.product(rotation_from_rpy(sensor.mount_rpy_rad), sensor_from_camera))
