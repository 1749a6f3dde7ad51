"""Sensors of the surroundings: range finders, lidars, bumpers and cameras."""

import math
from collections.abc import MutableSequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.base.frames import rotation_from_rpy
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import norm3, scalar_kernel
from gslcosim.contract.messages import CameraImage, Reading
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.sensors import (
    AzimuthsSpec,
    BumpSensorSpec,
    CameraSensorSpec,
    ElevationsSpec,
    FourRangeFindersSpec,
    LidarSensorSpec,
    RangeFinderSpec,
    RaySensorSpec,
)
from gslcosim_services.sensing.models.base import (
    SensorKind,
    Surroundings,
    make_kind,
    new_reading,
    new_window,
    push_count,
)

# Front, left, back, right.
FOUR_BEAMS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))


class Bumper:
    """values = (1 or 0,): whether anything touched the vehicle in the last `period_s`; without a period, in the tick.

    The ground under wheels does not count; the ground before a take-off does. State: the
    contacts of each tick within the period. Draws nothing. Held by: tests/unit/services/sensing/test_bumper.py
    """

    def __init__(self, spec: BumpSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        del rng
        self._sensor = spec.name
        self._contacts = list(new_contacts(spec, tick_s))

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return 1 after a contact, else 0."""
        del mount_velocity_world_m_s
        value = note_contact(self._contacts, bool(sample.body.contacts))
        return new_reading(sensor=self._sensor, quantity="contact", unit="1", values=(value,))


def new_contacts(spec: BumpSensorSpec, tick_s: float) -> tuple[float, ...]:
    """Return the state of a new bumper, for `note_contact`."""
    return new_window(spec.period_s or tick_s, tick_s)


@scalar_kernel
def note_contact(contacts: MutableSequence[float], is_touched: bool) -> float:  # noqa: FBT001 - a kernel
    """Take note of a tick, and return 1 where anything touched the vehicle in the bumper's period, else 0."""
    return 1.0 if push_count(contacts, 1.0 if is_touched else 0.0) > 0.0 else 0.0


BUMPER = make_kind(
    SensorKind, "bump", "contact", "1",
    "Bumper: values = (1 or 0,), 1 if anything touched the vehicle since the last reading.",
    build=Bumper, n_with_errors=0,
)  # fmt: skip


class Camera:
    """Shows the last picture that was taken: `image`, no values; the cameras' own core renders it.

    State: the last picture. Draws nothing: pictures have no noise but that of their encoding.

    Held by:
        tests/unit/services/cameras/test_core.py
    """

    def __init__(self, spec: CameraSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        del tick_s, rng
        self._spec = spec
        self._image: CameraImage | None = None

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the last picture."""
        del mount_velocity_world_m_s
        self._image = sample.images.get(self._spec.name, self._image)
        if self._image is None:
            raise ModelError(f"sensing: expected a picture of {sample.body.agent}.{self._spec.name}, was none.")
        kind = CAMERAS_BY_NAME[self._spec.model]
        return new_reading(sensor=self._spec.name, quantity=kind.quantity, unit=kind.unit, values=(), image=self._image)


CAMERA_KINDS = tuple(
    make_kind(SensorKind, name, quantity, unit, description, build=Camera, n_with_errors=0)
    for name, quantity, unit, description in (
        ("camera", "picture", "1", "Colour camera: no values; image = PNG or JPEG with its calibration."),
        ("depth_camera", "depth", "mm", "Depth camera: no values; image = PNG of 16-bit depths, 0 out of range."),
    )
)
CAMERAS_BY_NAME = {kind.name: kind for kind in CAMERA_KINDS}


class RangeSensor:
    """Rays from one mount: each range = distance to the nearest object + N(0, noise_std), within 0 to `max_range_m`.

    Boxes of the room reflect exactly where they are, other vehicles as upright cylinders (see `RayScene`), its own
    vehicle not at all. Without an object in range, the range is `max_range_m`; where that holds for every ray, the
    reading `is_saturated`. Range finders have their ranges in `values`; lidars have the least of them there, and all in
    `array`, (elevations, azimuths) float32, lowest elevation first, azimuths counter-clockwise.

    State: none. Draws a number for each ray in each tick where `noise_std` is not 0.

    Source:
        Four beams as on the drones of Sniffy Bug (Duisterhof et al. 2021), Bitcraze's Multi-ranger deck, which reaches
        4 m. The default 16 elevations over 30 degrees are those of Velodyne's VLP-16.
    Left out:
        Width of beams, materials, and the turning of a lidar during a scan: all rays are of one instant.
    Held by:
        tests/unit/services/sensing/test_range_finders.py (closed forms in a box with three different side lengths)
    """

    def __init__(self, spec: RaySensorSpec, rng: np.random.Generator) -> None:
        self._spec = spec
        self._rng = rng
        self._directions_body = ray_directions_body(spec)
        self._rays_body = self._directions_body.reshape(-1, 3)
        self._is_lidar = self._directions_body.ndim == 3

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the ranges at the end of the tick."""
        del mount_velocity_world_m_s
        from gslcosim_services.sensing.ray_kernels import disturb_ranges_inplace, turn_rays  # see `Imu.read`

        limit_m, noise_m = self._spec.max_range_m, self._spec.noise_std
        rays_world = turn_rays(sample.world_from_body.ravel(), self._rays_body)
        start_m = np.array(sample.place_world_m(self._spec.mount_m))
        ranges_m = sample.scene.ranges_m(start_m, rays_world, sample.others, limit_m)
        is_hit = ranges_m < limit_m
        if noise_m:
            disturb_ranges_inplace(ranges_m, limit_m, noise_m * self._rng.standard_normal(len(ranges_m)))
        shape = self._directions_body.shape[:-1]
        return new_reading(
            sensor=self._spec.name,
            quantity="range",
            unit="m",
            values=(float(ranges_m.min()),) if self._is_lidar else tuple(ranges_m.tolist()),
            is_saturated=not is_hit.any(),
            array=NumericArray.from_array(ranges_m.reshape(shape).astype(np.float32)) if self._is_lidar else None,
        )


def ray_directions_body(spec: RaySensorSpec) -> NDArray[np.float64]:
    """Return the unit directions of a sensor's rays in the body frame: (n, 3), or (elevations, azimuths, 3) of lidars.

    Args:
        spec: A range finder or a lidar.
    """
    match spec:
        case RangeFinderSpec():
            directions = np.array([spec.beam_body]) / norm3(*spec.beam_body)
        case FourRangeFindersSpec():
            directions = np.array(FOUR_BEAMS)
        case LidarSensorSpec():
            directions = _lidar_directions(spec.lidar)
        case _:
            raise TypeError(f"{spec.name}: expected the block of a range finder or a lidar, was {type(spec).__name__}")
    return elementary.product(directions, rotation_from_rpy(spec.mount_rpy_rad).T)


def _lidar_directions(lidar: AzimuthsSpec) -> NDArray[np.float64]:
    n_elevations, span_rad = (
        (lidar.n_elevations, lidar.elevation_span_rad) if isinstance(lidar, ElevationsSpec) else (1, 0.0)
    )
    azimuth = _spread_evenly(lidar.n_azimuths, lidar.azimuth_span_rad)[None, :]
    elevation = _spread_evenly(n_elevations, span_rad)[:, None]
    level = elementary.cos_each(elevation)
    up = np.broadcast_to(elementary.sin_each(elevation), (n_elevations, lidar.n_azimuths))
    return np.stack([level * elementary.cos_each(azimuth), level * elementary.sin_each(azimuth), up], axis=-1)


# Angles over a span around 0; a full turn has no end of its own.
def _spread_evenly(n: int, span_rad: float) -> NDArray[np.float64]:
    if n == 1:
        return np.zeros(1)
    is_turn = math.isclose(span_rad, 2 * math.pi)
    return np.linspace(-span_rad / 2, span_rad / 2, n, endpoint=not is_turn)


def _build(spec: RaySensorSpec, tick_s: float, rng: np.random.Generator) -> RangeSensor:
    del tick_s
    return RangeSensor(spec, rng)


RANGE_KINDS = tuple(
    make_kind(SensorKind, name, "range", "m", description, build=_build, has_own_noise=True, least_value=0.0)
    for name, description in (
        ("range_finder", "Range finder: values = (range_m,) along `beam_body`."),
        ("four_range_finders", "Four range finders: values = (front, left, back, right) in m."),
        ("lidar_2d", "Lidar of one level: values = (least range,); array = ranges in m, (1, azimuths)."),
        ("lidar_3d", "Lidar of several levels: values = (least range,); array = ranges in m, (elevations, azimuths)."),
    )
)
