"""Wind of an edited room: the settled wind of the room before, adapted to a door, a box or a fan."""

import hashlib
import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from gslcosim.base.disk_cache import keep_within_limit, mark_used
from gslcosim.base.errors import EnvironmentDataError, FlowError
from gslcosim.base.files import replace_file
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.base.problems import Problem
from gslcosim.environment.generation.cache import recipe_hash
from gslcosim.environment.generation.wind import SolvedWind, WindSetup, build_patches, solve_block_wind
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.grid_kernels import find_air_cells
from gslcosim.environment.model import Cell, EnvironmentGeometry, WindFrames
from gslcosim.flow.convergence import FieldMean
from gslcosim.flow.domain import Domain, build_domain
from gslcosim.flow.pressure import F32, HIGH, LOW, padded
from gslcosim.flow.solve import AIR_NU_M2_S, SolverNumerics, coarsen_domain, continue_on_fine_cells
from gslcosim.flow.solver import FlowSolver, clear_ghosts
from gslcosim.flow.turbulence import KEpsilon
from gslcosim.scenario.models.base import Positive
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim.scenario.models.wind import SolverSpec, WindSpec

# Time of an edit over that of a settled solve, unless `edit_s` is given: with what it costs besides, a twentieth.
EDIT_FRAC = 0.04
# Time on cells of twice the size over that, of which it costs a sixteenth; chosen: half of an edit's computing.
COARSE_TIMES = 6.0
# With fewer cells of air, boxes and openings are too few larger cells wide, and the correction may do harm: measured.
LEAST_CELLS = 15_000
# Least and largest factor by which an edit changes the turbulence of a cell at once; chosen.
FACTORS = (0.01, 100.0)
COURANT = 0.9
_STATE_FILE = "wind_state.npz"
_INNER = (slice(LOW, -HIGH),) * 3
_LEAST = np.float32(1e-12)
Fraction = Callable[[float], None]


class EditedWindSpec(SolverSpec):
    """`edited` is the settled wind of a room that differs from a room before by a few doors, boxes or fans.

    - The wind of the room before is solved once for `settle_s`, and cached; it has all doors open.
    - The room's own wind starts from it and adapts, at the cost of solving `edit_s`.
    - Wind that changes all over the room needs a longer `edit_s`; a notice reports how much it still changed.
    """

    solver: Literal["edited"] = Field(default="edited", description="wind model")
    before: dict[str, Any] = Field(
        default={}, description="keys of `environment.layout` with their values before the edit"
    )
    turbulence: Literal["k_epsilon", "rng_k_epsilon", "smagorinsky", "laminar"] = Field(
        default="k_epsilon", description="turbulence model"
    )
    settle_s: Positive = Field(default=400.0, description="time of the solve before the edit, from still air")
    edit_s: Annotated[float, Field(gt=0)] | None = Field(
        default=None, description="time in which the wind adapts to the edit (absent: 0.04 of `settle_s`)"
    )

    @property
    def solves(self) -> bool:
        """True: the flow has to enter and leave the room."""
        return True


@dataclass(frozen=True, kw_only=True)
class FlowState:
    """A flow at an instant, padded arrays of `flow.solver.FlowSolver`.

    Attributes:
        u: x-face velocities [m/s].
        v, w: Same, y- and z-faces.
        pressure: Pressure over density [m2/s2].
        k: Turbulence energy [m2/s2], zeros for models without.
        epsilon: Its dissipation [m2/s3], zeros for models without.
        air: 1 in cells in which the flow was solved, else 0.
    """

    u: F32
    v: F32
    w: F32
    pressure: F32
    k: F32
    epsilon: F32
    air: F32

    @classmethod
    def of(cls, solver: FlowSolver) -> Self:
        """Return a copy of the state of a solver, still in solids."""
        u, v, w = (component.copy() for component in solver.velocity)
        clear_ghosts(solver.domain, (u, v, w))
        model, none = solver.model, np.zeros_like(solver.pressure)
        k, epsilon = (model.k, model.epsilon) if isinstance(model, KEpsilon) else (none, none)
        air = solver.domain.air.astype(np.float32)
        return cls(u=u, v=v, w=w, pressure=solver.pressure.copy(), k=k.copy(), epsilon=epsilon.copy(), air=air)


