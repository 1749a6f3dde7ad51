"""Encoding for policies: observations as vectors of numbers, and their actions as commands."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, MutableSequence, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim.agent_kit import Briefing, Command, DriveSetpoint, Observation, Reading
from gslcosim.base.errors import UsageError
from gslcosim.base.scalar_kernels import scalar_kernel
from gslcosim.contract.messages import SensorDescription
from gslcosim_search import elementary
from gslcosim_search.learned.wind_frame import WIND_FRAME_NAMES, WindFrame

# Rays of a lidar are reported as the nearest range in so many sectors of the same width.
N_SECTORS = 16

# Scales: what is shown as 1, or as tanh 1.
_SPEED_M_S = 2.0
_FLOOR_PPM = 0.1
_MOST_PPM = 10_000.0
_CLEAN_OHM = 1e4
_RANGE_M = 1.0
_GRAVITY_M_S2 = 9.80665
_SEA_LEVEL_PA = 101_325.0
_PRESSURE_PA = 100.0
_FIELD_UT = 50.0
_HITS = 3.0

_AMOUNT_SCALE = 11.51293546492023  # ln(1 + _MOST_PPM / _FLOOR_PPM)
# How far waypoints keep from the walls of the room.
MARGIN_M = 0.5
N_HEADINGS = 8
# In which frame the numbers of an action are: along world x and y, or upwind and to its left.
WORLD, WIND = "world", "wind"
FRAMES = (WORLD, WIND)
_TURNED_KINDS = ("velocity", "velocity_3d", "waypoint", "waypoint_3d")
_SHIELDED_KINDS = ("velocity", "velocity_3d")


@dataclass(frozen=True)
class Channel:
    """Channel of one kind of reading: the names of its numbers, and the scalar kernel that writes them.

    `encode(values, numbers)` reads the values of a reading and writes the numbers, which are kept between -1 and 1.
    """

    names: tuple[str, ...]
    encode: Callable[[Sequence[float], MutableSequence[float]], None]


@scalar_kernel
def amount(ppm: float) -> float:
    """Return a mixing ratio as a number between -1 and 1: by its logarithm above 0.1 ppm, 1 at 10,000 ppm.

    sign(c) ln(1 + |c| / 0.1 ppm) / ln(1 + 10,000 ppm / 0.1 ppm); noise may make c negative.
    """
    return math.copysign(elementary.log1p(abs(ppm) / _FLOOR_PPM) / _AMOUNT_SCALE, ppm)


@scalar_kernel
def closeness(range_m: float) -> float:
    """Return a range as a number between 0 and 1: 1 at an obstacle, a half 1 m away, 0 where nothing is in sight."""
    return _RANGE_M / (_RANGE_M + max(range_m, 0.0))


@scalar_kernel
def scaled_speed(speed_m_s: float) -> float:
    """Return a speed as a number between -1 and 1: its hyperbolic tangent in units of 2 m/s."""
    return elementary.tanh(speed_m_s / _SPEED_M_S)


@scalar_kernel
def _encode_resistance(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    numbers[0] = elementary.log10(max(values[0], 1.0) / _CLEAN_OHM)


@scalar_kernel
def _encode_amount(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    numbers[0] = amount(values[0])


@scalar_kernel
def _encode_plain(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    numbers[0] = values[0]


@scalar_kernel
def _encode_hits(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    numbers[0] = elementary.tanh(values[0] / _HITS)


@scalar_kernel
def _encode_planar_wind(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    numbers[0] = scaled_speed(values[0])
    numbers[1], numbers[2] = elementary.sin(values[1]), elementary.cos(values[1])


@scalar_kernel
def _encode_wind(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    for axis in range(3):
        numbers[axis] = scaled_speed(values[axis])


@scalar_kernel
def _encode_inertial(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    for axis in range(3):
        numbers[axis] = elementary.tanh(values[axis] / _GRAVITY_M_S2)
        numbers[3 + axis] = elementary.tanh(values[3 + axis])


@scalar_kernel
def _encode_pressure(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    numbers[0] = elementary.tanh((values[0] - _SEA_LEVEL_PA) / _PRESSURE_PA)


@scalar_kernel
def _encode_magnetic_field(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    for axis in range(3):
        numbers[axis] = values[axis] / _FIELD_UT


@scalar_kernel
def encode_ranges(values: Sequence[float], numbers: MutableSequence[float]) -> None:
    """Write the `closeness` of as many ranges [m] as there are numbers."""
    for i in range(len(numbers)):
        numbers[i] = closeness(values[i])


@scalar_kernel
def first_azimuth(i_sector: int, n_azimuths: int, n_sectors: int) -> int:
    """Return where a sector of a lidar begins; sectors are equal, but for the first ones, which share what is left."""
    return i_sector * (n_azimuths // n_sectors) + min(i_sector, n_azimuths % n_sectors)


# By quantity and unit of the sensor's description. Pictures have no numbers, and positions no scale without the room.
CHANNELS: dict[tuple[str, str], Channel] = {
    ("resistance", "ohm"): Channel(("log_resistance",), _encode_resistance),
    ("mixing_ratio", "ppm"): Channel(("amount",), _encode_amount),
    ("estimated_mixing_ratio", "ppm"): Channel(("amount",), _encode_amount),
    ("path_integrated_mixing_ratio", "ppm m"): Channel(("amount",), _encode_amount),
    ("gas_detected", "1"): Channel(("gas",), _encode_plain),
    ("hits", "1"): Channel(("hits",), _encode_hits),
    ("apparent_wind", "m/s, rad"): Channel(("speed", "from_sin", "from_cos"), _encode_planar_wind),
    ("apparent_wind", "m/s"): Channel(("x", "y", "z"), _encode_wind),
    ("specific_force, angular_velocity", "m/s^2, rad/s"): Channel(
        ("fx", "fy", "fz", "wx", "wy", "wz"), _encode_inertial
    ),
    ("pressure", "Pa"): Channel(("pressure",), _encode_pressure),
    ("magnetic_field", "uT"): Channel(("x", "y", "z"), _encode_magnetic_field),
    ("contact", "1"): Channel(("contact",), _encode_plain),
}


class ObservationVector:
    """Turns each observation of an agent into a vector of numbers between -1 and 1.

    First the pose: place in the room, from -1 at one wall to 1 at the other; sine and cosine of the yaw; velocity by
    its hyperbolic tangent; then the share of the time that is over, and whether the last command was refused or
    changed. Then the numbers of each sensor that the briefing describes, in its order. Sensors that are warming up
    show 0. Positions and attitudes that sensors report are the pose already, and cameras are left out: `left_out`.

    Args:
        briefing: Of the agent.
        has_wind_frame: Whether the numbers of the egocentric wind frame follow, see `wind_frame`.

    Raises:
        UsageError: the agent has no gas sensor or no anemometer, of which the wind frame is made.
    """

    def __init__(self, briefing: Briefing, *, has_wind_frame: bool = False) -> None:
        low, high = np.array(briefing.bounds.min_m), np.array(briefing.bounds.max_m)
        self._centre_m, self._half_m = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
        self._time_limit_s = briefing.time_limit_s
        self._sensors: list[tuple[str, Channel | None, int]] = []
        names = ["x", "y", "z", "yaw_sin", "yaw_cos", "vx", "vy", "vz", "time", "refused"]
        left_out: list[str] = []
        for sensor in briefing.sensors:
            channels = _names_of(sensor)
            if channels is None:
                left_out.append(sensor.name)
                continue
            names += [f"{sensor.name}.{name}" for name in channels]
            self._sensors.append((sensor.name, CHANNELS.get((sensor.quantity, sensor.unit)), len(channels)))
        self._frame: WindFrame | None = None
        if has_wind_frame:
            half_x_m, half_y_m, _ = self._half_m.tolist()
            self._frame = WindFrame(names, half_x_m=half_x_m, half_y_m=half_y_m, time_limit_s=self._time_limit_s)
            names += WIND_FRAME_NAMES
        self.names: tuple[str, ...] = tuple(names)
        self.left_out: tuple[str, ...] = tuple(left_out)
        self._ranges: dict[str, list[float]] = {}

    @property
    def size(self) -> int:
        """Number of numbers."""
        return len(self.names)

    @property
    def upwind(self) -> tuple[float, float]:
        """Upwind of the last observation: a unit vector, world frame; along x without a wind frame."""
        return (1.0, 0.0) if self._frame is None else self._frame.upwind

    def of(self, observation: Observation) -> NDArray[np.float32]:
        """Return the vector of an observation, (size,); each once, in order, where there is a wind frame."""
        place = (np.array(observation.position_world_m) - self._centre_m) / self._half_m
        numbers = [
            *place,
            elementary.sin(observation.yaw_rad),
            elementary.cos(observation.yaw_rad),
            *map(scaled_speed, observation.velocity_world_m_s),
            observation.time_s / self._time_limit_s,
            float(observation.notice is not None),
        ]
        readings = {reading.sensor: reading for reading in observation.readings}
        for name, channel, n_numbers in self._sensors:
            reading = readings[name]
            if reading.is_warming_up:
                numbers += [0.0] * n_numbers
            elif channel is None:
                numbers += self._sectors(reading, n_numbers)
            else:
                encoded = [0.0] * n_numbers
                channel.encode(reading.values, encoded)
                numbers += encoded
        vector = np.zeros(self.size, np.float32)
        vector[: len(numbers)] = np.clip(np.array(numbers, dtype=np.float32), -1.0, 1.0)
        if self._frame is not None:
            self._frame.advance(vector)
        return vector

    # A lidar's ranges come when they are new; until the next they stand.
    def _sectors(self, reading: Reading, n_numbers: int) -> list[float]:
        if reading.array is None and reading.values and n_numbers == len(reading.values):
            return [closeness(range_m) for range_m in reading.values]
        if reading.array is not None:
            by_azimuth = np.min(reading.array.to_array(), axis=0)
            starts = [first_azimuth(i, len(by_azimuth), n_numbers) for i in range(n_numbers)]
            nearest_m = np.minimum.reduceat(by_azimuth, starts)
            self._ranges[reading.sensor] = [closeness(range_m) for range_m in nearest_m.tolist()]
        return self._ranges.get(reading.sensor, [0.0] * n_numbers)


def _names_of(sensor: SensorDescription) -> tuple[str, ...] | None:
    if sensor.quantity == "range":
        return tuple(f"closeness_{i}" for i in range(_n_ranges(sensor)))
    channel = CHANNELS.get((sensor.quantity, sensor.unit))
    return channel.names if channel is not None else None


def _n_ranges(sensor: SensorDescription) -> int:
    if sensor.directions_body is None:
        return 1
    shape = sensor.directions_body.shape
    return min(shape[1], N_SECTORS) if len(shape) == 3 else shape[0]


class ActionKind(ABC):
    """Kind of actions, and how they become commands.

    `n_numbers` numbers between -1 and 1 make an action, or, where `n_choices` is not 0, one whole number below that.

    Args:
        briefing: Of the agent.
        step_m: The longest leg of waypoints [m].
        speed_m_s: The highest speed of velocities and drives [m/s].
        hold_s: How long a waypoint is held and a velocity kept before the agent is asked again [s]; absent: the
            briefing's.
    """

    n_numbers = 0
    n_choices = 0

    def __init__(self, briefing: Briefing, *, step_m: float, speed_m_s: float, hold_s: float | None) -> None:
        self.step_m, self.speed_m_s, self.hold_s = step_m, speed_m_s, hold_s
        self._low_m = np.array(briefing.bounds.min_m) + MARGIN_M
        self._high_m = np.maximum(np.array(briefing.bounds.max_m) - MARGIN_M, self._low_m)
        self._height_m = briefing.search_height_m

    @abstractmethod
    def command(self, observation: Observation, action: Any) -> Command:
        """Return the command of an action, in answer to an observation."""

    def _leg(self, observation: Observation, offset_m: np.ndarray) -> Command:
        x_m, y_m, z_m = observation.position_world_m
        from_m = np.array([x_m, y_m, self._height_m if len(offset_m) == 2 else z_m])
        from_m[: len(offset_m)] += offset_m
        end_m = np.clip(from_m, self._low_m, self._high_m)
        if len(offset_m) == 2:
            end_m[2] = self._height_m
        x_m, y_m, z_m = (float(part) for part in end_m)
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(x_m, y_m, z_m), hold_s=self.hold_s)


class Waypoints(ActionKind):
    """The next waypoint, as an offset in the plane in units of `step_m`; the height is the briefing's."""

    n_numbers = 2

    @override
    def command(self, observation: Observation, action: Any) -> Command:
        return self._leg(observation, self.step_m * np.asarray(action, dtype=np.float64))


