"""Static scene of the recording: room, openings, sources, map and scale, and the shapes of doors and vehicles.

Sizes and places are those of the catalogue; white shows where a vehicle looks. Small vehicles are drawn larger than
they are: in a room of fifteen metres they would be invisible.
"""

import math
import re
from dataclasses import replace
from typing import Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.environment.model import Box, Environment, Opening
from gslcosim.environment.plan_view import PlanOpening, PlanView, is_cut, visible_boxes
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.success import SuccessSpec
from gslcosim.vehicles import Vehicle
from gslcosim.vehicles.catalogue import RotorDrawing, RotorParameters, WheelDrawing, WheelParameters
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.colors import GasScale, Rgb
from gslcosim_services.recorder.recording_file import RecordingFile

# Like the colours of filaments, black where there is no gas.
GAS_COLORMAP = rr.components.Colormap.Inferno
SOLID = rr.components.FillMode.Solid
WIRE = rr.components.FillMode.MajorWireframe
GLASS = rr.components.FillMode.TransparentFillMajorWireframe

MESHES = "room/geometry"
OBSTACLE_ALPHA = 150
EDGE_RADIUS_M = 0.025
# Edges are no thicker than this fraction of a box's middle side: pallets are made of thin boards.
EDGE_RADIUS_FRAC = 0.08
# The shell of a room is nearly transparent, so that its contents are visible; a triangle is part of the shell when it
# lies within so few cells of the same side of the grid, or beyond it.
SHELL_ALPHA = 14
MESH_ALPHA = 190
SHELL_CELLS = 1.0
# Slices are drawn this far below their height: vehicles move in that very layer, and would be half hidden.
SLICE_SINK_M = 0.3
COLUMN_HALF_HEIGHT_M = 4.0
# But not in the floor: rovers drive on it.
MIN_SLICE_HEIGHT_M = 0.02
MAX_FLOOR_LINES = 25
# The colour scale beside the map, in fractions of the room's width.
SCALE_GAP_FRAC = 0.12
SCALE_WIDTH_FRAC = 0.035
SCALE_LABEL_RISE_FRAC = 0.04

WHITE: Rgb = (255, 255, 255)
BLACK: Rgb = (35, 35, 38)


def draw_room(file: RecordingFile, environment: Environment) -> None:
    """Draw floor, outline, obstacles and openings; ceiling and walls stay open to view."""
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    file.draw(
        "room/outline",
        rr.Boxes3D(mins=[low_m], sizes=[high_m - low_m], colors=[colors.EDGES], radii=[0.015], fill_mode=WIRE),
    )
    floor_low_m = (low_m[0], low_m[1], low_m[2] - 0.05)
    floor_size_m = (high_m[0] - low_m[0], high_m[1] - low_m[1], 0.04)
    file.draw(
        "room/floor", rr.Boxes3D(mins=[floor_low_m], sizes=[floor_size_m], colors=[colors.FLOOR], fill_mode=SOLID)
    )
    file.draw("room/floor/grid", _floor_grid(environment))
    obstacles = visible_boxes(environment)
    if environment.meshes:
        _draw_meshes(file, environment)
    elif obstacles:
        file.draw("room/obstacles", _obstacles(obstacles))
    for opening in environment.openings:
        file.draw(f"room/openings/{opening.name}", _draw_opening(opening))


def draw_sources(file: RecordingFile, scenario: Scenario) -> None:
    """Draw every source with the region of the success criterion around it."""
    half_size_m = _half_size_around_sources_m(scenario.referee.success)
    for i, source in enumerate(scenario.gas.sources):
        label = "source" if len(scenario.gas.sources) == 1 else f"source {i + 1}"
        entity = f"sources/{i}"
        file.draw(
            f"{entity}/place",
            rr.Points3D([source.position_m], radii=[0.14], colors=[colors.SOURCE], labels=[label], show_labels=True),
        )
        if half_size_m:
            radius = rr.Ellipsoids3D(
                centers=[source.position_m],
                half_sizes=[half_size_m],
                colors=[colors.SOURCE],
                line_radii=[0.006],
                fill_mode=WIRE,
            )
            file.draw(f"{entity}/success_radius", radius)