@dataclass(frozen=True, kw_only=True)
class SettledFlow:
    """The flow of a room before its edits.

    Attributes:
        own: The settled flow on the room's own cells.
        coarse: The flow that develops from it on cells of twice the size, spread over the room's own cells; absent
            where these do not represent the room.
    """

    own: FlowState
    coarse: FlowState | None


@dataclass(frozen=True, kw_only=True)
class EditedFlow:
    """The wind in an edited room.

    Attributes:
        velocity_m_s: (nx, ny, nz, 3) at cell centres, xyz, in the grid's frame; zero in solids.
        divergence_relative: Largest |div u| h of a cell over the largest speed at the inlets.
        change_frac: Root mean square change between the means of the last two quarters, over the same speed.
    """

    velocity_m_s: F32
    divergence_relative: float
    change_frac: float


@solve_block_wind.register
def solve_edited_wind(block: EditedWindSpec, setup: WindSetup) -> SolvedWind:
    """Return the wind of a room from that of the room before its edit.

    Raises:
        EnvironmentDataError: the room is not from a layout, or the room before has other cells.
    """
    numerics = SolverNumerics(turbulence=block.turbulence, nu_m2_s=AIR_NU_M2_S, courant=COURANT)
    state = _find_state(block, setup, numerics)
    edited = adapt_flow(
        state,
        build_room_domain(setup.room, block),
        numerics,
        edit_s=_edit_s(block),
        progress=lambda fraction: setup.progress("Adapting the wind to the edit", fraction),
    )
    edited.velocity_m_s[setup.room.occupancy == Cell.SOLID] = 0
    notice = (
        f"The wind was adapted from the room before; in the last quarter of that time it changed by "
        f"{edited.change_frac:.2g} of the speed at the inlets (wind.edit_s)."
    )
    return SolvedWind(frames=WindFrames(velocity_m_s=edited.velocity_m_s[np.newaxis]), notices=(notice,))


def build_room_domain(room: EnvironmentGeometry, block: EditedWindSpec) -> Domain:
    """Return the solver's domain of a room."""
    wind = WindSpec(solver="built_in", inlet_velocity_m_s=block.inlet_velocity_m_s, cell_m=block.cell_m)
    return build_domain(find_air_cells(room.occupancy), room.grid.cell_m, build_patches(room, wind))


def settle_flow(
    domain: Domain, numerics: SolverNumerics, *, settle_s: float, progress: Fraction | None = None
) -> FlowState:
    """Return the flow in a room after a time [s] from still air."""
    solver = numerics.solver(domain)
    _run(solver, settle_s, progress)
    return FlowState.of(solver)


def prepare_edits(own: FlowState, domain: Domain, numerics: SolverNumerics, *, edit_s: float) -> SettledFlow:
    """Return the flow of a room, ready for edits of `edit_s` [s]; see `adapt_flow`."""
    return SettledFlow(own=own, coarse=_develop_coarse(own, domain, numerics, edit_s))


def adapt_flow(
    state: SettledFlow, domain: Domain, numerics: SolverNumerics, *, edit_s: float, progress: Fraction | None = None
) -> EditedFlow:
    """Return the wind after an edit.

    u = u_own + (u_coarse(edit) - u_coarse),  then the solver's own steps
    [m/s] = [m/s] + [m/s]

    Both coarse flows start from the settled one, on cells of twice the size, and take the same time; their difference
    is what the edit changes in a time that the room's own cells cannot afford. In small rooms, or where larger cells do
    not represent the room, all of `edit_s` is spent on the room's own. Faces that the edit closes lose their velocity,
    cells that it opens begin with still air, and a projection makes the flow divergence-free.

    Args:
        state: The flow before, prepared for the same `edit_s`.
        domain: The room after the edit, on the same cells.
        numerics: Those of the flow before.
        edit_s: Time of a solve on the room's own cells that an edit costs [s].
        progress: Called with the fraction done.

    Source: our derivation; the difference of solves on larger cells is the correction of a two-grid method.
    Held by: extensions/formats/tests/unit/test_edited_wind.py, tests/benchmarks/bench_edits.py
    """
    start, own_s = state.own, edit_s
    changed = None if state.coarse is None else _develop_coarse(start, domain, numerics, edit_s)
    if state.coarse is not None and changed is not None:
        start, own_s = _add_change(start, state.coarse, changed), edit_s / 2
    solver = numerics.solver(domain)
    _take_over(start, solver)
    _run(solver, own_s / 2, progress and (lambda fraction: progress(fraction / 2)))
    means: list[FieldMean] = []
    for quarter in (3, 4):
        means.append(FieldMean(domain))
        _run(solver, quarter * own_s / 4, mean=means[-1])
    solver.check()
    for mean in means:
        solver.project_tightly(mean.velocity)
        clear_ghosts(domain, mean.velocity)
    earlier_m_s, velocity_m_s = (solver.centre_velocity(mean.velocity) for mean in means)
    change_m2_s2 = float(np.sum((velocity_m_s - earlier_m_s) ** 2, dtype=np.float64)) / domain.n_air
    speed_m_s = domain.reference_speed_m_s
    return EditedFlow(
        velocity_m_s=velocity_m_s,
        divergence_relative=solver.divergence_m_s(means[-1].velocity) / speed_m_s,
        change_frac=change_m2_s2**0.5 / speed_m_s,
    )


