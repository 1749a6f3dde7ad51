"""Wind of a ventilated room beside measured profiles (IEA Annex 20, Restivo's room)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.patches import Inlet, Outlet, Patch, SlipWall
from gslcosim.flow.solve import solve_wind_report
from gslcosim.flow.turbulence import C_MU
from gslcosim_validation.readers.folder import MeasuredData
from gslcosim_validation.readers.room_profiles import ProfileLine, RoomProfiles
from gslcosim_validation.results import Case, CaseResult, Comparison, Drawing, Effort, Goal, Progress, plain_estimate

# Cells of the room's height. The two-dimensional room costs a hundredth of the whole one.
PLANE_CELLS: dict[Effort, int] = {"quick": 18, "full": 36}
ROOM_CELLS: dict[Effort, int] = {"quick": 18, "full": 36}
# Best stored output of FDS, root mean square over U0; see `anchor.json` of the set. Lines of other names have no goal.
BEST_OF_FDS = {"x3": 0.081, "x6": 0.072, "floor": 0.056, "ceiling": 0.162}
# The mean of as long as the air took to develop, 2.5 air changes of Restivo's room, as the set specifies.
MEAN_FROM_S, END_S = 900.0, 1800.0
# Shapes that are solved, and what they do with the side walls.
SHAPES = {
    "two-dimensional": "as the test case is specified, a plane without side walls",
    "three-dimensional": "as the room was built, with side walls; half of it, to the plane of the lines",
}


def solve_room(room: RoomProfiles, n_cells: int, *, has_sides: bool) -> tuple[NDArray[np.float32], float]:
    """Solve the mean wind, and return its x-component on faces (nx + 1, ny, nz) [m/s] and the edge of a cell [m].

    Args:
        n_cells: Of the room's height.
        has_sides: Half the room from one side wall to the middle plane; else a slice without side walls.
    """
    length_m, width_m, height_m = room.size_m
    cell_m = height_m / n_cells
    n_y = max(1, round(0.5 * width_m / cell_m)) if has_sides else 1
    depth_m = n_y * cell_m
    low_m, high_m = room.inlet_z_m
    patches: list[Patch] = [
        Inlet(
            min_m=(0, 0, low_m),
            max_m=(0, depth_m, high_m),
            velocity_m_s=(room.inlet_m_s, 0, 0),
            turbulence_intensity=room.inlet_intensity,
            # The specification's epsilon is k^(3/2) / l.
            turbulence_length_m=C_MU**0.75 * room.inlet_length_m,
        ),
        Outlet(min_m=(length_m, 0, room.outlet_z_m[0]), max_m=(length_m, depth_m, room.outlet_z_m[1])),
        SlipWall(min_m=(0, depth_m, 0), max_m=(length_m, depth_m, height_m)),
    ]
    if not has_sides:
        patches.append(SlipWall(min_m=(0, 0, 0), max_m=(length_m, 0, height_m)))
    free = np.ones((round(length_m / cell_m), n_y, n_cells), bool)
    report = solve_wind_report(
        free,
        cell_m,
        patches,
        end_time_s=END_S,
        average_from_s=MEAN_FROM_S,
    )
    return report.face_velocity_m_s[0], cell_m


def wind_on_line(u_m_s: NDArray[np.float32], cell_m: float, line: ProfileLine) -> NDArray[np.float64]:
    """Return the x-component at the points of a line in the middle plane, linear between faces, 0 at floor and ceiling.

    Args:
        u_m_s: On faces, the last row along y beside the middle plane.
        cell_m: Edge of a cell [m].
    """
    plane = np.pad(u_m_s[:, -1].astype(np.float64), ((0, 0), (1, 1)))
    n_x, n_z = plane.shape
    heights_m = np.concatenate(([0.0], (np.arange(n_z - 2) + 0.5) * cell_m, [(n_z - 2) * cell_m]))
    values = []
    for x_m, _, z_m in line.points_m:
        i = min(int(x_m / cell_m), n_x - 2)
        share = x_m / cell_m - i
        values.append(np.interp(z_m, heights_m, (1 - share) * plane[i] + share * plane[i + 1]))
    return np.array(values)


def _run(data: MeasuredData, effort: Effort, progress: Progress) -> CaseResult:
    rows: list[Comparison] = []
    drawings: list[Drawing] = []
    for each in data.of_format("room_profiles"):
        room = data.read(each, RoomProfiles)
        found: dict[str, dict[str, NDArray[np.float64]]] = {}
        for i, (shape, cells) in enumerate(zip(SHAPES, (PLANE_CELLS[effort], ROOM_CELLS[effort]), strict=True)):
            progress(f"{each.name}: {shape}", i / len(SHAPES))
            u_m_s, cell_m = solve_room(room, cells, has_sides=shape == "three-dimensional")
            found[shape] = {line.name: wind_on_line(u_m_s, cell_m, line) for line in room.lines}
            rows += [_row(each.name, shape, cells, room, line, found[shape][line.name]) for line in room.lines]
        drawings.append(_drawing(each.name, room, found))
    return CaseResult(rows=rows, drawings=drawings, remarks=_REMARKS)


def _row(
    name: str, shape: str, n_cells: int, room: RoomProfiles, line: ProfileLine, ours: NDArray[np.float64]
) -> Comparison:
    error = (ours - line.u_m_s) / room.inlet_m_s
    theirs = [
        f"{model} {_rms((values - line.u_m_s) / room.inlet_m_s):.3f}"
        for model, values in line.of_models_m_s.items()
        if np.isfinite(values).all()
    ]
    best = BEST_OF_FDS.get(line.name)
    bias = f"bias {np.mean(error):+.3f}"
    return Comparison(
        measured_set=name,
        quantity=f"{shape}, {n_cells} cells high: rms of u / U0 on {line.name}, {bias}",
        ours=plain_estimate(_rms(error), len(error)),
        anchor=", ".join([*theirs, f"no wind {_rms(line.u_m_s / room.inlet_m_s):.3f}"]),
        goal=None if best is None else Goal.at_most(best),
        if_missed=_MISSES.get(line.name, ""),
    )


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _drawing(name: str, room: RoomProfiles, found: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> Drawing:
    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(room.lines))
        for each, line in zip(axes, room.lines, strict=True):
            is_vertical = np.ptp(line.points_m[:, 2]) > np.ptp(line.points_m[:, 0])
            along = line.points_m[:, 2 if is_vertical else 0]
            curves: Sequence[tuple[str, NDArray[np.float64], str]] = [
                ("measured", line.u_m_s, "ko"),
                *[(shape, values[line.name], style) for (shape, values), style in zip(found.items(), ("C0-", "C1-"))],
                *[(model, values, ":") for model, values in line.of_models_m_s.items() if np.isfinite(values).all()],
            ]
            for label, values, style in curves:
                points = (values / room.inlet_m_s, along) if is_vertical else (along, values / room.inlet_m_s)
                each.plot(*points, style, ms=2, lw=1, label=label)
            each.set_title(line.name)
            each.set_xlabel("u / U0" if is_vertical else "x [m]")
            each.set_ylabel("z [m]" if is_vertical else "u / U0")
        axes[0].legend(fontsize=5)

    caption = f"{name}: wind along x over that of the inlet, measured, ours, and stored outputs of FDS (dotted)."
    return Drawing(name=f"{name}-lines", caption=caption, draw=draw, aspect=0.35)


_WALL_JET = (
    "The jet under the ceiling decays too fast. Half of it is the cells: with 1, 2 and 4 of them in the slot the bias "
    "of the two-dimensional room is -0.15, -0.08 and -0.01. The other half is what side walls do in k-epsilon: they "
    "add friction, and the jet turns away from them."
)
_MISSES = {
    "ceiling": _WALL_JET,
    "x3": "The measured profile carries 0.093 m2/s forward, the inlet 0.076: no flow that keeps its volume in the "
    "plane can reach it, and with side walls, along which air turns back, ours is lower still.",
    "x6": "See the ceiling: what the jet has lost before is missing here.",
    "floor": "Without side walls all that the inlet brings turns back in the plane: ours is 0.03 U0 faster than "
    "measured. With side walls it is not.",
}
_REMARKS = (
    "k-epsilon with wall functions and the turbulence of the inlet that the specification gives. The test case is "
    "specified as two-dimensional and was measured in the middle of a room as wide as it is high, so both are solved: "
    + "; ".join(f"{name}, {what}" for name, what in SHAPES.items())
    + ".",
    "The renormalised model (`rng_k_epsilon`) has less eddy viscosity, which coarse cells need: with 36 cells its rms "
    "in the whole room is 0.128, 0.074, 0.063 and 0.168 (x3, x6, floor, ceiling), with 18 above 0.1 on all lines.",
)

CASE = Case(
    name="room-wind",
    title="A ventilated room",
    what="The built-in wind solver in an empty room with a slot under the ceiling, beside the mean wind along two "
    "verticals and along floor and ceiling in the middle plane.",
    formats=("room_profiles",),
    run=_run,
)