# A column, for a criterion that ignores heights.
def _half_size_around_sources_m(success: SuccessSpec) -> tuple[float, float, float] | None:
    radius_m = success.drawn_radius_m
    if radius_m is None:
        return None
    return (radius_m, radius_m, COLUMN_HALF_HEIGHT_M if success.is_horizontal else radius_m)


def slice_height_m(height_m: float) -> float:
    """Return the drawn height of a map's layer at a height [m]."""
    return max(height_m - SLICE_SINK_M, MIN_SLICE_HEIGHT_M)


def draw_map(file: RecordingFile, environment: Environment, scale: GasScale, height_m: float) -> None:
    """Draw the map's own parts, flat, at its slice: outline, obstacles and openings, and the colour scale."""
    drawn_m = slice_height_m(height_m)
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    depth_m = float(high_m[1] - low_m[1])
    x0, y0, x1, y1 = float(low_m[0]), float(low_m[1]), float(high_m[0]), float(high_m[1])
    outline_m = [(x, y, drawn_m) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))]
    line_m = _map_line_m(environment)
    file.draw("map/outline", rr.LineStrips3D([outline_m], colors=[colors.EDGES], radii=[line_m]))
    boxes = visible_boxes(environment)
    cut = [box for box in boxes if is_cut(box, height_m)]
    below = [box for box in boxes if box.max_m[2] <= height_m]
    if cut:
        file.draw("map/obstacles", _flat(cut, drawn_m + line_m, colors.MAP_OBSTACLES, SOLID, 0.5 * line_m))
    if below:
        file.draw("map/below", _flat(below, drawn_m + line_m, colors.MAP_OBSTACLES, WIRE, 0.5 * line_m))
    for seen in PlanView.of(environment, height_m).openings:
        file.draw(f"map/openings/{seen.opening.name}", _flat_opening(seen, drawn_m, 2 * line_m))

    right_m = x0 - SCALE_GAP_FRAC * (x1 - x0)
    width_m = SCALE_WIDTH_FRAC * (x1 - x0)
    cell_m = depth_m / colors.N_LEVELS
    n_columns = max(1, round(width_m / cell_m))
    picture = np.repeat(np.arange(colors.N_LEVELS, dtype=np.uint8)[::-1], n_columns)
    bar = rr.GridMap(
        data=picture.tobytes(),
        format=image_format(n_columns, colors.N_LEVELS),
        colormap=GAS_COLORMAP,
        cell_size=cell_m,
        translation=(right_m - width_m, y0, drawn_m),
    )
    steps = range(colors.DECADES + 1)
    labels = [f"{scale.min_ppm * 10**i:g}" for i in steps]
    labels[-1] += " ppm"
    # Labels hang below their places.
    places_m = [
        (right_m - 3.2 * width_m, y0 + depth_m * (i / colors.DECADES + SCALE_LABEL_RISE_FRAC), drawn_m) for i in steps
    ]
    file.draw("map/scale", bar)
    file.draw(
        "map/scale/labels",
        rr.Points3D(places_m, radii=[0.001], colors=[colors.READING], labels=labels, show_labels=True),
    )


def image_format(width: int, height: int, *, color_model: Literal["L", "RGBA"] = "L") -> rr.components.ImageFormat:
    """Return the format of a picture of this many cells: levels of gas, which `GAS_COLORMAP` colours, or RGBA."""
    return rr.components.ImageFormat(width=width, height=height, color_model=color_model, channel_datatype="U8")


def floor_grid_m(environment: Environment) -> float:
    """Return the spacing of the lines on the floor [m]: 1, 2, 5, 10, … so that at most 25 lie along a side."""
    side_m = max(environment.grid.max_m[i] - environment.grid.origin_m[i] for i in range(2))
    steps = (factor * 10.0**power for power in range(7) for factor in (1.0, 2.0, 5.0))
    return next(step for step in steps if side_m / step <= MAX_FLOOR_LINES)


def _floor_grid(environment: Environment) -> rr.LineStrips3D:
    (x0, y0, z), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
    step_m = floor_grid_m(environment)
    xs_m, ys_m = (np.arange(math.ceil(low / step_m), high / step_m) * step_m for low, high in ((x0, x1), (y0, y1)))
    lines_m = [[(x, y0, z), (x, y1, z)] for x in xs_m] + [[(x0, y, z), (x1, y, z)] for y in ys_m]
    return rr.LineStrips3D(lines_m, colors=[colors.FLOOR_LINES], radii=[0.006 * step_m])


