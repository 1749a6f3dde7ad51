"""What stands still in the recording: room, openings, source, wind and scale."""

import math
import re

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.environment.model import Box, Environment, Opening, VisualMesh
from gslcosim.recording import colors
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import MESHES
from gslcosim.recording.run_file import RunFile
from gslcosim.scenario import Scenario

SOLID = rr.components.FillMode.Solid
WIRE = rr.components.FillMode.MajorWireframe
GLASS = rr.components.FillMode.TransparentFillMajorWireframe

OBSTACLE_ALPHA = 150
MESH_ALPHA = 90
MAX_FLOOR_LINES = 25
# The colour scale beside the map, in fractions of the room's width.
SCALE_GAP_FRAC = 0.12
SCALE_WIDTH_FRAC = 0.035


def draw_room(file: RunFile, environment: Environment) -> None:
    """Draw floor, outline, obstacles and openings; ceiling and walls stay open so that one can look in."""
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
    obstacles = _seen_boxes(environment)
    if environment.meshes:
        for i, mesh in enumerate(environment.meshes):
            file.draw(f"{MESHES}/{i}_{entity_name(mesh.name)}", _mesh(mesh))
    elif obstacles:
        file.draw("room/obstacles", _obstacles(obstacles))
    for opening in environment.openings:
        file.draw(f"room/openings/{opening.name}", _opening(opening))


def draw_sources(file: RunFile, scenario: Scenario) -> None:
    """Draw every source with its success radius."""
    within_m = scenario.referee.success.within_m
    for i, source in enumerate(scenario.gas.sources):
        label = "source" if len(scenario.gas.sources) == 1 else f"source {i + 1}"
        entity = f"sources/{i}"
        file.draw(
            f"{entity}/place",
            rr.Points3D([source.position_m], radii=[0.14], colors=[colors.SOURCE], labels=[label], show_labels=True),
        )
        radius = rr.Ellipsoids3D(
            centers=[source.position_m],
            half_sizes=[[within_m] * 3],
            colors=[colors.SOURCE],
            line_radii=[0.006],
            fill_mode=WIRE,
        )
        file.draw(f"{entity}/success_radius", radius)


def draw_map(file: RunFile, environment: Environment, scale: GasScale, height_m: float) -> None:
    """Draw what only the map shows, at the slice's height: the room's outline, and the colour scale west of it."""
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    depth_m = float(high_m[1] - low_m[1])
    x0, y0, x1, y1 = float(low_m[0]), float(low_m[1]), float(high_m[0]), float(high_m[1])
    outline_m = [(x, y, height_m) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))]
    if environment.meshes:
        file.draw("map/obstacles", _obstacles(_seen_boxes(environment)))
    file.draw("map/outline", rr.LineStrips3D([outline_m], colors=[colors.EDGES], radii=[0.003 * depth_m]))

    right_m = x0 - SCALE_GAP_FRAC * (x1 - x0)
    width_m = SCALE_WIDTH_FRAC * (x1 - x0)
    cell_m = depth_m / colors.N_LEVELS
    n_columns = max(1, round(width_m / cell_m))
    picture = np.full((colors.N_LEVELS, n_columns, 4), 255, dtype=np.uint8)
    picture[::-1, :, :3] = colors.gas_colors()[:, None]
    bar = rr.GridMap(
        data=picture.tobytes(),
        format=picture_format(n_columns, colors.N_LEVELS),
        cell_size=cell_m,
        translation=(right_m - width_m, y0, height_m),
    )
    steps = range(colors.DECADES + 1)
    labels = [f"{scale.min_ppm * 10**i:g}" for i in steps]
    labels[-1] += " ppm"
    places_m = [(right_m - 3.2 * width_m, y0 + depth_m * i / colors.DECADES, height_m) for i in steps]
    file.draw("map/scale", bar)
    file.draw(
        "map/scale/labels",
        rr.Points3D(places_m, radii=[0.001], colors=[colors.READING], labels=labels, show_labels=True),
    )


def picture_format(width: int, height: int) -> rr.components.ImageFormat:
    """Return the format of an RGBA picture of this many cells."""
    return rr.components.ImageFormat(width=width, height=height, color_model="RGBA", channel_datatype="U8")


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
    """Return a name that any file may give as a part of an entity's path."""
    return re.sub(r"[^A-Za-z0-9_]+", "_", name) or "part"


# Seen through, as walls and roof are among them.
def _mesh(mesh: VisualMesh) -> rr.Mesh3D:
    rgb = [round(255 * channel) for channel in mesh.rgba[:3]]
    return rr.Mesh3D(vertex_positions=mesh.vertices_m, triangle_indices=mesh.faces, albedo_factor=[*rgb, MESH_ALPHA])


# A closed room's walls are the outline; walls that stand in the room are obstacles to look at.
def _seen_boxes(environment: Environment) -> list[Box]:
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    return [box for box in environment.boxes if box.kind == "obstacle" or _stands_inside(box, low_m, high_m)]


def _stands_inside(box: Box, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> bool:
    return box.kind == "wall" and bool(np.all(np.array(box.max_m) > low_m) and np.all(np.array(box.min_m) < high_m))


def _obstacles(boxes: list[Box]) -> rr.Boxes3D:
    rgba = [(*(round(255 * channel) for channel in box.rgba[:3]), OBSTACLE_ALPHA) for box in boxes]
    sizes_m = [np.array(box.max_m) - np.array(box.min_m) for box in boxes]
    return rr.Boxes3D(
        mins=[box.min_m for box in boxes],
        sizes=sizes_m,
        colors=rgba,
        radii=[0.025],
        fill_mode=GLASS,
        labels=[box.name for box in boxes],
        show_labels=False,
    )


def _opening(opening: Opening) -> rr.Boxes3D:
    color = colors.INLET if opening.kind == "inlet" else colors.OUTLET
    label = opening.kind
    if opening.kind == "inlet":
        label += f" {math.hypot(*opening.velocity_m_s):.2g} m/s"
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
