"""Layouts: from a scenario's few numbers to named boxes, furniture, inlet and outlet, and to an environment."""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import build_occupancy, find_occupancy_problems
from gslcosim.environment.layouts.families import (
    build_cluttered_rooms,
    build_home,
    build_items,
    build_office,
    build_plant,
    build_racks,
    build_wind_tunnel,
    l_shape_from_m,
    log_profile,
    whole_face,
)
from gslcosim.environment.model import (
    LAYOUT_PATH,
    MAX_CELLS,
    OBSTACLE_RGBA,
    WALL_NAMES,
    Box,
    EnvironmentGeometry,
    Grid,
    Light,
    Opening,
    closing_boxes,
    freeze_array,
    point_text,
    raise_if_any,
)
from gslcosim.environment.openings import (
    are_overlapping,
    default_inlet,
    default_outlet,
    describe_snapping,
    find_face,
    find_inflow_problems,
    find_opening_problems,
    snap_to_cells,
)
from gslcosim.scenario.models.geometry import (
    BoxSpec,
    ClutteredRoomsSpec,
    ComplexWarehouseSpec,
    FurtherOpeningSpec,
    HomeSpec,
    Layout,
    OfficeSpec,
    OpeningSpec,
    PlantSpec,
    SimpleWarehouseSpec,
    WindTunnelSpec,
)
from gslcosim.scenario.models.scenario import SolverSpec


def build_furniture(layout: Layout) -> tuple[Box, ...]:
    """Return all solids that a layout puts into its room; what the scenario adds as `obstacles` is not among them."""
    match layout:
        case SimpleWarehouseSpec():
            return build_racks(layout, opening_specs(layout))
        case ComplexWarehouseSpec():
            openings = opening_specs(layout)
            return build_racks(layout, openings) + build_items(layout, openings)
        case OfficeSpec():
            return build_office(layout)
        case HomeSpec():
            return build_home(layout)
        case ClutteredRoomsSpec():
            return build_cluttered_rooms(layout)
        case PlantSpec():
            return build_plant(layout)
        case WindTunnelSpec():
            return build_wind_tunnel(layout)
        case _:
            return ()


def opening_specs(layout: Layout) -> tuple[OpeningSpec, OpeningSpec]:
    """Return the inlet and the outlet that the scenario asks for, or those that are usual for the layout."""
    size_m = layout.size_m
    if isinstance(layout, PlantSpec | WindTunnelSpec):
        inlet, outlet = whole_face(size_m, 0, is_upper=False), whole_face(size_m, 0, is_upper=True)
    else:
        inlet, outlet = default_inlet(size_m, layout.inlet_size_m), default_outlet(size_m, layout.outlet_size_m)
        if isinstance(layout, OfficeSpec) and l_shape_from_m(layout) < size_m[0]:
            # The far corner is not part of the office: the air leaves at the corridor's end.
            outlet = _centred_on_y(outlet, min(outlet.max_m[1] - outlet.min_m[1], layout.corridor_m), size_m[1] / 2)
    return layout.inlet or inlet, layout.outlet or outlet


def _centred_on_y(opening: OpeningSpec, width_m: float, y_m: float) -> OpeningSpec:
    (x0, _, z0), (x1, _, z1) = opening.min_m, opening.max_m
    return OpeningSpec(min_m=(x0, y_m - width_m / 2, z0), max_m=(x1, y_m + width_m / 2, z1))


SKY_RGBA = (0.75, 0.85, 0.95, 0.05)
# Walls of Isaac Sim's warehouse are white up to here and yellow above, thesis 9.1.1.
WHITE_UP_TO_M, YELLOW_RGBA = 3.0, (0.95, 0.80, 0.15, 1.0)
# Chosen: as floor tiles of Isaac Sim's warehouse are long, thesis 9.1.2; a lamp hangs a little below the ceiling.
LIGHT_EVERY_M, LIGHT_BELOW_CEILING_FRAC = 6.0, 0.02


def plan_layout(layout: Layout, wind: SolverSpec) -> EnvironmentGeometry:
    """Lay out a room, where the air may find no way yet.

    Args:
        layout: What the scenario says of the room.
        wind: Gives the cell of the grid and the velocity at the inlet.

    Raises:
        ScenarioError: `find_layout_problems` has any.
    """
    raise_if_any(find_layout_problems(layout, wind))
    grid = _grid(layout, wind.cell_m)
    openings, notices = _openings(layout, wind, grid)
    boxes = (*_shell(layout), *build_furniture(layout), *(_obstacle(spec) for spec in layout.obstacles))
    return EnvironmentGeometry(
        name=layout.kind,
        grid=grid,
        occupancy=freeze_array(build_occupancy(boxes, openings, grid)),
        boxes=boxes,
        openings=openings,
        notices=notices,
        lights=_lights(layout),
    )


