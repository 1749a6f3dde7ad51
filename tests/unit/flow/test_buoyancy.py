"""Buoyancy: flow through small holes, budgets of what is released, turbulence in layers, and refusals."""

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Outlet, SlipWall, turbulence
from gslcosim.flow.buoyancy import (
    AIR_KG_M3,
    ENTRAINMENT,
    GRAVITY_M_S2,
    Buoyancy,
    BuoyantScalar,
    Orifice,
    Release,
    flows_through_holes,
    rise_of_plume,
)
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import HIGH, LOW, padded
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import make_model

INNER = (slice(LOW, -HIGH),) * 3
CELL_M = 0.1
HELIUM_KG_M3 = 0.166


def box(shape=(6, 6, 6), patches=(), **options):
    return build_domain(np.ones(shape, bool), CELL_M, patches, needs_openings=False, **options)


def test_one_hole_in_mixed_air_lets_out_what_is_released():
    outward = np.empty(4)
    flows_through_holes(np.zeros(4), np.full(4, 0.3), np.full(4, 1e-4), 0.14, 2e-4, outward)
    assert outward == pytest.approx(5e-5)


def test_two_holes_of_a_light_room_drain_it_as_published():
    """Upper and lower hole A, C: A C (g' H / 2)^(1/2) where the density is that of air but for the weight."""
    height_m, area_m2, lightness_m_s2 = 0.7, 4e-4, 0.5
    outward = np.empty(2)
    head = np.array([0.0, lightness_m_s2 * height_m])
    flows_through_holes(head, np.ones(2), np.full(2, area_m2), 1.0, 0.0, outward)
    expected = area_m2 * (lightness_m_s2 * height_m) ** 0.5
    assert outward == pytest.approx([-expected, expected], rel=1e-6)


def test_light_gas_leaves_through_a_hole_faster_than_air_comes_in():
    outward = np.empty(2)
    flows_through_holes(np.zeros(2), np.full(2, 0.9), np.full(2, 1e-4), 0.14, 1e-4, outward)
    dense = outward.copy()
    assert dense == pytest.approx(5e-5)
    flows_through_holes(np.array([0.0, 0.4]), np.full(2, 0.9), np.full(2, 1e-4), 0.14, 0.0, outward)
    assert outward.sum() == pytest.approx(0.0, abs=1e-9)
    assert outward[0] < 0 < outward[1]


def release_helium(*, turbulence_model="k_epsilon", until_s=20.0, **options):
    domain = box(**options)
    rate_m3_s = 2e-4
    gas = BuoyantScalar.of_gas(
        HELIUM_KG_M3,
        7e-5,
        releases=[Release(position_m=(0.35, 0.35, 0.15), scalar_m3_s=rate_m3_s, volume_m3_s=rate_m3_s)],
        orifices=[Orifice(centre_m=(0.0, 0.3, 0.05), height_m=0.02, area_m2=4e-4)],
    )
    buoyancy = Buoyancy(domain, gas)
    solver = FlowSolver(domain, make_model(turbulence_model, domain, 1.5e-5), buoyancy=buoyancy)
    while solver.time_s < until_s:
        solver.step(until_s=until_s)
    return solver, buoyancy, rate_m3_s


def test_all_that_is_released_is_in_the_box_or_has_left_by_the_hole():
    solver, buoyancy, rate_m3_s = release_helium()
    inside_m3 = float(buoyancy.values[INNER].sum(dtype=np.float64)) * CELL_M**3
    assert 0 < buoyancy.escaped_m3 < 0.1 * inside_m3
    assert inside_m3 + buoyancy.escaped_m3 == pytest.approx(rate_m3_s * solver.time_s, rel=2e-3)
    assert buoyancy.outflow_m3_s.sum() - buoyancy.inflow_m3_s.sum() == pytest.approx(rate_m3_s, rel=1e-6)
    assert buoyancy.values[INNER].min() > -1e-3


def test_light_gas_gathers_under_the_ceiling():
    _, buoyancy, _ = release_helium()
    column = buoyancy.column_mean()
    assert column[-1] > 1.5 * column[0]
    assert (np.diff(column) > -1e-3).all()


def test_a_shut_release_lets_air_in_for_what_goes_out():
    solver, buoyancy, _ = release_helium()
    buoyancy.set_releasing(is_on=False)
    solver.step(until_s=solver.time_s + 5.0)
    solver.step(until_s=solver.time_s + 5.0)
    assert buoyancy.outflow_m3_s.sum() == pytest.approx(buoyancy.inflow_m3_s.sum(), rel=1e-4)


@pytest.mark.parametrize(("stable", "grows"), [(True, False), (False, True)])
def test_stable_layers_damp_turbulence_and_unstable_ones_feed_it(stable, grows):
    shape, nu_m2_s = (3, 3, 3), 1.5e-5
    energy, dissipation, nu = (np.full_like(padded(shape), value) for value in (0.01, 0.001, 0.01))
    layers = np.full_like(nu, 1.0 if stable else -1.0)
    k, e = energy.copy(), dissipation.copy()
    turbulence.buoyancy_production(energy, dissipation, nu, nu_m2_s, layers, 0.7, np.float32(1.44), 0.1, k, e)
    production = -0.1 * (0.01 - nu_m2_s) / 0.7 * layers
    expected = energy + production if grows else energy / (1 - production / energy)
    assert k[INNER] == pytest.approx(expected[INNER], rel=1e-4)
    assert bool((e > dissipation)[INNER].all()) == grows


