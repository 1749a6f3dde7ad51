# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types
"""Heat in the solver: what warm bodies and surfaces give to the air, and checks of their places."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.box_rules import measure_sides_m
from gslcosim.base.errors import FlowError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import ENVIRONMENT
from gslcosim.environment.grid_kernels import find_air_cells
from gslcosim.environment.model import EnvironmentGeometry, Grid, Opening, span_text
from gslcosim.environment.positions import find_point_problems, read_room
from gslcosim.flow.buoyancy import HEAT_M2_S, BuoyantScalar, Release, Surface, find_surface_cells
from gslcosim.flow.pressure import HIGH, LOW
from gslcosim.flow.solve import AIR_NU_M2_S
from gslcosim.scenario.models.scenario import EnvironmentSpec, Scenario
from gslcosim.scenario.models.wind import WindSpec
from gslcosim_formats.heat.keys import AIR, AIR_C, HEAT, HeatSpec

Floats = NDArray[np.float64]
# Warm air at constant pressure, 20 degC: W to K m3/s.
AIR_HEAT_J_M3_K = 1.204 * 1006.0
# 3.6 W/m2K, as walls of rooms have for some kelvins: for the start and the time that layers take to form.
TYPICAL_EXCHANGE_M_S = 0.003
_ZERO_C_K = 273.15


@numba.njit(cache=True, nogil=True)
def exchange_velocity_m_s(excess_k, friction_m_s, upward, length_m, acceleration_m_s2, diffusivity_m2_s, nu_m2_s, out):
    """Write the exchange velocity of surfaces: the heat flux over rho c_p and the excess over the air beside them.

    c = max(c_friction Pr^(-2/3), Nu D / L),   Pr = nu / D,   Ra = g' |dT| L^3 / (nu D)
    Nu = (0.825 + 0.387 Ra^(1/6) / (1 + (0.492 / Pr)^(9/16))^(8/27))^2   at an upright surface
    Nu = 0.15 Ra^(1/3)   at a level one from which air rises or sinks
    Nu = 0.27 Ra^(1/4)   at a level one on or under which it stays
    [m/s] = [m2/s] / [m]

    Args:
        excess_k: (n,) temperature of the surface minus that of the air of each cell, dT [K].
        friction_m_s: (n,) factor of the wall friction of each cell, c_friction [m/s].
        upward: 1 with the air above the surface, -1 below it, 0 beside it.
        length_m: Height of an upright surface, area over perimeter of a level one, L [m].
        acceleration_m_s2: Upward acceleration of air one kelvin warmer, g' [m/s2].
        diffusivity_m2_s: Of heat, D [m2/s].
        nu_m2_s: Viscosity [m2/s].
        out: Written: (n,) c [m/s].

    Source: Churchill and Chu 1975, doi:10.1016/0017-9310(75)90243-4, equation 9 (upright); Lloyd and Moran 1974,
    doi:10.1115/1.3450224 (level, with the length; turbulent), McAdams 1954, Heat Transmission, equation 7-10 (level,
    stable); Chilton and Colburn 1934, doi:10.1021/ie50299a012 (from friction).
    Deviation: The excess is that over the air half a cell away, in place of far away.
    Held by: tests/unit/test_heat.py
    """
    prandtl = nu_m2_s / diffusivity_m2_s
    colburn = 1.0 / elementary.pow(prandtl, 2.0 / 3.0)
    reduced = 0.387 / elementary.pow(1.0 + elementary.pow(0.492 / prandtl, 9.0 / 16.0), 8.0 / 27.0)
    for n in range(excess_k.shape[0]):
        push = acceleration_m_s2 * excess_k[n]
        rayleigh = abs(push) * length_m * length_m * length_m / (nu_m2_s * diffusivity_m2_s)
        third = elementary.cbrt(rayleigh)
        if upward == 0:
            root = 0.825 + reduced * np.sqrt(third)
            nusselt = root * root
        elif push * upward > 0:
            nusselt = 0.15 * third
        else:
            nusselt = 0.27 * np.sqrt(np.sqrt(rayleigh))
        out[n] = max(colburn * friction_m_s[n], nusselt * diffusivity_m2_s / length_m)


def build_heat(environment: EnvironmentSpec, room: EnvironmentGeometry) -> BuoyantScalar:
    """Return the solver's scalar for the heat of a room: kelvins above the air that enters.

    The air starts mixed, at the balance of its heat and the air that enters, and keeps it in all but its layers; in a
    closed room without temperatures, which would become ever warmer, it starts as given.

    T = (sum P / (rho c_p) + sum c A T_surface) / (Q + sum c A)        Q entering air [m3/s], c 0.003 m/s
    [K] = [K m3/s] / [m3/s]

    Coordinates start at the grid's origin.
    """
    given_c = AIR.get(environment)
    air_c = AIR_C if given_c is None else given_c
    releases: list[Release] = []
    surfaces: list[Surface] = []
    gain_k_m3_s, loss_m3_s = 0.0, sum(_find_inflow_m3_s(each, room.grid) for each in room.openings)
    for each in HEAT.get(environment) or ():
        if each.position_m is not None:
            place_m, given_k_m3_s = _from_origin(each.position_m, room.grid), (each.power_w or 0.0) / AIR_HEAT_J_M3_K
            releases.append(Release(position_m=place_m, scalar_m3_s=given_k_m3_s))
            gain_k_m3_s += given_k_m3_s
            continue
        excess_k = None if each.temperature_c is None else each.temperature_c - air_c
        min_m, max_m = _find_corners(each, room.grid)
        surface = build_surface(min_m, max_m, excess_k=excess_k, power_w=each.power_w or 0.0, air_c=air_c)
        surfaces.append(surface)
        gain_k_m3_s += surface.scalar_m3_s
        loss_m3_s += 0.0 if excess_k is None else TYPICAL_EXCHANGE_M_S * _measure_area_m2(min_m, max_m)
    return BuoyantScalar.of_heat(
        air_k=air_c + _ZERO_C_K,
        start=gain_k_m3_s / loss_m3_s if loss_m3_s > 0 else 0.0,
        releases=releases,
        surfaces=surfaces,
    )


def build_surface(
    min_m: Vec3, max_m: Vec3, *, excess_k: float | None = None, power_w: float = 0.0, air_c: float = AIR_C
) -> Surface:
    """Return a warm or cold rectangle, from the grid's origin [m], by its excess over the air or what it gives off."""
    height_m = max_m[2] - min_m[2]
    across = [side_m for side_m in measure_sides_m(min_m, max_m) if side_m > 0]
    acceleration_m_s2 = BuoyantScalar.of_heat(air_k=air_c + _ZERO_C_K).buoyancy_m_s2
    length_m = height_m or across[0] * across[1] / (2 * (across[0] + across[1]))

    def find_exchange_m_s(excess_k: Floats, friction_m_s: Floats, upward: int) -> Floats:
        exchange_m_s = np.empty_like(excess_k)
        exchange_velocity_m_s(
            excess_k, friction_m_s, upward, length_m, acceleration_m_s2, HEAT_M2_S, AIR_NU_M2_S, exchange_m_s
        )
        return exchange_m_s

    given_k_m3_s = power_w / AIR_HEAT_J_M3_K
    if excess_k is not None:
        given_k_m3_s = TYPICAL_EXCHANGE_M_S * _measure_area_m2(min_m, max_m) * excess_k
    return Surface(
        min_m=min_m, max_m=max_m, scalar_m3_s=given_k_m3_s, value=excess_k, find_exchange_m_s=find_exchange_m_s
    )