def find_layout_problems(layout: Layout, wind: SolverSpec) -> list[Problem]:
    """Return all that makes a layout impossible, with the places in the scenario; empty when it can be built."""
    problems = _problems_of_size(layout.size_m, wind.cell_m)
    problems += _problems_of_obstacles(layout)
    if problems:
        # Openings are checked against the grid of the room, which there is not yet.
        return problems
    grid = _grid(layout, wind.cell_m)
    inlet, outlet = opening_specs(layout)
    inlet_path, outlet_path = f"{LAYOUT_PATH}.inlet", f"{LAYOUT_PATH}.outlet"
    problems = find_opening_problems(inlet, grid, inlet_path) + find_opening_problems(outlet, grid, outlet_path)
    if problems:
        return problems
    if wind.solves and (face := find_face(inlet, grid)):
        problems += find_inflow_problems(wind.inlet_velocity_m_s, face)
    first, second = _inlet_and_outlet(layout, wind, grid)
    if are_overlapping(first, second, grid):
        problems.append(_problem_of_overlap(first, second, inlet_path if layout.inlet else outlet_path))
    return problems + _problems_of_further_openings(layout, wind, grid, [first, second])


def _problems_of_further_openings(layout: Layout, wind: SolverSpec, grid: Grid, others: list[Opening]) -> list[Problem]:
    problems: list[Problem] = []
    for i, spec in enumerate(layout.openings):
        path = f"{LAYOUT_PATH}.openings[{i}]"
        if spec.name in {other.name for other in others}:
            problems.append(_problem_of_name(spec.name, path, "opening", i + 2))
        if found := find_opening_problems(spec, grid, path):
            problems += found
            continue
        opening = _further(spec, wind, grid)
        problems += [
            _problem_of_overlap(other, opening, path) for other in others if are_overlapping(other, opening, grid)
        ]
        others.append(opening)
    return problems


def _problem_of_overlap(first: Opening, second: Opening, path: str) -> Problem:
    corners = [f"{point_text(each.min_m)} to {point_text(each.max_m)} m" for each in (first, second)]
    return Problem(
        where=path,
        expected=f"{first.name} and {second.name} apart from each other",
        found=f"{first.name} {corners[0]} and {second.name} {corners[1]}, which overlap",
        remedy="Move one of them.",
    )


def _problems_of_size(size_m: Vec3, cell_m: float) -> list[Problem]:
    n_cells = math.prod(length_m / cell_m for length_m in size_m)
    if n_cells > MAX_CELLS:
        coarser_m = cell_m * (n_cells / MAX_CELLS) ** (1 / 3)
        return [
            Problem(
                where="wind.cell_m",
                expected=f"cells that divide the room into at most {MAX_CELLS:.3g}",
                found=f"{cell_m:g} m, which makes {n_cells:.3g}",
                remedy=f"Take cells of at least {_rounded_up(coarser_m):g} m, or a smaller room.",
            )
        ]
    return [
        _problem_of_length(size_m, axis, cell_m)
        for axis, length_m in enumerate(size_m)
        if not _is_whole(length_m / cell_m)
    ]


# Not rounded in silence: a room of another size than the scenario says would surprise more than this error does.
def _problem_of_length(size_m: Vec3, axis: int, cell_m: float) -> Problem:
    n = size_m[axis] / cell_m
    below = max(1, math.floor(n))
    finer_m = _common_divisor_m(size_m, cell_m)
    return Problem(
        where=f"{LAYOUT_PATH}.size_m[{axis}]",
        expected=f"a whole number of the {cell_m:g} m cells of wind.cell_m",
        found=f"{size_m[axis]:g} m, which is {n:.4g} cells",
        remedy=f"Nearest: {below * cell_m:g} m or {(below + 1) * cell_m:g} m"
        + (f"; or wind.cell_m {finer_m:g}." if finer_m else "."),
    )


def _is_whole(n: float) -> bool:
    return round(n) >= 1 and abs(n - round(n)) < 1e-6


