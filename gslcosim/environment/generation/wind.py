"""Wind of an environment, from the source that the scenario names."""

import logging
import warnings
from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim import flow
from gslcosim.base.errors import EnvironmentDataError, FlowError, ScenarioError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import find_air_cells
from gslcosim.environment.model import Cell, EnvironmentGeometry, Grid, Opening, WindFrames
from gslcosim.environment.readers import FOREIGN_WINDS, Progress, find_heat_builder, find_room_reader, find_wind_source
from gslcosim.environment.readers import WindSetup as WindSetup
from gslcosim.flow.buoyancy import BuoyantScalar, Orifice, Release
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim.scenario.models.wind import SolverSpec, WindSpec

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class SolvedWind:
    """Wind of a room, with the report of the built-in solver where that has solved it."""

    frames: WindFrames
    report: flow.WindReport | None = None
    notices: tuple[str, ...] = ()


def no_progress(_text: str, _fraction: float) -> None:
    """Discard a report of progress."""


@singledispatch
def solve_block_wind(block: SolverSpec, setup: WindSetup) -> SolvedWind:
    """Return the wind of a solver's block in a room; a package with a solver registers its builder by block type."""
    del setup
    raise ScenarioError(
        f"wind.solver: expected a builder for {type(block).__name__}, was none. "
        f"The package of {block.kind_name} has to register it with wind_of_block."
    )


def solve_wind_of_scenario(
    room: EnvironmentGeometry, spec: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None, progress: Progress
) -> SolvedWind:
    """Return the wind in a room.

    Args:
        room: Geometry, occupancy and openings.
        spec: Origin of the room; it may bring its wind.
        wind: The scenario's wind block.
        scenario_dir: Base folder of relative paths.
        progress: Receives the current step and its fraction done, from 0 to 1.
    """
    setup = WindSetup(room=room, environment=spec, scenario_dir=scenario_dir, progress=progress)
    made = solve_block_wind(wind, setup)
    expected, found = (*room.grid.shape, 3), made.frames.velocity_m_s.shape[1:]
    if found != expected:
        raise FlowError(f"wind.solver: {wind.kind_name}: expected frames of the shape {expected}, was {found}.")
    return made


@solve_block_wind.register
def _own_wind(wind: WindSpec, setup: WindSetup) -> SolvedWind:
    room, folder_key = setup.room, setup.environment.folder_key
    if wind.solver == "uniform":
        velocity_m_s = np.zeros((1, *room.grid.shape, 3), dtype=np.float32)
        velocity_m_s[0, room.occupancy != Cell.SOLID] = wind.inlet_velocity_m_s
        return SolvedWind(frames=WindFrames(velocity_m_s=velocity_m_s))
    if wind.kind_name in FOREIGN_WINDS or (folder_key is not None and wind.solver in ("auto", "stored")):
        stored = read_stored_wind(wind, setup)
        if stored is not None:
            return stored
    if wind.solver == "stored":
        raise EnvironmentDataError(
            "wind.solver: expected an environment that brings its wind, was one without. "
            "Take built_in to solve it, or solver: {file: PATH}."
        )
    return _solved(room, wind, setup)


def build_patches(room: EnvironmentGeometry, wind: WindSpec) -> tuple[flow.Patch, ...]:
    """Return the solvers' patches of a room's openings, with the scenario's profile and schedule at the inlets.

    Coordinates start at the grid's origin.
    """
    # A room with small holes has no other openings; gas would leave through those of the layout.
    if wind.buoyancy is not None and wind.buoyancy.orifices:
        return ()
    return tuple(_patch_of(opening, room.grid, wind) for opening in room.openings)


def build_buoyancy(room: EnvironmentGeometry, wind: WindSpec, spec: EnvironmentSpec) -> BuoyantScalar | None:
    """Return the solver's scalar for the gas or heat that drives a room's wind; None without.

    Coordinates start at the grid's origin.
    """
    grid, gas = room.grid, wind.buoyancy
    if (build_heat := find_heat_builder(spec)) is not None:
        return build_heat(spec, room)
    if gas is None:
        return None
    releases = [
        Release(
            position_m=_from_origin(each.position_m, grid),
            scalar_m3_s=each.flow_m3_s,
            volume_m3_s=each.flow_m3_s,
            area_m2=each.opening_m2,
        )
        for each in gas.releases
    ]
    orifices = [
        Orifice(centre_m=_from_origin(each.centre_m, grid), height_m=each.height_m, area_m2=each.area_m2)
        for each in gas.orifices
    ]
    return BuoyantScalar.of_gas(gas.density_kg_m3, gas.diffusivity_m2_s, releases=releases, orifices=orifices)