def entity_name(name: str) -> str:
    """Return any name as a valid part of an entity's path."""
    return re.sub(r"[^A-Za-z0-9_]+", "_", name) or "part"


def _draw_meshes(file: RecordingFile, environment: Environment) -> None:
    for i, mesh in enumerate(environment.meshes):
        is_shell = _encloses(mesh.vertices_m[mesh.faces], environment)
        for part, faces, alpha in (
            ("shell", mesh.faces[is_shell], SHELL_ALPHA),
            ("inside", mesh.faces[~is_shell], MESH_ALPHA),
        ):
            if len(faces):
                rgba = [*(round(255 * channel) for channel in mesh.rgba[:3]), alpha]
                drawn = rr.Mesh3D(vertex_positions=mesh.vertices_m, triangle_indices=faces, albedo_factor=rgba)
                file.draw(f"{MESHES}/{part}/{i}_{entity_name(mesh.name)}", drawn)


def _encloses(corners_m: NDArray[np.float32], environment: Environment) -> NDArray[np.bool_]:
    """Return which of (n, 3, 3) triangles lie at one of the grid's sides, or beyond it."""
    margin_m = SHELL_CELLS * environment.grid.cell_m
    low_m, high_m = np.array(environment.grid.origin_m) + margin_m, np.array(environment.grid.max_m) - margin_m
    return np.any(np.all(corners_m <= low_m, axis=1) | np.all(corners_m >= high_m, axis=1), axis=1)


def flat_box(environment: Environment, box: Box, height_m: float) -> Box:
    """Return a box as the map of a height [m] shows it: flat, a little above the slice."""
    drawn_m = slice_height_m(height_m) + _map_line_m(environment)
    (x0, y0, _), (x1, y1, _) = box.min_m, box.max_m
    return replace(box, min_m=(x0, y0, drawn_m), max_m=(x1, y1, drawn_m))


def door_look(box: Box) -> rr.Boxes3D:
    """Return the look of a door, without its place."""
    is_flat = box.min_m[2] == box.max_m[2]
    rgb = [round(255 * channel) for channel in box.rgba[:3]]
    return rr.Boxes3D.from_fields(
        colors=[rgb if is_flat else (*rgb, OBSTACLE_ALPHA)],
        radii=[0.2 * EDGE_RADIUS_M if is_flat else EDGE_RADIUS_M],
        fill_mode=SOLID if is_flat else GLASS,
        labels=[box.name],
        show_labels=False,
    )


def _map_line_m(environment: Environment) -> float:
    (x0, y0, _), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
    return 0.002 * max(x1 - x0, y1 - y0)


def _obstacles(boxes: list[Box]) -> rr.Boxes3D:
    sizes_m = _sizes_m(boxes)
    return rr.Boxes3D(
        mins=[box.min_m for box in boxes],
        sizes=sizes_m,
        colors=[(*(round(255 * channel) for channel in box.rgba[:3]), OBSTACLE_ALPHA) for box in boxes],
        radii=np.minimum(EDGE_RADIUS_M, EDGE_RADIUS_FRAC * np.median(sizes_m, axis=1)),
        fill_mode=GLASS,
        labels=[box.name for box in boxes],
        show_labels=False,
    )


# In one colour, as the obstacles' own could be confused with gas.
def _flat(
    boxes: list[Box], height_m: float, color: colors.Rgb, fill: rr.components.FillMode, radius_m: float
) -> rr.Boxes3D:
    return rr.Boxes3D(
        mins=[(box.min_m[0], box.min_m[1], height_m) for box in boxes],
        sizes=[(x, y, 0.0) for x, y, _ in _sizes_m(boxes)],
        colors=[color],
        radii=[radius_m],
        fill_mode=fill,
        labels=[box.name for box in boxes],
        show_labels=False,
    )


def _sizes_m(boxes: list[Box]) -> NDArray[np.float64]:
    return np.array([box.max_m for box in boxes]) - np.array([box.min_m for box in boxes])


def _opening_look(opening: Opening) -> tuple[colors.Rgb, str]:
    if opening.kind != "inlet":
        return colors.OUTLET, opening.kind
    return colors.INLET, f"inlet {math.hypot(*opening.velocity_m_s):.2g} m/s"