def _measure_area_m2(min_m: Vec3, max_m: Vec3) -> float:
    a_m, b_m = (side_m for side_m in measure_sides_m(min_m, max_m) if side_m > 0)
    return a_m * b_m


# What an inlet brings; a fan that draws air out brings none.
def _find_inflow_m3_s(opening: Opening, grid: Grid) -> float:
    if opening.kind != "inlet":
        return 0.0
    axis = int(np.argmin(measure_sides_m(opening.min_m, opening.max_m)))
    is_high = 2 * opening.min_m[axis] > grid.origin_m[axis] + grid.max_m[axis]
    inwards_m_s = -opening.velocity_m_s[axis] if is_high else opening.velocity_m_s[axis]
    return max(inwards_m_s, 0.0) * _measure_area_m2(opening.min_m, opening.max_m)


def _from_origin(point_m: Vec3, grid: Grid) -> Vec3:
    x, y, z = (round(p - o, 9) for p, o in zip(point_m, grid.origin_m, strict=True))
    return x, y, z


# Corners from the grid's origin; those of the whole floor where there are none.
def _find_corners(heat: HeatSpec, grid: Grid) -> tuple[Vec3, Vec3]:
    if heat.min_m is not None and heat.max_m is not None:
        return _from_origin(heat.min_m, grid), _from_origin(heat.max_m, grid)
    x_m, y_m, _ = _from_origin(grid.max_m, grid)
    return (0.0, 0.0, 0.0), (x_m, y_m, 0.0)


def find_heat_problems(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return the problems of a scenario's heat: a wind that it cannot drive, bodies and surfaces in no place for them.

    Args:
        scenario: The scenario.
        directory: Its folder, base of relative paths.
    """
    spec, wind, heat = scenario.environment, scenario.wind, HEAT.get(scenario.environment)
    problem = partial(Problem, where=f"{ENVIRONMENT}.heat")
    if heat is None:
        return [
            problem(
                where=f"{ENVIRONMENT}.air_c",
                expected="heat beside it",
                found="none",
                remedy="It is the temperature that those of heat are compared with.",
            )
        ]
    is_solved = wind.solver == "built_in" or (wind.solver == "auto" and spec.folder_key is None)
    if spec.path is not None or not is_solved or not isinstance(wind, WindSpec):
        found = f"{ENVIRONMENT}.path" if spec.path is not None else f"wind.solver: {wind.kind_name}"
        remedy = "Take a layout or geometry with wind.solver: built_in, or leave heat out."
        return [problem(expected="wind that the built-in solver makes", found=found, remedy=remedy)]
    if wind.buoyancy is not None:
        return [problem(expected="no wind.buoyancy beside it", found="both", remedy="One of them drives the wind.")]
    room = read_room(spec, wind, directory)
    return [] if room is None else list(_find_place_problems(heat, room))


def _find_place_problems(heat: Sequence[HeatSpec], room: EnvironmentGeometry) -> Iterator[Problem]:
    air = np.pad(find_air_cells(room.occupancy), (LOW, HIGH))
    for i, each in enumerate(heat):
        where = f"{ENVIRONMENT}.heat[{i}]"
        if each.position_m is not None:
            yield from find_point_problems([(f"{where}.position_m", each.position_m)], room)
            continue
        try:
            find_surface_cells(*_find_corners(each, room.grid), air, room.grid.cell_m)
        except FlowError:
            yield Problem(
                where=where,
                expected="a rectangle on a wall, the floor, the ceiling or an obstacle on the middle of a cell "
                f"of {room.grid.cell_m:g} m",
                found=f"{each.kind} from {span_text(each.min_m or (), each.max_m or ())}",
                remedy=f"The room reaches from {span_text(room.grid.origin_m, room.grid.max_m)}.",
            )
