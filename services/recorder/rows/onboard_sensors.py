"""Rows of on-board sensors in space: points of lidars, rays, and pictures of cameras.

All are drawn in the world, from the vehicle's pose at the measurement: readings come late and are held until the next,
while the vehicle moves on.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.base.frames import quaternion_from_rotation, world_from_body_rotation
from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import exact_ticks_from_seconds
from gslcosim.contract.messages import BodyState, CameraImage, Quaternion, Reading
from gslcosim.scenario.models.sensors import (
    CameraSensorSpec,
    DepthCameraSpec,
    LidarSensorSpec,
    RaySensorSpec,
    SensorSpec,
    TdlasSensorSpec,
)
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.entities import AgentEntities
from gslcosim_services.recorder.rows.archetypes import CameraView
from gslcosim_services.recorder.rows.columns import RecordingRows
from gslcosim_services.sensing.models.range_finders import ray_directions_body

# Distance of a picture from its camera in space, and width of the lines to its corners.
PICTURE_DISTANCE_M = 0.5
FRUSTUM_WIDTH_M = 0.006
DEPTH_UNITS_PER_M = 1000.0
# Fraction of its pixel that a point of a depth picture fills in space: objects behind stay visible.
DEPTH_FILL_FRAC = 0.25


class PoseHistory:
    """History of a vehicle's poses, as far as its sensors' readings reach back: a delay, and a period of pictures."""

    def __init__(self, sensors: Sequence[SensorSpec], tick_ns: int) -> None:
        ages = [_ticks(sensor.delay_s, tick_ns) + _ticks(sensor.period_s or 0.0, tick_ns) for sensor in sensors]
        self._poses: deque[tuple[Vec3, Quaternion]] = deque(maxlen=max(ages, default=0) + 1)
        self._last_tick = -1

    def add(self, tick: int, body: BodyState) -> None:
        """Append the pose at the end of a tick."""
        self._poses.append((body.position_world_m, body.quaternion_wxyz))
        self._last_tick = tick

    def at(self, tick: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (3, 3) rotation and the (3,) position [m], world from body, of a tick or the oldest one."""
        age = min(max(self._last_tick - tick, 0), len(self._poses) - 1)
        position_m, quaternion = self._poses[-1 - age]
        return world_from_body_rotation(quaternion), np.array(position_m)


class RangeRows:
    """Points of a lidar's scans, or rays of a sensor to the obstacles that they meet.

    Each scan replaces the one before. A range at the end of the sensor's reach is no point, and a ray without length.
    """

    def __init__(
        self,
        rows: RecordingRows,
        names: AgentEntities,
        sensor: RaySensorSpec | TdlasSensorSpec,
        poses: PoseHistory,
        tick_ns: int,
    ) -> None:
        self._is_lidar = isinstance(sensor, LidarSensorSpec)
        stream = streams.POINT_CLOUDS if self._is_lidar else streams.RAYS
        self._rows = rows.of(stream, agent=names.agent.name, sensor=sensor.name)
        self._mount_m = np.array(sensor.mount_m)
        self._limit_m = sensor.max_range_m
        self._poses = poses
        self._period_ticks = _ticks(sensor.period_s or 0.0, tick_ns) or 1
        self._delay_ticks = _ticks(sensor.delay_s, tick_ns)
        # (n, 3) unit vectors in the body frame.
        self._directions = (
            ray_directions_body(sensor).reshape(-1, 3)
            if isinstance(sensor, RaySensorSpec)
            else np.array([sensor.beam_body]) / np.linalg.norm(sensor.beam_body)
        )

    def add_reading(self, tick: int, reading: Reading) -> None:
        """Append a reading, unless it is an old one."""
        if tick % self._period_ticks:
            return
        if not self._is_lidar and not reading.is_warming_up:
            self.add_rays(tick, reading.values, tick - self._delay_ticks)
        elif self._is_lidar and reading.array is not None:
            ranges_m = reading.array.to_array().ravel()
            is_hit = ranges_m < self._limit_m
            points_m = self._mount_m + ranges_m[is_hit, None] * self._directions[is_hit]
            rotation, position_m = self._poses.at(tick - self._delay_ticks)
            self._rows.add(tick, (position_m + points_m @ rotation.T).astype(np.float32))

    def add_rays(self, tick: int, ranges_m: Sequence[float], measured_tick: int) -> None:
        """Append a range [m] for each ray, as measured at the end of a tick that may be past."""
        lengths_m = np.array(ranges_m)
        lengths_m[lengths_m >= self._limit_m] = 0.0
        ends_m = self._mount_m + lengths_m[:, None] * self._directions
        rotation, position_m = self._poses.at(measured_tick)
        strips_m = np.stack([np.broadcast_to(self._mount_m, ends_m.shape), ends_m], axis=1)
        self._rows.add(tick, position_m + strips_m @ rotation.T)


class ImageRows:
    """Pictures of a camera as transmitted, each at its camera's pose, with the camera's calibration.

    Depths have a scale of their own, from the camera to the end of its range.
    """

    def __init__(self, rows: RecordingRows, names: AgentEntities, sensor: CameraSensorSpec, poses: PoseHistory) -> None:
        self._rows = rows.of(streams.PICTURES, agent=names.agent.name, sensor=sensor.name)
        self._file = rows.file
        self._max_range_m = sensor.max_range_m if isinstance(sensor, DepthCameraSpec) else 0.0
        self._poses = poses
        self._color = names.color
        self._last_taken_tick: int | None = None

    def add_reading(self, tick: int, reading: Reading) -> None:
        """Append the reading's picture, unless it is the one before."""
        image = reading.image
        if image is None or image.taken_tick == self._last_taken_tick:
            return
        if self._last_taken_tick is None:
            self._calibrate(image)
        self._last_taken_tick = image.taken_tick
        rotation, position_m = self._poses.at(image.taken_tick)
        w, x, y, z = quaternion_from_rotation(rotation @ world_from_body_rotation(image.quaternion_body_wxyz))
        self._rows.add(tick, CameraView(image, position_m + rotation @ np.array(image.position_body_m), (x, y, z, w)))

    def _calibrate(self, image: CameraImage) -> None:
        pinhole = rr.Pinhole(
            focal_length=image.focal_px,
            principal_point=image.centre_px,
            width=image.width_px,
            height=image.height_px,
            image_plane_distance=PICTURE_DISTANCE_M,
            color=self._color,
            line_width=FRUSTUM_WIDTH_M,
        )
        self._file.draw(self._rows.entity, pinhole)
        if image.encoding == "depth_png":
            depth_scale = rr.EncodedDepthImage.from_fields(
                meter=DEPTH_UNITS_PER_M,
                depth_range=(0.0, DEPTH_UNITS_PER_M * self._max_range_m),
                point_fill_ratio=DEPTH_FILL_FRAC,
                colormap=rr.components.Colormap.Viridis,
            )
            self._file.draw(self._rows.entity, depth_scale)


def _ticks(duration_s: float, tick_ns: int) -> int:
    return exact_ticks_from_seconds(duration_s, tick_ns, name="duration") if duration_s else 0
