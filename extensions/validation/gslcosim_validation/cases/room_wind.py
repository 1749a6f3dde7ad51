"""Wind of a ventilated room beside measured profiles (IEA Annex 20, Restivo's room)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.patches import Inlet, Outlet, Patch, SlipWall
from gslcosim.flow.solve import solve_wind_report
from gslcosim.flow.turbulence import C_MU
from gslcosim_validation.readers.room_profiles import ProfileLine, RoomProfiles
from gslcosim_validation.results import Effort, Figure, Findings, Progress, plain_estimate

# Cells of the room's height. The two-dimensional room costs a hundredth of the whole one.
PLANE_CELLS: dict[Effort, int] = {"quick": 18, "full": 36}
ROOM_CELLS: dict[Effort, int] = {"quick": 18, "full": 36}
# The mean of as long as the air took to develop, 2.5 air changes of Restivo's room, as the set specifies.
MEAN_FROM_S, END_S = 900.0, 1800.0
SHAPES = ("two-dimensional", "three-dimensional")


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


def measure(room: RoomProfiles, effort: Effort, progress: Progress) -> Findings:
    """Return the error of our wind on each line, for each shape."""
    figures: list[Figure] = []
    found: dict[str, dict[str, NDArray[np.float64]]] = {}
    for i, (shape, cells) in enumerate(zip(SHAPES, (PLANE_CELLS[effort], ROOM_CELLS[effort]), strict=True)):
        progress(shape, i / len(SHAPES))
        u_m_s, cell_m = solve_room(room, cells, has_sides=shape == "three-dimensional")
        found[shape] = {line.name: wind_on_line(u_m_s, cell_m, line) for line in room.lines}
        figures += [_figure(shape, cells, room, line, found[shape][line.name]) for line in room.lines]
        figures += [
            _flow_figure(shape, cells, room, line, found[shape][line.name]) for line in room.lines if _is_upright(line)
        ]
    return Findings(figures=figures, drawings={"lines": lambda figure: _draw(figure, room, found)})


def _figure(shape: str, n_cells: int, room: RoomProfiles, line: ProfileLine, ours: NDArray[np.float64]) -> Figure:
    error = (ours - line.u_m_s) / room.inlet_m_s
    theirs = {model: values - line.u_m_s for model, values in line.of_models_m_s.items() if np.isfinite(values).all()}
    anchors = [f"{name} {_rms(each / room.inlet_m_s):.3f}" for name, each in (theirs | {"no wind": line.u_m_s}).items()]
    return Figure(
        "line",
        plain_estimate(_rms(error), len(error)),
        of=f"{shape} {line.name}",
        shape=shape,
        n_cells=n_cells,
        line=line.name,
        bias=np.mean(error),
        theirs=", ".join(anchors),
    )


def _is_upright(line: ProfileLine) -> bool:
    return bool(np.ptp(line.points_m[:, 2]) > np.ptp(line.points_m[:, 0]))


# Through an upright line, per metre of width, from its points and still air at floor and ceiling.
def _flow_m2_s(room: RoomProfiles, line: ProfileLine, u_m_s: NDArray[np.float64]) -> float:
    order = np.argsort(line.points_m[:, 2])
    heights_m = np.concatenate(([0.0], line.points_m[order, 2], [room.size_m[2]]))
    return float(np.trapezoid(np.concatenate(([0.0], u_m_s[order], [0.0])), heights_m))


def _flow_figure(shape: str, n_cells: int, room: RoomProfiles, line: ProfileLine, ours: NDArray[np.float64]) -> Figure:
    theirs = {"measured": line.u_m_s, **line.of_models_m_s}
    flows = {name: _flow_m2_s(room, line, values) for name, values in theirs.items() if np.isfinite(values).all()}
    flows["inlet"] = room.inlet_m_s * (room.inlet_z_m[1] - room.inlet_z_m[0])
    return Figure(
        "flow",
        plain_estimate(_flow_m2_s(room, line, ours), len(ours)),
        shape=shape,
        n_cells=n_cells,
        line=line.name,
        theirs=", ".join(f"{name} {value:.3f}" for name, value in flows.items()),
    )


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _draw(figure: Any, room: RoomProfiles, found: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> None:
    axes = figure.subplots(1, len(room.lines))
    for each, line in zip(axes, room.lines, strict=True):
        is_vertical = _is_upright(line)
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
