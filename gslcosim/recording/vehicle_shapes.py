"""How each vehicle looks: bodies around the origin of its body frame, x forward, y left, z up.

Sizes and places are those of gslcosim/world/vehicles, which tests hold equal; white shows where a vehicle looks. Small
vehicles are drawn larger than they are: in a room of fifteen metres they would be lost in the picture.
"""

import math
from dataclasses import dataclass

import rerun as rr

from gslcosim.contract.messages import Vec3
from gslcosim.recording.colors import Rgb
from gslcosim.recording.run_file import RunFile
from gslcosim.scenario.models.scenario import AgentSpec

SOLID = rr.components.FillMode.Solid
WHITE: Rgb = (255, 255, 255)
BLACK: Rgb = (35, 35, 38)


@dataclass(frozen=True, kw_only=True)
class Multirotor:
    """Rotor centres and radius, half sizes of the hull [m], and how much larger it is drawn."""

    rotors_m: tuple[Vec3, Vec3, Vec3, Vec3]
    rotor_radius_m: float
    hull_m: Vec3
    scale: float

    def draw(self, file: RunFile, entity: str, color: Rgb) -> None:
        """Draw arms from the hull to discs, the front pair white, and the hull."""
        centres_m = [(self.scale * x, self.scale * y, self.scale * z) for x, y, z in self.rotors_m]
        radius_m = self.scale * self.rotor_radius_m
        arms = [[(0.0, 0.0, 0.0), centre] for centre in centres_m]
        file.draw(f"{entity}/arms", rr.LineStrips3D(arms, radii=[0.12 * radius_m], colors=[color]))
        rotors = rr.Ellipsoids3D(
            centers=centres_m,
            half_sizes=[(radius_m, radius_m, 0.08 * radius_m)] * 4,
            colors=[WHITE if x > 0 else color for x, _, _ in centres_m],
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/rotors", rotors)
        hull_m = tuple(self.scale * size for size in self.hull_m)
        file.draw(f"{entity}/hull", rr.Boxes3D(half_sizes=[hull_m], colors=[color], fill_mode=SOLID))


@dataclass(frozen=True, kw_only=True)
class Ball:
    """A ball with a nose."""

    radius_m: float

    def draw(self, file: RunFile, entity: str, color: Rgb) -> None:
        """Draw the ball, and a smaller white one where it looks."""
        hull = rr.Ellipsoids3D(
            centers=[(0.0, 0.0, 0.0), (0.85 * self.radius_m, 0.0, 0.0)],
            half_sizes=[[self.radius_m] * 3, [0.35 * self.radius_m] * 3],
            colors=[color, WHITE],
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/hull", hull)


@dataclass(frozen=True, kw_only=True)
class Rover:
    """Wheels at both ends of the axle and a caster behind it, a chassis, and a plate on top [m]."""

    wheel_radius_m: float
    wheel_width_m: float
    half_track_m: float
    axle_height_m: float
    caster_m: Vec3
    caster_radius_m: float
    chassis_m: tuple[Vec3, Vec3]
    plate_m: tuple[Vec3, Vec3]

    def draw(self, file: RunFile, entity: str, color: Rgb) -> None:
        """Draw chassis, plate and a white front, then wheels and caster."""
        (centre_m, half_m), (plate_centre_m, plate_half_m) = self.chassis_m, self.plate_m
        front_m = (centre_m[0] + half_m[0], 0.0, centre_m[2])
        hull = rr.Boxes3D(
            centers=[centre_m, plate_centre_m, front_m],
            half_sizes=[half_m, plate_half_m, (0.012, 0.8 * half_m[1], 0.5 * half_m[2])],
            colors=[color, BLACK, WHITE],
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/hull", hull)
        wheels = rr.Cylinders3D(
            lengths=[self.wheel_width_m] * 2,
            radii=[self.wheel_radius_m] * 2,
            centers=[(0.0, side * self.half_track_m, self.axle_height_m) for side in (1, -1)],
            rotation_axis_angles=[rr.RotationAxisAngle(axis=(1.0, 0.0, 0.0), radians=math.pi / 2)] * 2,
            colors=[BLACK] * 2,
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/wheels", wheels)
        caster = rr.Ellipsoids3D(
            centers=[self.caster_m], half_sizes=[[self.caster_radius_m] * 3], colors=[BLACK], fill_mode=SOLID
        )
        file.draw(f"{entity}/caster", caster)


SHAPES: dict[str, Multirotor | Ball | Rover] = {
    "iris": Multirotor(
        rotors_m=((0.13, -0.22, 0.023), (-0.13, 0.20, 0.023), (0.13, 0.22, 0.023), (-0.13, -0.20, 0.023)),
        rotor_radius_m=0.128,
        hull_m=(0.09, 0.06, 0.03),
        scale=2.0,
    ),
    "crazyflie": Multirotor(
        rotors_m=(
            (0.0325, -0.0325, 0.01),
            (-0.0325, -0.0325, 0.01),
            (-0.0325, 0.0325, 0.01),
            (0.0325, 0.0325, 0.01),
        ),
        rotor_radius_m=0.0231,
        hull_m=(0.016, 0.013, 0.008),
        scale=5.0,
    ),
    "holonomic": Ball(radius_m=0.15),
    "rover": Rover(
        wheel_radius_m=0.0975,
        wheel_width_m=0.047,
        half_track_m=0.158,
        axle_height_m=-0.021,
        caster_m=(-0.2145, 0.0, -0.081),
        caster_radius_m=0.0375,
        chassis_m=((-0.045, 0.0, 0.02), (0.19, 0.125, 0.07)),
        plate_m=((-0.045, 0.0, 0.1135), (0.2225, 0.19, 0.005)),
    ),
}


def drawn_scale(model: str) -> float:
    """Return how many times its size a vehicle is drawn."""
    shape = SHAPES[model]
    return shape.scale if isinstance(shape, Multirotor) else 1.0


def draw_vehicle(file: RunFile, entity: str, agent: AgentSpec, color: Rgb) -> None:
    """Draw a vehicle in the colour of its agent, with the agent's name."""
    SHAPES[agent.vehicle.model].draw(file, entity, color)
    file.draw(
        f"{entity}/name",
        rr.Points3D([(0.0, 0.0, 0.0)], radii=[0.02], colors=[color], labels=[agent.name], show_labels=True),
    )
