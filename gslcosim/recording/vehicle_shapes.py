"""How each vehicle looks: bodies around the origin of its body frame, x forward, y left, z up.

Sizes and places are those of the catalogue; white shows where a vehicle looks. Small vehicles are drawn larger than
they are: in a room of fifteen metres they would be lost in the picture.
"""

import math
from dataclasses import dataclass

import rerun as rr

from gslcosim.recording.colors import Rgb
from gslcosim.recording.run_file import RunFile
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.vehicles import Vehicle
from gslcosim.vehicles.facts import RotorDrawing, RotorParameters, WheelDrawing, WheelParameters

SOLID = rr.components.FillMode.Solid
WHITE: Rgb = (255, 255, 255)
BLACK: Rgb = (35, 35, 38)


@dataclass(frozen=True, kw_only=True)
class Multirotor:
    """A hull with arms and rotors."""

    rotors: RotorParameters
    drawing: RotorDrawing

    def draw(self, file: RunFile, entity: str, color: Rgb) -> None:
        """Draw arms from the hull to discs, the front ones white, and the hull."""
        scale = self.drawing.scale
        centres_m = [(scale * x, scale * y, scale * z) for x, y, z in self.rotors.rotor_places_m]
        radius_m = scale * self.rotors.rotor_radius_m
        arms = [[(0.0, 0.0, 0.0), centre] for centre in centres_m]
        file.draw(f"{entity}/arms", rr.LineStrips3D(arms, radii=[0.12 * radius_m], colors=[color]))
        rotors = rr.Ellipsoids3D(
            centers=centres_m,
            half_sizes=[(radius_m, radius_m, 0.08 * radius_m)] * len(centres_m),
            colors=[WHITE if x > 0 else color for x, _, _ in centres_m],
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/rotors", rotors)
        hull_m = tuple(scale * size for size in self.drawing.hull_half_m)
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

    wheels: WheelParameters
    drawing: WheelDrawing

    def draw(self, file: RunFile, entity: str, color: Rgb) -> None:
        """Draw chassis, plate and a white front, then wheels and caster."""
        drawing, wheels = self.drawing, self.wheels
        centre_m, half_m = drawing.chassis_centre_m, drawing.chassis_half_m
        front_m = (centre_m[0] + half_m[0], 0.0, centre_m[2])
        hull = rr.Boxes3D(
            centers=[centre_m, drawing.plate_centre_m, front_m],
            half_sizes=[half_m, drawing.plate_half_m, (0.012, 0.8 * half_m[1], 0.5 * half_m[2])],
            colors=[color, BLACK, WHITE],
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/hull", hull)
        cylinders = rr.Cylinders3D(
            lengths=[drawing.wheel_width_m] * 2,
            radii=[wheels.wheel_radius_m] * 2,
            centers=[(0.0, side * wheels.half_track_m, wheels.axle_height_m) for side in (1, -1)],
            rotation_axis_angles=[rr.RotationAxisAngle(axis=(1.0, 0.0, 0.0), radians=math.pi / 2)] * 2,
            colors=[BLACK] * 2,
            fill_mode=SOLID,
        )
        file.draw(f"{entity}/wheels", cylinders)
        caster = rr.Ellipsoids3D(
            centers=[wheels.caster_place_m], half_sizes=[[wheels.caster_radius_m] * 3], colors=[BLACK], fill_mode=SOLID
        )
        file.draw(f"{entity}/caster", caster)


def shape_of(vehicle: Vehicle) -> Multirotor | Ball | Rover:
    """Return how a vehicle looks."""
    drawing, rotors, wheels = vehicle.drawing, vehicle.rotors, vehicle.wheels
    if rotors is not None and isinstance(drawing, RotorDrawing):
        return Multirotor(rotors=rotors, drawing=drawing)
    if wheels is not None and isinstance(drawing, WheelDrawing):
        return Rover(wheels=wheels, drawing=drawing)
    return Ball(radius_m=vehicle.body.radius_m)


def draw_vehicle(file: RunFile, entity: str, agent: AgentSpec, color: Rgb, *, is_named: bool = True) -> None:
    """Draw a vehicle in the colour of its agent, with the agent's name, or that where one points at it."""
    shape_of(agent.vehicle.facts).draw(file, entity, color)
    file.draw(
        f"{entity}/name",
        rr.Points3D([(0.0, 0.0, 0.0)], radii=[0.02], colors=[color], labels=[agent.name], show_labels=is_named),
    )