# The largest whole number of millimetres, at most the cell that was asked for, that divides all sides of a room;
# nothing when it would be so small that the room gets more than about sixty times the cells.
def _common_divisor_m(size_m: Vec3, cell_m: float) -> float | None:
    divisor_mm = math.gcd(*(round(length_m * 1000) for length_m in size_m))
    if any(abs(length_m * 1000 - round(length_m * 1000)) > 1e-6 for length_m in size_m):
        return None
    for n in range(1, divisor_mm + 1):
        finer_m = divisor_mm / n / 1000
        if divisor_mm % n == 0 and finer_m <= cell_m:
            return finer_m if finer_m >= cell_m / 4 else None
    return None


def _problem_of_name(name: str, path: str, kind: str, number: int) -> Problem:
    return Problem(
        where=f"{path}.name",
        expected=f"a name that no other {kind} has",
        found=name,
        remedy=f"For example {name}_{number}.",
    )


def _problems_of_obstacles(layout: Layout) -> list[Problem]:
    problems: list[Problem] = []
    names = {*WALL_NAMES, *(box.name for box in build_furniture(layout))}
    for i, spec in enumerate(layout.obstacles):
        path = f"{LAYOUT_PATH}.obstacles[{i}]"
        if spec.name in names:
            problems.append(_problem_of_name(spec.name, path, "box of the room", i + 1))
        names.add(spec.name)
        problems += _problems_of_extent(spec, layout.size_m, path)
    return problems


def _problems_of_extent(spec: BoxSpec, size_m: Vec3, path: str) -> list[Problem]:
    problems: list[Problem] = []
    for axis, (low_m, high_m, length_m) in enumerate(zip(spec.min_m, spec.max_m, size_m, strict=True)):
        if low_m < 0.0 or high_m > length_m + 1e-9:
            problems.append(
                Problem(
                    where=path,
                    expected=f"{'xyz'[axis]} inside the room, from 0 to {length_m:g} m",
                    found=f"{low_m:g} to {high_m:g} m",
                    remedy=_clipped_text(low_m, high_m, length_m),
                )
            )
    return problems


def _clipped_text(low_m: float, high_m: float, length_m: float) -> str:
    low_m, high_m = max(low_m, 0.0), min(high_m, length_m)
    return f"Cut it to {low_m:g} to {high_m:g} m." if low_m < high_m else "It lies outside altogether."


def _grid(layout: Layout, cell_m: float) -> Grid:
    nx, ny, nz = (round(length_m / cell_m) for length_m in layout.size_m)
    return Grid(origin_m=(0.0, 0.0, 0.0), cell_m=cell_m, shape=(nx, ny, nz))


def _openings(layout: Layout, wind: SolverSpec, grid: Grid) -> tuple[tuple[Opening, ...], tuple[str, ...]]:
    inlet, outlet = _inlet_and_outlet(layout, wind, grid)
    further = tuple(_further(spec, wind, grid) for spec in layout.openings)
    notices = (
        describe_snapping(opening.name, spec, (opening.min_m, opening.max_m), grid.cell_m)
        for opening, spec in zip((inlet, outlet, *further), (*opening_specs(layout), *layout.openings), strict=True)
    )
    openings: tuple[Opening, ...] = (inlet, outlet, *further)
    if isinstance(layout, PlantSpec):
        open_faces = _open_faces(layout, grid, openings)
        openings = (*log_profile(inlet, layout, grid), outlet, *further, *open_faces)
    return openings, tuple(notice for notice in notices if notice)


def _further(spec: FurtherOpeningSpec, wind: SolverSpec, grid: Grid) -> Opening:
    velocity_m_s = (spec.velocity_m_s or wind.inlet_velocity_m_s) if spec.kind == "inlet" else (0.0, 0.0, 0.0)
    return replace(_opening(spec.kind, spec, grid, velocity_m_s), name=spec.name)


def _inlet_and_outlet(layout: Layout, wind: SolverSpec, grid: Grid) -> tuple[Opening, Opening]:
    inlet, outlet = opening_specs(layout)
    return (
        _opening("inlet", inlet, grid, wind.inlet_velocity_m_s),
        _opening("outlet", outlet, grid, (0.0, 0.0, 0.0)),
    )


# Outdoors the air goes in and out through the sides and the top too, where nothing else is.
def _open_faces(layout: PlantSpec, grid: Grid, others: tuple[Opening, ...]) -> tuple[Opening, ...]:
    faces: list[Opening] = []
    for name, axis, is_upper in (("open_y_min", 1, False), ("open_y_max", 1, True), ("open_top", 2, True)):
        spec = whole_face(layout.size_m, axis, is_upper=is_upper)
        faces.append(replace(_opening("open", spec, grid, (0.0, 0.0, 0.0)), name=name))
    return tuple(face for face in faces if not any(are_overlapping(face, other, grid) for other in others))


