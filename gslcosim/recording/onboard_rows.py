"""What on-board sensors see: points of lidars around the vehicle, and pictures of cameras."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.contract.messages import CameraImage, Reading
from gslcosim.recording.colors import Rgb
from gslcosim.recording.run_file import RunFile
from gslcosim.scenario.models import SensorSpec
from gslcosim.sensing.models.ranging import directions_body

POINT_RADIUS_M = 0.02


class LidarRows:
    """Points that a lidar saw, in the frame of its vehicle; each scan replaces the one before.

    Ranges at the end of the lidar's reach are no points.
    """

    def __init__(self, entity: str, sensor: SensorSpec, color: Rgb) -> None:
        self._entity = entity
        self._sensor = sensor
        self._color = color
        self._directions = directions_body(sensor).reshape(-1, 3)
        self._is_drawn = False
        self._ticks: list[int] = []
        self._clouds_m: list[NDArray[np.float32]] = []

    def add(self, tick: int, reading: Reading) -> None:
        """Append a scan, if the reading has one."""
        if reading.array is None:
            return
        ranges_m = reading.array.to_array().ravel()
        seen = ranges_m < self._sensor.max_range_m
        points_m = np.array(self._sensor.mount_m) + ranges_m[seen, None] * self._directions[seen]
        self._ticks.append(tick)
        self._clouds_m.append(points_m.astype(np.float32))

    def send(self, file: RunFile) -> None:
        """Write the waiting scans, if any, and forget them."""
        if not self._ticks:
            return
        if not self._is_drawn:
            file.draw(self._entity, rr.Points3D.from_fields(colors=[self._color], radii=[POINT_RADIUS_M]))
            self._is_drawn = True
        columns = rr.Points3D.columns(positions=np.concatenate(self._clouds_m))
        file.send(self._entity, self._ticks, columns.partition([len(cloud) for cloud in self._clouds_m]))
        self._ticks, self._clouds_m = [], []


class ImageRows:
    """Pictures of a camera as they travelled, with the pinhole that took them."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._is_placed = False
        self._last_taken_tick = -1
        self._ticks: list[int] = []
        self._images: list[CameraImage] = []

    def add(self, tick: int, reading: Reading) -> None:
        """Append a picture, if the reading has one that was not there before."""
        image = reading.image
        if image is not None and image.taken_tick != self._last_taken_tick:
            self._last_taken_tick = image.taken_tick
            self._ticks.append(tick)
            self._images.append(image)

    def send(self, file: RunFile) -> None:
        """Write the waiting pictures, if any, and forget them."""
        if not self._ticks:
            return
        if not self._is_placed:
            self._place(file, self._images[0])
        blobs = [image.data for image in self._images]
        if self._images[0].encoding == "depth_png":
            columns = rr.EncodedDepthImage.columns(blob=blobs, media_type=["image/png"] * len(blobs))
        else:
            media_type = f"image/{self._images[0].encoding}"
            columns = rr.EncodedImage.columns(blob=blobs, media_type=[media_type] * len(blobs))
        file.send(self._entity, self._ticks, columns)
        self._ticks, self._images = [], []

    def _place(self, file: RunFile, image: CameraImage) -> None:
        w, x, y, z = image.quaternion_body_wxyz
        pinhole = rr.Pinhole(
            focal_length=image.focal_px,
            principal_point=image.centre_px,
            width=image.width_px,
            height=image.height_px,
            image_plane_distance=0.5,
        )
        place = rr.Transform3D(translation=image.position_body_m, quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
        file.draw(self._entity, pinhole, place)
        self._is_placed = True
