"""Rows of on-board sensors in space: points of lidars, rays, and pictures of cameras.

All of it is drawn in the world, from where the vehicle was when the sensor saw it: readings come late and are held
until the next, while the vehicle flies on.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

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
    RaySensorSpec,
    SensorSpec,
    TdlasSensorSpec,
)
from gslcosim_services.recorder.colors import Rgb
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.columns import Rows
from gslcosim_services.sensing.models.range_finders import ray_directions_body

# Negative, which for Rerun is in points of the screen: a scan is seen through from near, and not lost from far.
POINT_RADIUS = -1.2
RAY_RADIUS_M = 0.008
# How far before the eye a picture hangs in space, and how thick the lines to its corners are.
PICTURE_DISTANCE_M = 0.5
FRUSTUM_WIDTH_M = 0.006
DEPTH_UNITS_PER_M = 1000.0
# How much of its pixel a point of a depth picture fills in space: what is behind stays visible.
DEPTH_FILL_FRAC = 0.25


class PoseHistory:
    """History of a vehicle's poses, as far as its sensors' readings reach back: a delay, and a period of pictures."""

    def __init__(self, sensors: Sequence[SensorSpec], tick_ns: int) -> None:
        ages = [_ticks(sensor.delay_s, tick_ns) + _ticks(sensor.period_s or 0.0, tick_ns) for sensor in sensors]
        self._poses: deque[tuple[Vec3, Quaternion]] = deque(maxlen=max(ages, default=0) + 1)
        self._last_tick = -1

    def add(self, tick: int, body: BodyState) -> None:
        """Take note of the pose at the end of a tick."""
        self._poses.append((body.position_world_m, body.quaternion_wxyz))
        self._last_tick = tick

    def at(self, tick: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (3, 3) rotation and the (3,) position [m], world from body, of a tick or of the oldest known."""
        age = min(max(self._last_tick - tick, 0), len(self._poses) - 1)
        position_m, quaternion = self._poses[-1 - age]
        return world_from_body_rotation(quaternion), np.array(position_m)


class RowTiming:
    """Timing of a sensor's rows: the ticks with new readings, and the age of what they show."""

    def __init__(self, sensor: SensorSpec, tick_ns: int) -> None:
        self._period_ticks = _ticks(sensor.period_s or 0.0, tick_ns) or 1
        self._delay_ticks = _ticks(sensor.delay_s, tick_ns)

    def seen_tick(self, tick: int) -> int | None:
        """Return the tick that a reading of a tick shows; nothing where it is an old one."""
        return tick - self._delay_ticks if tick % self._period_ticks == 0 else None


class RangeRows(Rows[NDArray[np.floating]]):
    """Rows of a sensor with a range for each of its rays, (n, 3) unit vectors in the body frame; absent: its own."""

    def __init__(
        self,
        entity: str,
        sensor: RaySensorSpec | TdlasSensorSpec,
        poses: PoseHistory,
        timing: RowTiming,
        color: Rgb,
        directions: NDArray[np.float64] | None = None,
    ) -> None:
        super().__init__(entity)
        self._mount_m = np.array(sensor.mount_m)
        self._limit_m = sensor.max_range_m
        self._poses = poses
        self._timing = timing
        self._color = color
        if directions is None:
            assert isinstance(sensor, RaySensorSpec)
            directions = ray_directions_body(sensor).reshape(-1, 3)
        self._directions = directions


class LidarRows(RangeRows):
    """Points that a lidar saw; each scan replaces the one before.

    Ranges at the end of the lidar's reach are no points.
    """

    def draw(self, file: RecordingFile) -> None:
        """Write how the points look."""
        file.draw(self._entity, rr.Points3D.from_fields(colors=[self._color], radii=[POINT_RADIUS]))

    def add_reading(self, tick: int, reading: Reading) -> None:
        """Append a scan, if the reading has a new one."""
        seen_tick = self._timing.seen_tick(tick)
        if reading.array is None or seen_tick is None:
            return
        ranges_m = reading.array.to_array().ravel()
        is_hit = ranges_m < self._limit_m
        points_m = self._mount_m + ranges_m[is_hit, None] * self._directions[is_hit]
        rotation, position_m = self._poses.at(seen_tick)
        self.add(tick, (position_m + points_m @ rotation.T).astype(np.float32))

    def _columns(self, items: Sequence[NDArray[np.floating]]) -> rr.ComponentColumnList:
        columns = rr.Points3D.columns(positions=np.concatenate(items))
        return columns.partition([len(cloud) for cloud in items])