class SpaceWaypoints(Waypoints):
    """The next waypoint, as an offset in space in units of `step_m`."""

    n_numbers = 3


class Headings(ActionKind):
    """One of eight directions, counter-clockwise from world x, for a leg of `step_m`; the ninth choice is to hold."""

    n_choices = N_HEADINGS + 1

    @override
    def command(self, observation: Observation, action: Any) -> Command:
        choice = int(action)
        if choice == N_HEADINGS:
            return Command(tick=observation.tick, kind="hold", hold_s=self.hold_s)
        heading_rad = 2 * math.pi * choice / N_HEADINGS
        return self._leg(
            observation, self.step_m * np.array([elementary.cos(heading_rad), elementary.sin(heading_rad)])
        )


class Velocities(ActionKind):
    """A velocity in the plane in units of `speed_m_s`."""

    n_numbers = 2

    @override
    def command(self, observation: Observation, action: Any) -> Command:
        velocity = self.speed_m_s * np.asarray(action, dtype=np.float64)
        x_m_s, y_m_s, z_m_s = (float(part) for part in np.resize(np.append(velocity, 0.0), 3))
        return Command(
            tick=observation.tick, kind="velocity", velocity_world_m_s=(x_m_s, y_m_s, z_m_s), hold_s=self.hold_s
        )


