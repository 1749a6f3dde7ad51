"""Recording of an environment without a run: geometry, occupancy, wind arrows and streamlines."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.model import Cell, Environment
from gslcosim_formats.solid_boxes import boxes_from_solid
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.blueprint import build_space_view, fit_room_camera
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.events import WindLayer
from gslcosim_services.recorder.scene import WIRE, draw_room, floor_grid_m
from gslcosim_services.recorder.stream_table import WIND_ARROWS

# A step is this fraction of a cell; slower air counts as still. Both chosen.
STEP_CELLS = 0.5
STILL_M_S = 1e-3
OCCUPANCY, STREAMLINES = "occupancy", "streamlines"
N_STREAMLINES = 120
# A line is at most this many times as long as the room.
MAX_LENGTHS = 2.0
# Time has no meaning here, but the file requires a tick.
_TICK_NS = 1_000_000_000


def streamlines(
    environment: Environment, seeds_m: NDArray[np.float64], *, max_length_m: float
) -> list[NDArray[np.float64]]:
    """Return the paths along the wind of the first frame from the seeds, each (n, 3) with n >= 2, world frame [m].

    Steps have equal lengths and follow the midpoint rule; a path ends in a solid, outside the grid, in still air, or at
    its maximum length.

    Args:
        seeds_m: (n, 3) starts of the paths, world frame [m]; those outside the air have no path.
        max_length_m: Maximum length of a path [m].
    """
    step_m = STEP_CELLS * environment.grid.cell_m
    points_m = np.asarray(seeds_m, dtype=np.float64).reshape(-1, 3)
    is_going = _is_air(environment, points_m)
    paths = [points_m]
    lengths = np.where(is_going, 1, 0)
    for _ in range(int(max_length_m / step_m)):
        middle_m = points_m + 0.5 * step_m * _direction(environment, points_m)
        direction = _direction(environment, middle_m)
        points_m = points_m + step_m * direction
        is_going &= direction.any(axis=1) & _is_air(environment, points_m)
        if not is_going.any():
            break
        paths.append(points_m)
        lengths += is_going
    track_m = np.stack(paths)
    return [track_m[:n, i] for i, n in enumerate(lengths) if n >= 2]


# Unit vectors along the wind, (n, 3); zero where it is still.
def _direction(environment: Environment, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    grid = environment.grid
    wind_m_s = trilinear_wind_at_points(environment.wind.velocity_m_s[0], grid.origin_m, grid.cell_m, points_m)
    speed_m_s = np.linalg.norm(wind_m_s, axis=1, keepdims=True)
    return np.where(speed_m_s > STILL_M_S, wind_m_s / np.maximum(speed_m_s, STILL_M_S), 0.0)


def _is_air(environment: Environment, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    cells = environment.grid.cell_of(points_m)
    is_inside = environment.grid.contains_cell(cells)
    i, j, k = np.where(is_inside[:, None], cells, 0).T
    return is_inside & (environment.occupancy[i, j, k] != Cell.SOLID)


def record_environment(environment: Environment, path: Path) -> None:
    """Write a recording that shows an environment.

    Arrows are the wind at 2 m, or in the middle of lower rooms. Half of the streamlines begin at the inlets, the others
    anywhere in the air.
    """
    file = RecordingFile(
        path,
        run_id=environment.content_hash,
        name=environment.name,
        tick_ns=_TICK_NS,
        blueprint=_blueprint(environment),
    )
    draw_room(file, environment)
    _draw_occupancy(file, environment)
    height_m = min(2.0, (environment.grid.max_m[2] - environment.grid.origin_m[2]) / 2)
    WindLayer(environment, environment.grid.origin_m[2] + height_m).draw(file, WIND_ARROWS.entity)
    _draw_streamlines(file, environment)
    file.close()


def _blueprint(environment: Environment) -> rrb.Blueprint:
    grid = environment.grid
    size = " x ".join(f"{high - low:.4g}" for low, high in zip(grid.origin_m, grid.max_m, strict=True))
    name = f"{environment.name}, {size} m (floor grid {floor_grid_m(environment):g} m)"
    # Occupancy covers the geometry from which it was made, so it is hidden at first.
    hidden = {OCCUPANCY: rrb.EntityBehavior(visible=False)}
    view = build_space_view(name, fit_room_camera(environment), (0.0, 0.0, 1.0), overrides=hidden)
    return rrb.Blueprint(
        view,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def _draw_occupancy(file: RecordingFile, environment: Environment) -> None:
    boxes = boxes_from_solid(environment.occupancy == Cell.SOLID, environment.grid)
    if boxes:
        mins_m = np.array([box.min_m for box in boxes])
        sizes_m = np.array([box.max_m for box in boxes]) - mins_m
        file.draw(
            OCCUPANCY, rr.Boxes3D(mins=mins_m, sizes=sizes_m, colors=[colors.EDGES], radii=[0.01], fill_mode=WIRE)
        )


def _draw_streamlines(file: RecordingFile, environment: Environment) -> None:
    size_m = np.subtract(environment.grid.max_m, environment.grid.origin_m)
    lines_m = streamlines(environment, _streamline_seeds_m(environment), max_length_m=MAX_LENGTHS * float(size_m.max()))
    if lines_m:
        radius_m = 0.0008 * float(size_m.max())
        file.draw(STREAMLINES, rr.LineStrips3D(lines_m, colors=[colors.INLET], radii=[radius_m]))


def _streamline_seeds_m(environment: Environment) -> NDArray[np.float64]:
    rng = stream(0, "recording.streamlines")
    grid = environment.grid
    air = np.argwhere(environment.occupancy != Cell.SOLID)
    chosen = air[rng.integers(len(air), size=N_STREAMLINES // 2)] if len(air) else air
    seeds_m = [np.asarray(grid.origin_m, dtype=np.float64) + (chosen + 0.5) * grid.cell_m]
    inlets = [opening for opening in environment.openings if opening.kind == "inlet"]
    for inlet in inlets:
        n = max(1, N_STREAMLINES // 2 // len(inlets))
        low, high = np.array(inlet.min_m), np.array(inlet.max_m)
        # Half a cell into the room, where the first centres are.
        inward = np.where(low == high, np.sign(np.array(inlet.velocity_m_s)) * grid.cell_m / 2, 0.0)
        seeds_m.append(low + rng.random((n, 3)) * (high - low) + inward)
    return np.concatenate(seeds_m)
