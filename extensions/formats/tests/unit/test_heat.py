"""Heat of rooms: exchange at surfaces, balance of heat, the wind it drives, turbulence in its layers, and refusals."""

import numpy as np
import pytest
from pydantic import ValidationError

from gslcosim.environment.generation.cache import recipe
from gslcosim.environment.generation.wind import no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.flow import Inlet, Outlet
from gslcosim.flow.buoyancy import Buoyancy, BuoyantScalar, Release
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import HIGH, LOW
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import make_model
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim.scenario.models.wind import WindSpec
from gslcosim_formats.heat.sources import AIR_HEAT_J_M3_K, build_heat, build_surface, exchange_velocity_m_s
from gslcosim_formats.registered_checks import CHECKS

INNER = (slice(LOW, -HIGH),) * 3
LAYOUT = {"kind": "warehouse_empty", "size_m": (3.0, 2.0, 2.0)}
PANE = {"kind": "pane", "min_m": (3, 0.4, 0.4), "max_m": (3, 1.6, 1.6), "temperature_c": 35}
BODY = {"kind": "body", "position_m": (1.5, 1, 0.5), "power_w": 75}


def room(*heat, **more):
    return EnvironmentSpec.model_validate({"layout": LAYOUT, "heat": heat or None, **more})


def solve(spec, **wind):
    wind = WindSpec(cell_m=0.2, inlet_velocity_m_s=(0.1, 0, 0), **wind)
    geometry = build_geometry(spec, wind, scenario_dir=None)
    return solve_wind_of_scenario(geometry, spec, wind, scenario_dir=None, progress=no_progress)


def exchange_m_s(excess_k, upward, *, length_m=1.0, friction_m_s=0.0, acceleration=0.0335, d=2.1e-5, nu=1.5e-5):
    out = np.empty(1)
    exchange_velocity_m_s(np.array([excess_k]), np.array([friction_m_s]), upward, length_m, acceleration, d, nu, out)
    return out[0]


def test_an_upright_plate_exchanges_as_a_textbook_has_it():
    """Incropera and DeWitt, example 9.2: a glass door 0.71 m high, Pr = 0.69, Ra = 1.813e9, Nu = 147."""
    diffusivity_m2_s, nu_m2_s = 38.3e-6, 26.4e-6
    push = 1.813e9 * nu_m2_s * diffusivity_m2_s / 0.71**3
    exchange = exchange_m_s(1.0, 0, length_m=0.71, acceleration=push, d=diffusivity_m2_s, nu=nu_m2_s)
    assert exchange * 0.71 / diffusivity_m2_s == pytest.approx(147, rel=0.01)


def test_a_level_surface_exchanges_more_where_air_moves_away_from_it():
    warm_floor, cold_floor = exchange_m_s(5.0, 1), exchange_m_s(-5.0, 1)
    assert warm_floor > 2 * cold_floor
    assert exchange_m_s(-5.0, -1) == warm_floor
    assert exchange_m_s(5.0, -1) == cold_floor
    # 1.52 dT^(1/3) W/m2K in ASHRAE's handbook.
    assert warm_floor * AIR_HEAT_J_M3_K == pytest.approx(1.52 * 5 ** (1 / 3), rel=0.2)


def test_wind_along_a_surface_takes_more_than_natural_convection():
    assert exchange_m_s(1.0, 0, friction_m_s=0.02) == pytest.approx(0.02 * (1.5 / 2.1) ** (-2 / 3))


def test_in_a_ventilated_room_the_heat_that_enters_leaves_with_the_air():
    patches = [
        Inlet(min_m=(0, 0.4, 0.0), max_m=(0, 0.8, 0.4), velocity_m_s=(0.3, 0, 0)),
        Outlet(min_m=(1.6, 0.4, 0.8), max_m=(1.6, 0.8, 1.2)),
    ]
    domain = build_domain(np.ones((16, 12, 12), bool), 0.1, patches)
    floor = build_surface((0.4, 0.2, 0.0), (1.2, 1.0, 0.0), power_w=100.0)
    body = Release(position_m=(0.8, 0.6, 0.5), scalar_m3_s=50.0 / AIR_HEAT_J_M3_K)
    heat = BuoyantScalar.of_heat(releases=[body], surfaces=[floor], start=2.0)
    buoyancy = Buoyancy(domain, heat)
    solver = FlowSolver(domain, make_model("k_epsilon", domain, 1.5e-5), buoyancy=buoyancy)
    outlet, leaving_k_m3_s, seen_s = domain.outlets[0], 0.0, 0.0
    while solver.time_s < 500.0:
        record = solver.step(until_s=500.0)
        if solver.time_s > 250.0:
            speed = solver.velocity[0][outlet.layer(outlet.face)]
            leaving_k_m3_s += record.dt_s * float((speed * buoyancy.values[outlet.layer(outlet.inside)]).sum()) * 0.01
            seen_s += record.dt_s
    assert leaving_k_m3_s / seen_s * AIR_HEAT_J_M3_K == pytest.approx(150.0, rel=0.03)