class SpaceVelocities(Velocities):
    """A velocity in space in units of `speed_m_s`."""

    n_numbers = 3


class Drives(ActionKind):
    """Speed along the nose in units of `speed_m_s`, and rate of turn in radians per second, for a vehicle on wheels."""

    n_numbers = 2

    @override
    def command(self, observation: Observation, action: Any) -> Command:
        speed, yaw_rate = (float(part) for part in action)
        drive = DriveSetpoint(speed_m_s=self.speed_m_s * speed, yaw_rate_rad_s=yaw_rate)
        return Command(tick=observation.tick, kind="drive", drive=drive, hold_s=self.hold_s)


ACTIONS: dict[str, Callable[..., ActionKind]] = {
    "waypoint": Waypoints,
    "waypoint_3d": SpaceWaypoints,
    "heading": Headings,
    "velocity": Velocities,
    "velocity_3d": SpaceVelocities,
    "drive": Drives,
}


def find_frame_problem(kind: str, frame: object) -> str | None:
    """Return what is wrong with the frame of a kind of actions, as a sentence without its place; nothing if it fits."""
    if frame not in FRAMES:
        return f"expected one of {', '.join(FRAMES)}, was {frame!r}."
    if frame == WIND and kind not in _TURNED_KINDS:
        return f"expected {WORLD} for {kind}, was {frame}. Take {', '.join(_TURNED_KINDS)}, or leave it out."
    return None


