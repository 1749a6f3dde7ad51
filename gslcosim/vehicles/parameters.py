"""Parameters of a vehicle, as they stand in the `parameters.yaml` of its folder; none of them needs MuJoCo."""

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3

Kind = Literal["multirotor", "holonomic", "wheels"]
# Four is the least that can push and turn about all axes; the compiled loop has room for sixteen.
MIN_ROTORS, MAX_ROTORS = 4, 16
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, kw_only=True)
class BodyParameters:
    """Mass of a vehicle, its reach from its centre, and how fast it turns.

    `radius_m` is its reach seen from above, `half_height_m` that of its lowest point below its centre.
    """

    mass_kg: float
    radius_m: float
    half_height_m: float
    max_yaw_rate_rad_s: float


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """Gains of a vehicle in the air.

    Gains are per unit of mass and inertia: position [1/s^2], velocity [1/s], integral [1/s^3], attitude [1/s^2] and
    rate [1/s] about the body axes.
    """

    position_gain_s2: float
    velocity_gain_s: float
    integral_gain_s3: float
    integral_limit_m_s2: float
    max_tilt_rad: float
    attitude_gain_s2: Vec3
    rate_gain_s: Vec3


@dataclass(frozen=True, kw_only=True)
class RotorParameters:
    """Rotors and drag of a vehicle.

    `rotor_places_m` are the centres of the n rotors, body frame [m]; each pushes along body z.
    `rotor_directions` says for each how it turns seen from above: 1 counter-clockwise, -1 clockwise.
    """

    rotor_places_m: tuple[Vec3, ...]
    rotor_radius_m: float
    rotor_directions: tuple[float, ...]
    thrust_coefficient_n_s2: float
    torque_per_thrust_m: float
    max_rotor_speed_rad_s: float
    time_constant_up_s: float
    time_constant_down_s: float
    rotor_drag_n_s2_m: Vec3
    drag_area_m2: Vec3
    air_density_kg_m3: float

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return len(self.rotor_places_m)

    @property
    def motor_distance_m(self) -> float:
        """The longest distance between two rotors: that along the diagonal, seen from above [m]."""
        return max(math.dist(a[:2], b[:2]) for a, b in combinations(self.rotor_places_m, 2))

    @property
    def reach_m(self) -> float:
        """Reach of the discs of the rotors from the vehicle's centre, seen from above [m]."""
        return max(math.hypot(x_m, y_m) for x_m, y_m, _ in self.rotor_places_m) + self.rotor_radius_m

    def wrench_from_thrusts(self) -> NDArray[np.float64]:
        """Return the allocation matrix, (4, n): rows thrust and torque about x, y, z; a column for each rotor.

        A rotor at (x, y) with direction s gives (1, y, -x, -s k) for each newton of thrust.
        [1], [m] = [N], [N m] for each [N]

        Source:
            Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, equation 2, for rotors anywhere in the plane.
        Held by:
            tests/unit/services/world/physics/test_rotors.py, tests/unit/vehicles/test_parameters.py
        """
        columns = [
            [1.0, y_m, -x_m, -direction * self.torque_per_thrust_m]
            for (x_m, y_m, _), direction in zip(self.rotor_places_m, self.rotor_directions, strict=True)
        ]
        return np.array(columns).T


@dataclass(frozen=True, kw_only=True)
class WheelParameters:
    """Drive of a vehicle on two wheels and a caster behind them; places in the body frame [m]."""

    wheel_radius_m: float
    half_track_m: float
    axle_height_m: float
    caster_place_m: Vec3
    caster_radius_m: float
    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_wheel_torque_n_m: float
    wheel_gain_n_m_s: float
    wheel_integral_gain_n_m: float
    along_gain_s: float
    across_gain_m2: float
    heading_gain_s: float


@dataclass(frozen=True, kw_only=True)
class RotorDrawing:
    """Drawing of a vehicle with rotors in recordings: half sizes of its hull [m], and its enlargement."""

    hull_half_m: Vec3
    scale: float


@dataclass(frozen=True, kw_only=True)
class WheelDrawing:
    """Drawing of a vehicle on wheels: width of the wheels, and centres and half sizes of two boxes, body frame [m]."""

    wheel_width_m: float
    chassis_centre_m: Vec3
    chassis_half_m: Vec3
    plate_centre_m: Vec3
    plate_half_m: Vec3


Drawing = RotorDrawing | WheelDrawing


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle as it stands in its folder; meaning and origin of each number are in the folder's `parameters.yaml`.

    A `multirotor` has `rotors`, and `control` says how it is held in the air. A `holonomic` one has `control` alone: it
    is moved by any force and does not feel the air. One on `wheels` drives. `drawing` is absent for a ball.
    """

    name: str
    description: str
    kind: Kind
    folder: Path
    body: BodyParameters
    control: ControlParameters | None
    rotors: RotorParameters | None
    wheels: WheelParameters | None
    drawing: Drawing | None

    @property
    def mjcf_path(self) -> Path:
        """The file of its one body in MuJoCo's format."""
        return self.folder / f"{self.name}.xml"

    @property
    def drives(self) -> bool:
        """True where the vehicle stays on the ground."""
        return self.kind == "wheels"

    @property
    def drawn_scale(self) -> float:
        """Enlargement of its drawing in recordings."""
        return self.drawing.scale if isinstance(self.drawing, RotorDrawing) else 1.0