@pytest.mark.slow
def test_air_rises_at_a_warm_pane_and_sinks_elsewhere():
    report = solve(room(PANE), end_time_s=60).report
    rising_m_s = report.velocity_m_s[..., 2]
    assert rising_m_s[-1, 3:7, 6].mean() > 0.05
    assert rising_m_s[:10].mean() < 0
    assert report.scalar_by_height[-1] > report.scalar_by_height[0] > 0


@pytest.mark.slow
def test_heat_of_no_excess_leaves_the_wind_as_it_was_to_the_bit():
    neutral = {**PANE, "temperature_c": 20}
    np.testing.assert_array_equal(
        solve(room(neutral), end_time_s=10).report.velocity_m_s, solve(room(), end_time_s=10).report.velocity_m_s
    )


def test_a_room_without_heat_is_made_from_what_it_was():
    made_from = recipe(room(), WindSpec())
    assert not {"heat", "air_c"} & made_from.keys()
    assert recipe(room(BODY), WindSpec())["heat"][0]["power_w"] == 75


@pytest.mark.slow
def test_a_warm_ceiling_damps_the_turbulence_that_gas_feels():
    warm = {"kind": "surface", "min_m": (0, 0, 2), "max_m": (3, 2, 2), "temperature_c": 40}
    neutral, stable = (solve(each, end_time_s=60, keep_turbulence=True).report for each in (room(), room(warm)))
    assert stable.k_m2_s2[:, :, 5:].mean() < 0.7 * neutral.k_m2_s2[:, :, 5:].mean()


@pytest.mark.slow
def test_a_heated_room_settles_by_itself_and_says_how_warm_it_is():
    made = solve(room(BODY))
    assert made.report.settling.has_settled
    assert made.report.scalar_by_height[-1] > made.report.scalar_by_height[0] > 0
    assert any(notice.startswith("Heat: at the end the air is") for notice in made.notices)


def test_the_whole_floor_is_warm_where_it_has_no_corners():
    spec = room({"kind": "floor", "temperature_c": 26}, air_c=19)
    geometry = build_geometry(spec, WindSpec(), scenario_dir=None)
    floor = build_heat(spec, geometry).surfaces[0]
    assert (floor.min_m, floor.max_m, floor.value) == ((0, 0, 0), (3, 2, 0), 7)


@pytest.mark.parametrize(
    ("heat", "reason"),
    [
        ({**BODY, "power_w": None}, "exactly one of power_w, other than 0, and temperature_c, was neither"),
        ({**PANE, "power_w": 10}, "was power_w and temperature_c"),
        ({**BODY, "power_w": 0}, "was power_w: 0"),
        ({**BODY, "power_w": None, "temperature_c": 30}, "expected power_w with kind: body, was temperature_c"),
        ({**PANE, "min_m": None}, "expected min_m and max_m with kind: pane, and no other place, was max_m"),
        ({**BODY, "min_m": (0, 0, 0)}, "expected position_m with kind: body"),
        ({**PANE, "max_m": (3, 0.4, 1.6)}, "one number equal to that of min_m"),
        ({**PANE, "kind": "floor"}, "a level rectangle with kind: floor"),
        ({**PANE, "min_m": (0, 0, 0), "max_m": (1, 1, 0)}, "an upright rectangle with kind: pane"),
    ],
)
def test_heat_that_means_nothing_is_refused(heat, reason):
    with pytest.raises(ValidationError, match=reason):
        room(heat)


SCENARIO = """
schema: gslcosim/scenario/1
name: warm
environment:
  {environment}
wind: {wind}
gas: {{sources: [{{position_m: [1, 1, 1]}}]}}
agents:
  - {{name: dog, start: {{python: sweep}}, vehicle: {{start_m: [1, 1, 0.2]}}, sensors: [{{name: pid, model: pid}}]}}
"""
HALL = "layout: {kind: warehouse_empty, size_m: [3, 4, 3]}"


@pytest.mark.parametrize(
    ("heat", "wind", "reason"),
    [
        ("heat: [{kind: body, position_m: [1, 1, 1], power_w: 9}]", "{solver: uniform}", "built-in solver makes"),
        ("heat: [{kind: body, position_m: [9, 1, 1], power_w: 9}]", "{}", "outside the room"),
        ("heat: [{kind: surface, min_m: [1, 1, 1], max_m: [2, 2, 1], power_w: 9}]", "{}", "expected a rectangle on a"),
        ("heat: [{kind: floor, min_m: [1, 1, 0], max_m: [1.1, 1.05, 0], power_w: 9}]", "{}", "of a cell of 0.2 m"),
        (
            "heat: [{kind: floor, power_w: 9}]",
            "{end_time_s: 9, buoyancy: {releases: [{position_m: [1, 1, 1], flow_m3_s: 0.001}]}}",
            "no wind.buoyancy beside it",
        ),
        ("air_c: 21", "{}", "air_c: expected heat beside it"),
    ],
)
def test_heat_in_no_place_for_it_is_refused(tmp_path, heat, wind, reason):
    path = tmp_path / "warm.yaml"
    path.write_text(SCENARIO.format(environment=f"{HALL}\n  {heat}", wind=wind))
    loaded = load_scenario(str(path))
    check = next(check for check in CHECKS if check.name == "heat")
    problems = list(check.find(loaded.scenario, loaded.directory))
    assert len(problems) == 1
    assert reason in str(problems[0])
    assert problems[0].remedy