def _opening(kind: Literal["inlet", "outlet", "open"], spec: OpeningSpec, grid: Grid, velocity_m_s: Vec3) -> Opening:
    face = find_face(spec, grid)
    assert face is not None, "checked before by problems_of_opening"
    min_m, max_m = snap_to_cells(spec, grid, face)
    return Opening(name=kind, kind=kind, min_m=min_m, max_m=max_m, velocity_m_s=velocity_m_s)


# Outdoors the boxes of the sky and the sides only keep vehicles in: they are hardly seen.
def _shell(layout: Layout) -> tuple[Box, ...]:
    boxes = closing_boxes((0.0, 0.0, 0.0), layout.size_m, layout.wall_m)
    if isinstance(layout, PlantSpec):
        return tuple(box if box.kind == "floor" else replace(box, rgba=SKY_RGBA) for box in boxes)
    if layout.walls == "white_yellow" and layout.size_m[2] > WHITE_UP_TO_M:
        return tuple(part for box in boxes for part in (_two_coloured(box) if box.kind == "wall" else (box,)))
    return boxes


def _two_coloured(wall: Box) -> tuple[Box, Box]:
    (x0, y0, _), (x1, y1, _) = wall.min_m, wall.max_m
    return (
        replace(wall, max_m=(x1, y1, WHITE_UP_TO_M)),
        replace(wall, name=f"{wall.name}_upper", min_m=(x0, y0, WHITE_UP_TO_M), rgba=YELLOW_RGBA),
    )


# In rows below the ceiling, each in the middle of its part of it. Outdoors there is daylight.
def _lights(layout: Layout) -> tuple[Light, ...]:
    x_m, y_m, z_m = layout.size_m
    if layout.lights is None and isinstance(layout, PlantSpec):
        return ()
    nx, ny = layout.lights or (max(1, round(x_m / LIGHT_EVERY_M)), max(1, round(y_m / LIGHT_EVERY_M)))
    return tuple(
        Light(
            name=f"light_{i}_{j}",
            position_m=(
                round((i + 0.5) * x_m / nx, 6),
                round((j + 0.5) * y_m / ny, 6),
                round(z_m - LIGHT_BELOW_CEILING_FRAC * z_m, 6),
            ),
        )
        for i in range(nx)
        for j in range(ny)
    )


def _obstacle(spec: BoxSpec) -> Box:
    return Box(name=spec.name, kind="obstacle", min_m=spec.min_m, max_m=spec.max_m, rgba=OBSTACLE_RGBA)


def _rounded_up(value: float) -> float:
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / scale) * scale


# A room is asked for several times on the way to a flight, and by many cases of a family.
_MOST_KEPT = 128


def build_layout(layout: Layout, wind: SolverSpec) -> EnvironmentGeometry:
    """Generate a room from its layout, without solving its wind.

    Args:
        layout: What the scenario says of the room.
        wind: Gives the cell of the grid and the velocity at the inlet.

    Raises:
        ScenarioError: the layout is impossible; the text lists all reasons.
    """
    problems, room = _made(_Recipe.of(layout, wind))
    raise_if_any(list(problems))
    assert room is not None, "a room without problems is made"
    return room


def find_room_problems(layout: Layout, wind: SolverSpec) -> list[Problem]:
    """Return all that makes a room impossible, with the places in the scenario; empty when it can be built."""
    return list(_made(_Recipe.of(layout, wind))[0])


@dataclass(frozen=True)
class _Recipe:
    text: str
    layout: Layout = field(compare=False)
    wind: SolverSpec = field(compare=False)

    @classmethod
    def of(cls, layout: Layout, wind: SolverSpec) -> "_Recipe":
        return cls(f"{layout.model_dump_json()}\n{wind.model_dump_json()}", layout, wind)


@lru_cache(_MOST_KEPT)
def _made(recipe: _Recipe) -> tuple[tuple[Problem, ...], EnvironmentGeometry | None]:
    layout, wind = recipe.layout, recipe.wind
    if problems := find_layout_problems(layout, wind):
        return tuple(problems), None
    room = plan_layout(layout, wind)
    problems = find_occupancy_problems(room)
    return (tuple(problems), None) if problems else ((), room)