class RayRows(RangeRows):
    """Rays from a sensor to what they meet; those that meet nothing have no length."""

    def draw(self, file: RecordingFile) -> None:
        """Write how the rays look."""
        file.draw(self._entity, rr.LineStrips3D.from_fields(colors=[self._color], radii=[RAY_RADIUS_M]))

    def add_reading(self, tick: int, reading: Reading) -> None:
        """Append a reading of one range for each ray, if it is new."""
        seen_tick = self._timing.seen_tick(tick)
        if seen_tick is not None and not reading.is_warming_up:
            self.add_ranges(tick, reading.values, seen_tick)

    def add_ranges(self, tick: int, ranges_m: Sequence[float], seen_tick: int) -> None:
        """Append a range [m] for each ray, as seen at the end of a tick that may be past."""
        lengths_m = np.array(ranges_m)
        lengths_m[lengths_m >= self._limit_m] = 0.0
        ends_m = self._mount_m + lengths_m[:, None] * self._directions
        rotation, position_m = self._poses.at(seen_tick)
        strips_m = np.stack([np.broadcast_to(self._mount_m, ends_m.shape), ends_m], axis=1)
        self.add(tick, position_m + strips_m @ rotation.T)

    def _columns(self, items: Sequence[NDArray[np.floating]]) -> rr.ComponentColumnList:
        columns = rr.LineStrips3D.columns(strips=list(np.concatenate(items).astype(np.float32)))
        return columns.partition([len(self._directions)] * len(items))


class _Eye(NamedTuple):
    image: CameraImage
    place_m: NDArray[np.float64]
    quaternion_xyzw: tuple[float, float, float, float]


class ImageRows(Rows[_Eye]):
    """Pictures of a camera as they travelled, each before the eye that took it, with its calibration.

    Depths have a scale of their own, from the camera to the end of its range.
    """

    def __init__(self, entity: str, sensor: CameraSensorSpec, poses: PoseHistory, color: Rgb) -> None:
        super().__init__(entity)
        self._max_range_m = sensor.max_range_m if isinstance(sensor, DepthCameraSpec) else 0.0
        self._poses = poses
        self._color = color
        self._is_calibrated = False
        self._last_taken_tick = -1

    def draw(self, file: RecordingFile) -> None:
        """Write nothing yet: the calibration comes with the first picture."""

    def add_reading(self, tick: int, reading: Reading) -> None:
        """Append a picture, if the reading has one that was not there before."""
        image = reading.image
        if image is None or image.taken_tick == self._last_taken_tick:
            return
        self._last_taken_tick = image.taken_tick
        rotation, position_m = self._poses.at(image.taken_tick)
        w, x, y, z = quaternion_from_rotation(rotation @ world_from_body_rotation(image.quaternion_body_wxyz))
        self.add(tick, _Eye(image, position_m + rotation @ np.array(image.position_body_m), (x, y, z, w)))

    def send(self, file: RecordingFile) -> None:
        """Write the waiting pictures, if any, with the places of the eyes that took them, and forget them."""
        ticks, items = self._ticks, self._items
        if not ticks:
            return
        if not self._is_calibrated:
            self._calibrate(file, items[0].image)
        super().send(file)
        eyes = rr.Transform3D.columns(
            translation=np.array([item.place_m for item in items], dtype=np.float32),
            quaternion=np.array([item.quaternion_xyzw for item in items], dtype=np.float32),
        )
        file.send(self._entity, ticks, eyes)

    def _columns(self, items: Sequence[_Eye]) -> rr.ComponentColumnList:
        blobs, encoding = [item.image.data for item in items], items[0].image.encoding
        if encoding == "depth_png":
            return rr.EncodedDepthImage.columns(blob=blobs, media_type=["image/png"] * len(blobs))
        return rr.EncodedImage.columns(blob=blobs, media_type=[f"image/{encoding}"] * len(blobs))

    def _calibrate(self, file: RecordingFile, image: CameraImage) -> None:
        pinhole = rr.Pinhole(
            focal_length=image.focal_px,
            principal_point=image.centre_px,
            width=image.width_px,
            height=image.height_px,
            image_plane_distance=PICTURE_DISTANCE_M,
            color=self._color,
            line_width=FRUSTUM_WIDTH_M,
        )
        file.draw(self._entity, pinhole)
        if image.encoding == "depth_png":
            file.draw(self._entity, self._depth_scale())
        self._is_calibrated = True

    def _depth_scale(self) -> rr.EncodedDepthImage:
        return rr.EncodedDepthImage.from_fields(
            meter=DEPTH_UNITS_PER_M,
            depth_range=(0.0, DEPTH_UNITS_PER_M * self._max_range_m),
            point_fill_ratio=DEPTH_FILL_FRAC,
            colormap=rr.components.Colormap.Viridis,
        )


def _ticks(duration_s: float, tick_ns: int) -> int:
    return exact_ticks_from_seconds(duration_s, tick_ns, name="duration") if duration_s else 0