# A line along a side of the room; a rectangle where it lies in floor or ceiling.
def _flat_opening(seen: PlanOpening, height_m: float, radius_m: float) -> rr.LineStrips3D:
    color, label = _opening_look(seen.opening)
    # Short, as it lies over the room's side: its colour shows its kind.
    label = label.removeprefix("inlet ") if seen.is_inlet else ""
    (x0, y0), (x1, y1) = seen.corners_m
    around_m = [(x, y, height_m) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))]
    return rr.LineStrips3D([around_m], colors=[color], radii=[radius_m], labels=[label], show_labels=bool(label))


def _draw_opening(opening: Opening) -> rr.Boxes3D:
    color, label = _opening_look(opening)
    size_m = np.maximum(np.array(opening.max_m) - np.array(opening.min_m), 0.02)
    return rr.Boxes3D(
        mins=[opening.min_m],
        sizes=[size_m],
        colors=[(*color, 140)],
        radii=[0.03],
        fill_mode=GLASS,
        labels=[label],
        show_labels=True,
    )


def draw_shape(file: RecordingFile, entity: str, vehicle: Vehicle, color: Rgb) -> None:
    """Draw the shape of a vehicle: a hull with rotors or wheels, or a ball."""
    drawing, rotors, wheels = vehicle.drawing, vehicle.rotors, vehicle.wheels
    if rotors is not None and isinstance(drawing, RotorDrawing):
        _draw_multirotor(file, entity, color, rotors, drawing)
    elif wheels is not None and isinstance(drawing, WheelDrawing):
        _draw_rover(file, entity, color, wheels, drawing)
    else:
        _draw_ball(file, entity, color, vehicle.body.radius_m)


# Arms from the hull to discs, the front ones white, and the hull.
def _draw_multirotor(
    file: RecordingFile, entity: str, color: Rgb, rotors: RotorParameters, drawing: RotorDrawing
) -> None:
    scale = drawing.scale
    centres_m = [(scale * x, scale * y, scale * z) for x, y, z in rotors.rotor_places_m]
    radius_m = scale * rotors.rotor_radius_m
    arms = [[(0.0, 0.0, 0.0), centre] for centre in centres_m]
    file.draw(f"{entity}/arms", rr.LineStrips3D(arms, radii=[0.12 * radius_m], colors=[color]))
    discs = rr.Ellipsoids3D(
        centers=centres_m,
        half_sizes=[(radius_m, radius_m, 0.08 * radius_m)] * len(centres_m),
        colors=[WHITE if x > 0 else color for x, _, _ in centres_m],
        fill_mode=SOLID,
    )
    file.draw(f"{entity}/rotors", discs)
    hull_m = tuple(scale * size for size in drawing.hull_half_m)
    file.draw(f"{entity}/hull", rr.Boxes3D(half_sizes=[hull_m], colors=[color], fill_mode=SOLID))


# A ball, and a smaller white one at its front.
def _draw_ball(file: RecordingFile, entity: str, color: Rgb, radius_m: float) -> None:
    hull = rr.Ellipsoids3D(
        centers=[(0.0, 0.0, 0.0), (0.85 * radius_m, 0.0, 0.0)],
        half_sizes=[[radius_m] * 3, [0.35 * radius_m] * 3],
        colors=[color, WHITE],
        fill_mode=SOLID,
    )
    file.draw(f"{entity}/hull", hull)


# Chassis, plate and a white front, then wheels at both ends of the axle and the caster behind it.
def _draw_rover(file: RecordingFile, entity: str, color: Rgb, wheels: WheelParameters, drawing: WheelDrawing) -> None:
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
    radii_m = [[wheels.caster_radius_m] * 3]
    caster = rr.Ellipsoids3D(centers=[wheels.caster_place_m], half_sizes=radii_m, colors=[BLACK], fill_mode=SOLID)
    file.draw(f"{entity}/caster", caster)


def draw_vehicle(file: RecordingFile, entity: str, agent: AgentSpec, color: Rgb, *, is_named: bool = True) -> None:
    """Draw a vehicle in the colour of its agent, with the agent's name; unless `is_named` only under the pointer."""
    draw_shape(file, entity, agent.vehicle.facts, color)
    file.draw(
        f"{entity}/name",
        rr.Points3D([(0.0, 0.0, 0.0)], radii=[0.02], colors=[color], labels=[agent.name], show_labels=is_named),
    )