def _run(solver: FlowSolver, end_s: float, progress: Fraction | None = None, *, mean: FieldMean | None = None) -> None:
    while solver.time_s < end_s:
        record = solver.step(until_s=end_s)
        if mean is not None:
            mean.add(solver.velocity, record.dt_s)
        if progress is not None:
            progress(solver.time_s / end_s)


# The flow on cells of twice the size that begins as a flow on the room's own, spread over the latter. None where larger
# cells resolve too little, do not hold an opening, close the air's way, or let the flow diverge.
def _develop_coarse(state: FlowState, domain: Domain, numerics: SolverNumerics, edit_s: float) -> FlowState | None:
    coarse = coarsen_domain(domain) if domain.n_air >= LEAST_CELLS else None
    if coarse is None:
        return None
    solver = numerics.solver(coarse)
    _take_over(_restrict(state, coarse.shape), solver)
    try:
        _run(solver, COARSE_TIMES * edit_s)
        solver.check()
    except FlowError:
        return None
    return FlowState.of(continue_on_fine_cells(solver, domain, numerics))


# Means over the cells, or the open faces, that a cell or face of twice the size covers.
def _restrict(state: FlowState, shape: tuple[int, int, int]) -> FlowState:
    n_air = _sum_blocks(state.air, shape)
    per_cell, per_face = np.float32(1) / np.maximum(n_air, np.float32(1)), np.float32(0.25)
    pressure, k, epsilon = (
        np.multiply(_sum_blocks(values * state.air, shape), per_cell, dtype=np.float32)
        for values in (state.pressure, state.k, state.epsilon)
    )
    u, v, w = (per_face * _sum_blocks(values, shape, axis) for axis, values in enumerate((state.u, state.v, state.w)))
    return FlowState(u=u, v=v, w=w, pressure=pressure, k=k, epsilon=epsilon, air=np.minimum(n_air, np.float32(1)))


# Padded sums over blocks of two cells along each axis; along `face_axis` every second face. Where the number of cells
# is odd, the last ones are continued, as in `coarsen_domain`.
def _sum_blocks(values: F32, shape: tuple[int, int, int], face_axis: int | None = None) -> F32:
    result = padded(shape)
    target: F32 = values[(slice(LOW, -HIGH + 1),) * 3]
    for axis, n in enumerate(shape):
        n_fine = values.shape[axis] - LOW - HIGH
        if axis == face_axis:
            target = np.take(target, np.minimum(2 * np.arange(n + 1), n_fine), axis=axis)
        else:
            first, second = (np.minimum(2 * np.arange(n) + i, n_fine - 1) for i in (0, 1))
            target = np.take(target, first, axis=axis) + np.take(target, second, axis=axis)
    result[tuple(slice(LOW, LOW + n) for n in target.shape)] = target
    return result


# Turbulence changes by a factor, so that it remains above zero.
def _add_change(own: FlowState, before: FlowState, after: FlowState) -> FlowState:
    known = own.air * before.air * after.air
    k, epsilon = (
        values * np.clip(np.where(known > 0, new / np.maximum(old, _LEAST), 1), *FACTORS).astype(np.float32)
        for values, old, new in ((own.k, before.k, after.k), (own.epsilon, before.epsilon, after.epsilon))
    )
    return FlowState(
        u=np.add(own.u, after.u - before.u, dtype=np.float32),
        v=np.add(own.v, after.v - before.v, dtype=np.float32),
        w=np.add(own.w, after.w - before.w, dtype=np.float32),
        pressure=np.add(own.pressure, known * (after.pressure - before.pressure), dtype=np.float32),
        k=k,
        epsilon=epsilon,
        air=own.air,
    )