def test_still_air_of_one_density_stays_still():
    domain = box(shape=(5, 4, 6), patches=[SlipWall(min_m=(0, 0, 0), max_m=(0.5, 0, 0.6))])
    buoyancy = Buoyancy(domain, BuoyantScalar.of_gas(HELIUM_KG_M3, 7e-5, start=0.3))
    solver = FlowSolver(domain, make_model("laminar", domain, 1.5e-5), buoyancy=buoyancy)
    for _ in range(20):
        solver.step(until_s=10.0)
    assert np.abs(solver.centre_velocity()).max() < 1e-3
    assert buoyancy.values[INNER] == pytest.approx(0.3, abs=1e-4)


def test_the_lightness_of_a_gas_and_of_warm_air():
    assert BuoyantScalar.of_gas(AIR_KG_M3, 1e-5).buoyancy_m_s2 == 0
    assert BuoyantScalar.of_gas(HELIUM_KG_M3, 1e-5).buoyancy_m_s2 == pytest.approx(0.862 * GRAVITY_M_S2, rel=1e-3)
    assert BuoyantScalar.of_heat(air_k=300.0).buoyancy_m_s2 == pytest.approx(GRAVITY_M_S2 / 300)


HOLE = Orifice(centre_m=(0, 0.3, 0.3), height_m=0.02, area_m2=4e-4)
LEAK = Release(position_m=(0.3, 0.3, 0.3), scalar_m3_s=1e-4, volume_m3_s=1e-4)


@pytest.mark.parametrize(
    ("options", "patches", "message"),
    [
        ({"releases": [LEAK]}, (), "0.0001 m3/s cannot leave a closed box; add an Orifice or an Outlet"),
        ({"orifices": [HOLE]}, [Outlet(min_m=(0, 0, 0), max_m=(0, 0.6, 0.6))], "a box without inlet and outlet"),
        ({"releases": [Release(position_m=(0.3, 7, 0.3), scalar_m3_s=1.0)]}, (), "release at .*three coordinates in"),
    ],
)
def test_what_cannot_be_is_refused(options, patches, message):
    with pytest.raises(FlowError, match=message):
        Buoyancy(box(patches=patches), BuoyantScalar.of_gas(HELIUM_KG_M3, 7e-5, **options))


def test_a_density_in_other_units_is_refused():
    with pytest.raises(FlowError, match="density_kg_m3: expected a density of a gas"):
        BuoyantScalar.of_gas(166.0, 7e-5)


def test_a_plume_from_a_point_has_the_published_volume():
    """Q = C B^(1/3) z^(5/3) with C = (6 alpha / 5) (9 alpha / 10)^(1/3) pi^(2/3), Morton, Taylor and Turner 1956."""
    acceleration_m_s2, released_m3_s, height_m, n = 8.45, 1e-6, 1.0, 100
    entrained = np.empty(n)
    top, volume_m3_s, scalar_m3_s = rise_of_plume(
        np.zeros(n), height_m / n, height_m / n, released_m3_s, released_m3_s, 1e-10, acceleration_m_s2, 10.0, entrained
    )
    constant = (6 * ENTRAINMENT / 5) * (9 * ENTRAINMENT / 10) ** (1 / 3) * np.pi ** (2 / 3)
    expected = constant * (acceleration_m_s2 * released_m3_s) ** (1 / 3) * height_m ** (5 / 3)
    assert top == n - 1
    assert volume_m3_s == pytest.approx(expected, rel=0.03)
    assert scalar_m3_s == pytest.approx(released_m3_s)
    assert entrained.sum() == pytest.approx(volume_m3_s - released_m3_s)


def test_a_plume_ends_where_it_is_no_longer_light_or_is_wide():
    ambient = np.where(np.arange(20) < 10, 0.0, 0.9)
    ends = rise_of_plume(ambient, 0.05, 0.05, 1e-4, 1e-4, 1e-5, 8.45, 10.0, np.empty(20))[0]
    assert 10 <= ends < 19
    assert rise_of_plume(np.zeros(20), 0.05, 0.05, 1e-4, 1e-4, 1e-5, 8.45, 0.15, np.empty(20))[0] < 19


def test_a_plume_narrower_than_cells_keeps_the_budget():
    domain = box()
    leak = Release(position_m=(0.35, 0.35, 0.15), scalar_m3_s=2e-4, volume_m3_s=2e-4, area_m2=1e-3)
    hole = Orifice(centre_m=(0.0, 0.3, 0.05), height_m=0.02, area_m2=4e-4)
    buoyancy = Buoyancy(domain, BuoyantScalar.of_gas(HELIUM_KG_M3, 7e-5, releases=[leak], orifices=[hole]))
    solver = FlowSolver(domain, make_model("k_epsilon", domain, 1.5e-5), buoyancy=buoyancy)
    while solver.time_s < 20.0:
        solver.step(until_s=20.0)
    inside_m3 = float(buoyancy.values[INNER].sum(dtype=np.float64)) * CELL_M**3
    assert inside_m3 + buoyancy.escaped_m3 == pytest.approx(2e-4 * 20.0, rel=2e-3)
    assert (np.diff(buoyancy.column_mean()) > -1e-3).all()
