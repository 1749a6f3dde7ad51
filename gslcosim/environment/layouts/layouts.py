"""Layouts: from a scenario's few numbers to a room of named boxes, openings and lamps."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

from gslcosim.base import elementary
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
    closing_boxes,
    freeze_array,
    raise_if_any,
)
from gslcosim.environment.openings import WantedOpening, place_openings
from gslcosim.scenario.models.geometry import (
    ClutteredRoomsSpec,
    ComplexWarehouseSpec,
    HomeSpec,
    Layout,
    OfficeSpec,
    OpeningSpec,
    PlantSpec,
    SimpleWarehouseSpec,
    WindTunnelSpec,
)
from gslcosim.scenario.models.scenario import SolverSpec

# Width (along y) and height of inlet and outlet, Table 9.2 of the GSL-Bench thesis.
THESIS_OPENING_M = (1.5, 2.4)
# Small rooms: an opening takes at most these fractions of the room's y and z size (chosen; no effect on 15 x 15 x 8 m).
MAX_WIDTH_FRAC, MAX_HEIGHT_FRAC = 0.4, 0.6
SKY_RGBA = (0.75, 0.85, 0.95, 0.05)
# Walls of Isaac Sim's warehouse are white up to here and yellow above, thesis 9.1.1.
WHITE_UP_TO_M, YELLOW_RGBA = 3.0, (0.95, 0.80, 0.15, 1.0)
# Chosen: the length of floor tiles of Isaac Sim's warehouse, thesis 9.1.2; a lamp hangs a little below the ceiling.
LIGHT_EVERY_M, LIGHT_BELOW_CEILING_FRAC = 6.0, 0.02
# A room is needed several times before a run, and by many cases of a family.
_MOST_KEPT = 128


def build_layout(layout: Layout, wind: SolverSpec) -> EnvironmentGeometry:
    """Generate a room from its layout, without solving its wind.

    Args:
        layout: The room in the scenario.
        wind: Gives the cell of the grid and the velocity at the inlet.
    """
    problems, room = _build_once(_Recipe.of(layout, wind))
    raise_if_any(problems)
    assert room is not None, "a room without problems is built"
    return room


def find_room_problems(layout: Layout, wind: SolverSpec) -> list[Problem]:
    """Return all problems of a room, with the places in the scenario; empty when it can be built."""
    return list(_build_once(_Recipe.of(layout, wind))[0])


def build_furniture(layout: Layout) -> tuple[Box, ...]:
    """Return all solids of a layout's family; the scenario's `obstacles` are not among them."""
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
    """Return the inlet and the outlet of the scenario, or the defaults of the layout.

    Defaults are whole faces outdoors and in tunnels. In rooms they are the thesis's: on the floor, the inlet at x = 0
    in the corner y = 0, the outlet in the opposite corner; in an L-shaped office, at the corridor's end.
    """
    (x_m, y_m, z_m), usual_m = layout.size_m, THESIS_OPENING_M
    if isinstance(layout, PlantSpec | WindTunnelSpec):
        inlet, outlet = _face_spec(layout.size_m, 0, is_upper=False), _face_spec(layout.size_m, 0, is_upper=True)
    else:
        usual_m = min(usual_m[0], MAX_WIDTH_FRAC * y_m), min(usual_m[1], MAX_HEIGHT_FRAC * z_m)
        (in_y_m, in_z_m), (out_y_m, out_z_m) = layout.inlet_size_m or usual_m, layout.outlet_size_m or usual_m
        low_m, high_m = y_m - out_y_m, y_m
        if isinstance(layout, OfficeSpec) and l_shape_from_m(layout) < x_m:
            half_m = min(high_m - low_m, layout.corridor_m) / 2
            low_m, high_m = y_m / 2 - half_m, y_m / 2 + half_m
        inlet = OpeningSpec(min_m=(0.0, 0.0, 0.0), max_m=(0.0, in_y_m, in_z_m))
        outlet = OpeningSpec(min_m=(x_m, low_m, 0.0), max_m=(x_m, high_m, out_z_m))
    return layout.inlet or inlet, layout.outlet or outlet


@dataclass(frozen=True)
class _Recipe:
    """A layout and its wind, equal to others of the same text."""

    text: str
    layout: Layout = field(compare=False)
    wind: SolverSpec = field(compare=False)

    @classmethod
    def of(cls, layout: Layout, wind: SolverSpec) -> "_Recipe":
        return cls(f"{layout.model_dump_json()}\n{wind.model_dump_json()}", layout, wind)


@lru_cache(_MOST_KEPT)
def _build_once(recipe: _Recipe) -> tuple[tuple[Problem, ...], EnvironmentGeometry | None]:
    layout, wind = recipe.layout, recipe.wind
    furniture = build_furniture(layout)
    problems = [*_find_size_problems(layout.size_m, wind.cell_m), *_find_obstacle_problems(layout, furniture)]
    if problems:
        # The checks of openings need the grid of the room.
        return tuple(problems), None
    nx, ny, nz = (round(length_m / wind.cell_m) for length_m in layout.size_m)
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=wind.cell_m, shape=(nx, ny, nz))
    openings, problems, notices = place_openings(tuple(_list_openings(layout, wind)), grid)
    if problems:
        return tuple(problems), None
    if isinstance(layout, PlantSpec):
        openings = (*log_profile(openings[0], layout, grid), *openings[1:])
    obstacles = (
        Box(name=spec.name, kind="obstacle", min_m=spec.min_m, max_m=spec.max_m, rgba=OBSTACLE_RGBA)
        for spec in layout.obstacles
    )
    boxes = (*_build_shell(layout), *furniture, *obstacles)
    room = EnvironmentGeometry(
        name=layout.kind,
        grid=grid,
        occupancy=freeze_array(build_occupancy(boxes, openings, grid)),
        boxes=boxes,
        openings=openings,
        notices=notices,
        lights=_build_lights(layout),
    )
    problems = find_occupancy_problems(room)
    return tuple(problems), None if problems else room


# An error, not a silent rounding: a room of another size than the scenario's would be the greater surprise.
def _find_size_problems(size_m: Vec3, cell_m: float) -> Iterator[Problem]:
    n_cells = math.prod(length_m / cell_m for length_m in size_m)
    if n_cells > MAX_CELLS:
        coarser_m = cell_m * elementary.cbrt(n_cells / MAX_CELLS)
        step_m = float(f"1e{math.floor(elementary.log10(coarser_m)) - 1}")
        yield Problem(
            where="wind.cell_m",
            expected=f"cells that divide the room into at most {MAX_CELLS:.3g}",
            found=f"{cell_m:g} m, which makes {n_cells:.3g}",
            remedy=f"Take cells of at least {math.ceil(coarser_m / step_m) * step_m:g} m, or a smaller room.",
        )
        return
    for axis, length_m in enumerate(size_m):
        n = length_m / cell_m
        if round(n) >= 1 and abs(n - round(n)) < 1e-6:
            continue
        below, finer_m = max(1, math.floor(n)), _find_common_divisor_m(size_m, cell_m)
        yield Problem(
            where=f"{LAYOUT_PATH}.size_m[{axis}]",
            expected=f"a whole number of the {cell_m:g} m cells of wind.cell_m",
            found=f"{length_m:g} m, which is {n:.4g} cells",
            remedy=f"Nearest: {below * cell_m:g} m or {(below + 1) * cell_m:g} m"
            + (f"; or wind.cell_m {finer_m:g}." if finer_m else "."),
        )


# The largest whole number of millimetres up to the scenario's cell that divides all sides of a room; None when the room
# would have more than about sixty times the cells.
def _find_common_divisor_m(size_m: Vec3, cell_m: float) -> float | None:
    divisor_mm = math.gcd(*(round(length_m * 1000) for length_m in size_m))
    if any(abs(length_m * 1000 - round(length_m * 1000)) > 1e-6 for length_m in size_m):
        return None
    for n in range(1, divisor_mm + 1):
        finer_m = divisor_mm / n / 1000
        if divisor_mm % n == 0 and finer_m <= cell_m:
            return finer_m if finer_m >= cell_m / 4 else None
    return None


def _find_obstacle_problems(layout: Layout, furniture: tuple[Box, ...]) -> Iterator[Problem]:
    names = {*WALL_NAMES, *(box.name for box in furniture)}
    for i, spec in enumerate(layout.obstacles):
        path = f"{LAYOUT_PATH}.obstacles[{i}]"
        if spec.name in names:
            yield Problem(
                where=f"{path}.name",
                expected="a name that no other box of the room has",
                found=spec.name,
                remedy=f"For example {spec.name}_{i + 1}.",
            )
        names.add(spec.name)
        for axis, (low_m, high_m, length_m) in enumerate(zip(spec.min_m, spec.max_m, layout.size_m, strict=True)):
            if low_m < 0.0 or high_m > length_m + 1e-9:
                cut_m = max(low_m, 0.0), min(high_m, length_m)
                is_partly_inside = cut_m[0] < cut_m[1]
                yield Problem(
                    where=path,
                    expected=f"{'xyz'[axis]} inside the room, from 0 to {length_m:g} m",
                    found=f"{low_m:g} to {high_m:g} m",
                    remedy=f"Cut it to {cut_m[0]:g} to {cut_m[1]:g} m."
                    if is_partly_inside
                    else "It lies outside altogether.",
                )


# Outdoors the air also passes through the sides and the top, where they have no other opening.
def _list_openings(layout: Layout, wind: SolverSpec) -> Iterator[WantedOpening]:
    inlet, outlet = opening_specs(layout)
    inlet_path, outlet_path = f"{LAYOUT_PATH}.inlet", f"{LAYOUT_PATH}.outlet"
    wind_m_s = wind.inlet_velocity_m_s
    yield WantedOpening("inlet", "inlet", inlet, inlet_path, wind_m_s, is_wind_checked=wind.solves)
    yield WantedOpening("outlet", "outlet", outlet, outlet_path, overlap_path=inlet_path if layout.inlet else None)
    for i, spec in enumerate(layout.openings):
        velocity_m_s = (spec.velocity_m_s or wind_m_s) if spec.kind == "inlet" else (0.0, 0.0, 0.0)
        yield WantedOpening(spec.name, spec.kind, spec, f"{LAYOUT_PATH}.openings[{i}]", velocity_m_s)
    if isinstance(layout, PlantSpec):
        for name, axis, is_upper in (("open_y_min", 1, False), ("open_y_max", 1, True), ("open_top", 2, True)):
            face = _face_spec(layout.size_m, axis, is_upper=is_upper)
            yield WantedOpening(name, "open", face, LAYOUT_PATH, is_optional=True)


# A whole face of the room; `axis` 0, 1, 2 is x, y, z.
def _face_spec(size_m: Vec3, axis: int, *, is_upper: bool) -> OpeningSpec:
    low, high = [0.0, 0.0, 0.0], [*size_m]
    (low if is_upper else high)[axis] = size_m[axis] if is_upper else 0.0
    return OpeningSpec(min_m=(low[0], low[1], low[2]), max_m=(high[0], high[1], high[2]))


# Outdoors the boxes of the sky and the sides only keep vehicles in, and are almost transparent.
def _build_shell(layout: Layout) -> Iterator[Box]:
    for box in closing_boxes((0.0, 0.0, 0.0), layout.size_m, layout.wall_m):
        if isinstance(layout, PlantSpec):
            yield box if box.kind == "floor" else replace(box, rgba=SKY_RGBA)
        elif box.kind == "wall" and layout.walls == "white_yellow" and layout.size_m[2] > WHITE_UP_TO_M:
            (x0, y0, _), (x1, y1, _) = box.min_m, box.max_m
            yield replace(box, max_m=(x1, y1, WHITE_UP_TO_M))
            yield replace(box, name=f"{box.name}_upper", min_m=(x0, y0, WHITE_UP_TO_M), rgba=YELLOW_RGBA)
        else:
            yield box


# In rows below the ceiling, each in the middle of its tile. Outdoors there is daylight.
def _build_lights(layout: Layout) -> tuple[Light, ...]:
    x_m, y_m, z_m = layout.size_m
    if layout.lights is None and isinstance(layout, PlantSpec):
        return ()
    nx, ny = layout.lights or (max(1, round(x_m / LIGHT_EVERY_M)), max(1, round(y_m / LIGHT_EVERY_M)))
    height_m = round(z_m - LIGHT_BELOW_CEILING_FRAC * z_m, 6)
    return tuple(
        Light(
            name=f"light_{i}_{j}",
            position_m=(round((i + 0.5) * x_m / nx, 6), round((j + 0.5) * y_m / ny, 6), height_m),
        )
        for i in range(nx)
        for j in range(ny)
    )