# Inlets keep the values that the solver has set, and air without a known state its own turbulence.
def _take_over(state: FlowState, solver: FlowSolver) -> None:
    domain = solver.domain
    for axis, (now, before) in enumerate(zip(solver.velocity, (state.u, state.v, state.w))):
        faces = tuple(slice(LOW, -HIGH + (1 if other == axis else 0)) for other in range(3))
        is_open = domain.coefficients[axis][faces] > 0
        now[faces] = np.where(is_open, before[faces], now[faces])
    solver.pressure[:] = np.where(domain.air, state.pressure, np.float32(0))
    if isinstance(solver.model, KEpsilon):
        k, epsilon = solver.model.k.copy(), solver.model.epsilon.copy()
        is_known = (domain.air & (state.air > 0))[_INNER]
        for values, known in ((k, state.k), (epsilon, state.epsilon)):
            values[_INNER] = np.where(is_known, known[_INNER], values[_INNER])
        solver.model.set_turbulence(k, epsilon)
    solver.project_tightly()


# The settled flow of the room before, from the cache or solved.
def _find_state(block: EditedWindSpec, setup: WindSetup, numerics: SolverNumerics) -> SettledFlow:
    environment = _describe_room_before(block, setup.environment)
    room = build_geometry(environment, block)
    if room.grid != setup.room.grid:
        raise _error("wind.before", "a room on the same cells", f"{room.grid}", "Leave size_m as it is.")
    settled = block.model_copy(update={"before": {}})
    name = hashlib.blake2b(f"state {recipe_hash(environment, settled)}".encode(), digest_size=16).hexdigest()
    folder = get_cache_root() / "environments" / name
    mark_used(folder)
    state = _read_state(folder / _STATE_FILE)
    if state is None:
        domain = build_room_domain(room, block)

        def tell(fraction: float) -> None:
            setup.progress("Solving the wind before the edit", fraction)

        own = settle_flow(domain, numerics, settle_s=block.settle_s, progress=tell)
        state = prepare_edits(own, domain, numerics, edit_s=_edit_s(block))
        _save_state(state, folder)
    return state


def _describe_room_before(block: EditedWindSpec, environment: EnvironmentSpec) -> EnvironmentSpec:
    if environment.layout is None:
        raise _error("wind.solver", "environment.layout with edited", "another room", "Take solver: built_in.")
    layout = environment.layout.model_dump(exclude_none=True)
    unknown = sorted(set(block.before) - set(type(environment.layout).model_fields))
    if unknown:
        remedy = "For example before: {obstacles: []}."
        raise _error("wind.before", "keys of environment.layout", ", ".join(unknown), remedy)
    return EnvironmentSpec.model_validate({"layout": layout | block.before})


def _error(where: str, expected: str, found: str, remedy: str) -> EnvironmentDataError:
    return EnvironmentDataError(str(Problem(where=where, expected=expected, found=found, remedy=remedy)))


def _save_state(state: SettledFlow, folder: Path) -> None:
    buffer = io.BytesIO()
    parts = {"own": state.own} | ({} if state.coarse is None else {"coarse": state.coarse})
    arrays = {
        f"{part}_{key.name}": getattr(flow, key.name) for part, flow in parts.items() for key in fields(FlowState)
    }
    np.savez(buffer, **arrays)
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder, _STATE_FILE, buffer.getvalue())
    keep_within_limit()


# None without a file, or with a damaged one: it is then solved anew.
def _read_state(path: Path) -> SettledFlow | None:
    try:
        with path.open("rb") as file, np.load(file) as data:
            own, coarse = (
                FlowState(**{key.name: data[f"{part}_{key.name}"] for key in fields(FlowState)})
                if f"{part}_air" in data
                else None
                for part in ("own", "coarse")
            )
            return None if own is None else SettledFlow(own=own, coarse=coarse)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _edit_s(block: EditedWindSpec) -> float:
    return block.edit_s or EDIT_FRAC * block.settle_s
