import math

import numpy as np
import pytest

from gslcosim_search.swarms.fluxotaxis import (
    OutflowRule,
    RingFlow,
    divergence_slope,
    flux_divergence,
    inflow_direction,
    lattice_forces,
    relaxed_lattice,
    ring_flow,
)
from gslcosim_search.swarms.formations import hexagon, ring

STRENGTH = 3.7


def source_flux(places, source):
    """The flux of a steady source in two dimensions: its strength goes through every circle around it."""
    away = places - np.asarray(source)
    return STRENGTH * away / (2.0 * math.pi * np.sum(away**2, axis=1, keepdims=True))


@pytest.mark.parametrize("n", [3, 4, 6, 9])
def test_through_a_ring_around_a_source_flows_its_strength(n):
    places = ring(n, 0.8, first_rad=0.3) + np.array((4.0, 5.0))
    flow = ring_flow(places, source_flux(places, (4.0, 5.0)))
    assert flow.net == pytest.approx(STRENGTH)
    assert flow.inward == 0.0
    assert flow.released_frac == pytest.approx(1.0)


def test_through_a_ring_beside_a_source_flows_nothing_net():
    places = ring(60, 1.0)
    for source in [(1.5, 0.0), (-3.0, 4.0)]:
        assert ring_flow(places, source_flux(places, source)).net == pytest.approx(0.0, abs=1e-3 * STRENGTH)


@pytest.mark.parametrize("n", [3, 5, 6])
def test_a_linear_flux_gives_its_divergence_times_the_area_of_the_circle(n):
    places = ring(n, 0.7, first_rad=0.4) + np.array((2.0, 1.0))
    flux = places @ np.array([[0.3, -2.0], [1.0, 0.5]]) + np.array((5.0, -4.0))
    assert ring_flow(places, flux).net == pytest.approx((0.3 + 0.5) * math.pi * 0.7**2)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_through_fewer_than_three_robots_flows_nothing(n):
    assert ring_flow(np.eye(2)[:n], np.ones((n, 2))) == RingFlow(inward=0.0, outward=0.0)


def test_the_divergence_of_a_linear_flux_is_exact_at_every_robot():
    places = hexagon(1.0)
    flux = places @ np.array([[0.3, -2.0], [1.0, 0.5]]) + np.array((5.0, -4.0))
    assert flux_divergence(places, flux, 1.2) == pytest.approx(0.8)


def test_the_slope_of_the_divergence_points_to_the_source():
    places = hexagon(0.5) + np.array((1.0, 0.4))
    # A wide source: gas is released with a Gaussian density, and flows outward.
    away2 = np.sum(places**2, axis=1, keepdims=True)
    flux = places * (1.0 - np.exp(-away2)) / away2
    slope = divergence_slope(places, flux, 0.6)
    assert slope.gradient_per_m is not None
    gradient = np.array(slope.gradient_per_m)
    assert gradient @ (-1.0, -0.4) / np.linalg.norm(gradient) == pytest.approx(math.hypot(1.0, 0.4), rel=0.05)


def test_where_all_are_neighbours_there_is_one_divergence_and_no_slope():
    places = ring(3, 1.0)
    slope = divergence_slope(places, source_flux(places, (0.2, 0.1)), 2.0)
    assert slope.gradient_per_m is None
    assert slope.problem


@pytest.mark.parametrize("n_missing", [0, 1, 3])
def test_a_hexagon_is_at_rest_with_or_without_some_of_its_robots(n_missing):
    assert lattice_forces(hexagon(0.9)[n_missing:], 0.9, soft_m=0.2) == pytest.approx(0.0, abs=1e-12)


def test_forces_cancel_over_the_lattice_push_when_near_and_pull_when_far():
    places = np.random.default_rng(3).uniform(0.0, 2.0, (6, 2))
    assert lattice_forces(places, 0.8, soft_m=0.2).sum(axis=0) == pytest.approx(0.0, abs=1e-9)
    near, far, beyond = (lattice_forces(np.array([[0.0, 0.0], [x, 0.0]]), 1.0, soft_m=0.1)[1] for x in (0.7, 1.3, 1.6))
    assert near[0] > 0.0 > far[0]
    assert beyond == pytest.approx(0.0)


def test_a_disturbed_hexagon_closes_again_and_its_middle_stays():
    disturbed = hexagon(1.0) + np.random.default_rng(4).normal(0.0, 0.12, (7, 2)) + np.array((5.0, 5.0))
    relaxed = relaxed_lattice(disturbed, 1.0, n_steps=300)
    assert relaxed.mean(axis=0) == pytest.approx(disturbed.mean(axis=0))
    apart = np.hypot(*(relaxed[None] - relaxed[:, None]).transpose(2, 0, 1))
    sides = apart[(apart > 0.0) & (apart < 1.5)]
    assert sides == pytest.approx(1.0, abs=0.02)
    assert len(sides) == 24


def rule():
    return OutflowRule(least_frac=0.5, least_flow=0.1, n_rounds=3)


def test_three_rounds_of_outflow_running_are_a_declaration():
    held = rule()
    flow = RingFlow(inward=0.2, outward=1.0)
    assert held.declared(flow, np.array([1.0, 2.0])) is None
    assert held.declared(flow, np.array([1.2, 2.0])) is None
    assert held.declared(flow, np.array([1.4, 2.3])) == ((pytest.approx(1.2), pytest.approx(2.1)), pytest.approx(0.8))


@pytest.mark.parametrize("flow", [RingFlow(inward=0.6, outward=1.0), RingFlow(inward=0.0, outward=0.05)])
def test_a_round_of_throughflow_or_of_almost_nothing_begins_again(flow):
    held = rule()
    good, place = RingFlow(inward=0.0, outward=1.0), np.zeros(2)
    for each in (good, good, flow, good, good):
        assert held.declared(each, place) is None


def test_the_rule_holds_from_the_first_round_of_outflow_until_it_is_sure_or_refuted():
    held, good, place = rule(), RingFlow(inward=0.0, outward=1.0), np.zeros(2)
    holding = [held.is_holding]
    for flow in (good, RingFlow(inward=1.0, outward=1.0), good, good, good, good):
        held.declared(flow, place)
        holding.append(held.is_holding)
    assert holding == [False, True, False, True, True, True, False]


def test_gas_comes_from_up_the_wind_and_from_where_there_is_most():
    places = ring(4, 1.0)
    wind = np.tile((-1.0, 0.0), (4, 1))
    assert inflow_direction(places, wind) == pytest.approx([1.0, 0.0])
    towards = inflow_direction(ring(8, 1.0), np.linspace(0.0, 1.0, 8)[:, None] * np.tile((-1.0, 0.0), (8, 1)))
    # Robots to the right of the wind's origin have more gas; they are the last of the ring.
    assert towards[0] > 0.0 > towards[1]


def test_without_inflow_there_is_no_direction():
    assert inflow_direction(ring(4, 1.0), np.zeros((4, 2))) is None
    assert inflow_direction(np.zeros((1, 2)), np.ones((1, 2))) is None
    assert inflow_direction(ring(4, 1.0), ring(4, 1.0)) is None