def find_shield_problem(kind: str, shield_m: object) -> str | None:
    """Return what is wrong with the shield of a kind of actions; see `find_frame_problem`."""
    if shield_m is None:
        return None
    if isinstance(shield_m, bool) or not isinstance(shield_m, int | float) or not 0 <= shield_m < math.inf:
        return f"expected a distance from 0, was {shield_m!r}."
    if kind not in _SHIELDED_KINDS:
        return f"expected none for {kind}, was {shield_m}. Take {' or '.join(_SHIELDED_KINDS)}, or leave it out."
    return None


def turn_actions(actions: Any, upwind: Any) -> NDArray[np.float64]:
    """Return actions with their first two numbers turned from the wind frame into the world frame.

    Args:
        actions: (n, k) numbers; the first is upwind, the second to its left.
        upwind: (n, 2) unit vectors, world frame.
    """
    turned, (x, y) = np.array(actions, np.float64), np.asarray(upwind, np.float64).T
    a, b = turned[:, 0].copy(), turned[:, 1].copy()
    turned[:, 0], turned[:, 1] = a * x - b * y, a * y + b * x
    return turned


def action_kind(
    name: str, briefing: Briefing, *, step_m: float = 1.0, speed_m_s: float = 1.0, hold_s: float | None = None
) -> ActionKind:
    """Return a kind of actions by its name, for the agent of a briefing; see `ActionKind`.

    Raises:
        UsageError: there is no such kind.
    """
    if name not in ACTIONS:
        raise UsageError(f"action: expected one of {', '.join(ACTIONS)}, was {name!r}.")
    return ACTIONS[name](briefing, step_m=step_m, speed_m_s=speed_m_s, hold_s=hold_s)