def _patch_of(opening: Opening, grid: Grid, wind: WindSpec) -> flow.Patch:
    min_m, max_m = _from_origin(opening.min_m, grid), _from_origin(opening.max_m, grid)
    if opening.kind != "inlet":
        return (flow.Open if opening.kind == "open" else flow.Outlet)(min_m=min_m, max_m=max_m)
    velocity_m_s = _parabolic(opening, grid) if wind.inlet_profile == "parabolic" else opening.velocity_m_s
    factor = None
    if (schedule := wind.inlet_schedule) is not None:
        factor = flow.Schedule(times_s=schedule.times_s, values=schedule.shares, is_repeating=schedule.repeats)
    return flow.Inlet(min_m=min_m, max_m=max_m, velocity_m_s=velocity_m_s, factor=factor)


# Along both sides of the opening; its mean over the opening's cells is the opening's velocity.
def _parabolic(opening: Opening, grid: Grid) -> NDArray[np.float64]:
    sides_m = [high - low for low, high in zip(opening.min_m, opening.max_m, strict=True)]
    places = [(np.arange(n := round(side_m / grid.cell_m)) + 0.5) / n for side_m in sides_m if side_m > 0]
    bulge = np.multiply.outer(*(place * (1.0 - place) for place in places))
    return np.multiply.outer(bulge / bulge.mean(), np.asarray(opening.velocity_m_s))


def _from_origin(point_m: Vec3, grid: Grid) -> Vec3:
    x, y, z = (round(p - o, 9) for p, o in zip(point_m, grid.origin_m, strict=True))
    return x, y, z


def read_stored_wind(wind: WindSpec, setup: WindSetup) -> SolvedWind | None:
    """Return the wind that an extension reads or solves, or that the environment's folder brings; None without one.

    Warnings about gaps in it become notices, which stay with the environment's folder.

    Args:
        wind: The scenario's wind block.
        setup: The room that it has to fit, and the room's origin.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if wind.kind_name in FOREIGN_WINDS:
            frames = find_wind_source(wind.kind_name)(wind, setup)
        else:
            setup.progress("Reading the wind", 0.0)
            read_wind = find_room_reader(setup.environment).read_wind
            frames = None if read_wind is None else read_wind(setup.environment, wind, setup.scenario_dir)
    if frames is None:
        return None
    notices = tuple(str(warning.message) for warning in caught)
    for notice in notices:
        _log.warning(notice)
    return SolvedWind(frames=frames, notices=notices)


def _solved(room: EnvironmentGeometry, wind: WindSpec, setup: WindSetup) -> SolvedWind:
    report = flow.solve_wind_report(
        find_air_cells(room.occupancy),
        room.grid.cell_m,
        build_patches(room, wind),
        end_time_s=wind.end_time_s,
        average_from_s=wind.average_from_s,
        turbulence=wind.turbulence,
        courant=wind.courant,
        progress=lambda fraction: setup.progress("Solving the wind", fraction),
        buoyancy=build_buoyancy(room, wind, setup.environment),
        max_time_s=wind.max_time_s,
        max_step_s=wind.max_step_s,
        save_every_s=wind.save_every_s,
        save_from_s=wind.save_from_s,
    )
    notices = () if report.settling is None else (f"The wind has {report.settling}.",)
    if wind.buoyancy is None and report.scalar_by_height is not None:
        low_k, high_k = report.scalar_by_height[[0, -1]].tolist()
        notices += (
            f"Heat: at the end the air is {low_k:.2g} K warmer at the floor and {high_k:.2g} K at the ceiling than the "
            f"air that enters.",
        )
    return SolvedWind(frames=_frames_of(report, room, wind), report=report, notices=notices)


def _frames_of(report: flow.WindReport, room: EnvironmentGeometry, wind: WindSpec) -> WindFrames:
    k_epsilon = None
    if wind.keep_turbulence and report.k_m2_s2 is not None and report.epsilon_m2_s3 is not None:
        k_epsilon = np.stack([report.k_m2_s2, report.epsilon_m2_s3], axis=-1)
        k_epsilon[room.occupancy == Cell.SOLID] = 0
    if report.frames_m_s is None or wind.save_every_s is None:
        velocity_m_s = _still_in_solids(report.velocity_m_s[np.newaxis], room)
        return WindFrames(velocity_m_s=velocity_m_s, k_epsilon=k_epsilon)
    return WindFrames(
        velocity_m_s=_still_in_solids(report.frames_m_s, room),
        period_s=wind.save_every_s,
        is_looping=wind.loops,
        k_epsilon=k_epsilon,
    )


# In place: the solver has air in cells that an opening encloses, but they are solid in the room.
def _still_in_solids(frames_m_s: NDArray[np.float32], room: EnvironmentGeometry) -> NDArray[np.float32]:
    frames_m_s[:, room.occupancy == Cell.SOLID] = 0
    return frames_m_s
