"""Farrell's open field: gusts, the wind that they stir, and the filaments in it."""

import numpy as np
import pytest

from gslcosim.environment.model import Cell, Grid
from gslcosim.scenario.loader import load_scenario
from gslcosim_formats.farrell import (
    FarrellWind,
    Gusts,
    advance_wind_inplace,
    exact_gust_step,
    find_gust_warnings,
    open_sides_and_top,
    set_edges_inplace,
    stable_step_s,
    wind_in_cells,
)

GUSTS = Gusts(std_m_s=0.5, period_s=30.0, damping=0.1)
GRID = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(30, 20, 12))


def wind_of(seed=1, **more):
    wind = FarrellWind(
        GRID, **{"mean_m_s": (1.0, 0.2, 0.0), "gusts": GUSTS, "viscosity_m2_s": 10.0, "n_nodes": 11, **more}
    )
    wind.reset(seed)
    return wind


def covariance_after(n_steps, dt_s):
    """Covariance of the oscillator's state after steps from rest."""
    transition, spread = exact_gust_step(GUSTS, dt_s)
    covariance = np.zeros((2, 2))
    for _ in range(n_steps):
        covariance = transition @ covariance @ transition.T + spread @ spread.T
    return covariance


def test_a_step_of_the_gusts_may_be_cut_at_will():
    """The statistics after a second are the same for any step: pompy's depend on it."""
    np.testing.assert_allclose(covariance_after(1, 1.0), covariance_after(100, 0.01), rtol=1e-9)
    whole, half = exact_gust_step(GUSTS, 1.0)[0], exact_gust_step(GUSTS, 0.5)[0]
    np.testing.assert_allclose(half @ half, whole, rtol=1e-12)


def test_gusts_settle_at_their_standard_deviation():
    assert covariance_after(4000, 0.1)[0, 0] == pytest.approx(0.25, rel=1e-6)
    assert covariance_after(4000, 0.1)[1, 1] == pytest.approx(0.25 * (2 * np.pi / 30) ** 2, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size_m", "changes"),
    [
        ((20, 14), {"mean_m_s": (0.492, 0.087, 0.0), "std_m_s": 0.25}),
        ((15, 10), {"mean_m_s": (-1.0, -0.2, 0.0)}),
        ((20, 14), {"mean_m_s": (0.0, 0.0, 0.0), "n_nodes": 9}),
        ((32, 22), {"viscosity_m2_s": 20.0}),
        ((12, 9), {"period_s": 8.0, "damping": 0.5}),
        ((30, 20), {"period_s": 90.0, "mean_m_s": (0.2, 2.0, 0.0)}),
    ],
)
def test_wind_in_the_middle_has_the_standard_deviation_that_is_asked_for(size_m, changes):
    """Of the mean of both components over hours; that of gusts within a tenth, whatever the field."""
    gusts = {"std_m_s": 0.5, "period_s": 30.0, "damping": 0.1}
    gusts |= {key: changes.pop(key) for key in list(changes) if key in gusts}
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, shape=(*size_m, 2))
    settings = {"mean_m_s": (1.0, 0.2, 0.0), "viscosity_m2_s": 10.0, "n_nodes": 11, **changes}
    wind = FarrellWind(grid, gusts=Gusts(**gusts), **settings)
    records = []
    for seed in range(2):
        wind.reset(seed)
        middle = (size_m[0] // 2, size_m[1] // 2)
        records += [wind.at(60.0 + 4.0 * i)[middle][0, :2].copy() for i in range(1500)]
    record = np.array(records)
    np.testing.assert_allclose(record.mean(axis=0), settings["mean_m_s"][:2], atol=0.1 * gusts["std_m_s"] + 0.05)
    assert np.sqrt(record.var(axis=0).mean()) == pytest.approx(gusts["std_m_s"], rel=0.12)


@pytest.mark.parametrize(("size_m", "is_warned_of"), [([20, 14, 4], False), ([100, 100, 2], True)])
def test_gusts_that_do_not_reach_the_middle_are_warned_of(size_m, is_warned_of):
    changes = [f"environment.layout.size_m={size_m}", "gas.model=farrell", "wind={solver: uniform}"]
    loaded = load_scenario("warehouse_empty", overrides=changes)
    found = [str(warning) for warning in find_gust_warnings(loaded.scenario, loaded.directory)]
    assert len(found) == is_warned_of
    assert all("30 s in a field of 100 x 100 m" in text and "4 times gust_std_m_s" in text for text in found)


def test_asking_often_or_seldom_gives_the_same_wind():
    often, seldom = wind_of(), wind_of()
    for k in range(1, 101):
        often.at(0.03 * k)
    np.testing.assert_array_equal(often.at(3.0), seldom.at(3.0))
    assert (wind_of(seed=2).at(3.0) != seldom.at(3.0)).any()


def test_a_sine_decays_as_diffusion_says():
    """u = sin(pi x / L) between walls at rest decays with rate nu (pi / L)^2; box of two side lengths."""
    nx, ny, dx_m, dy_m, viscosity_m2_s = 41, 9, 0.05, 0.2, 0.3
    profile = 1e-6 * np.sin(np.pi * np.linspace(0.0, 1.0, nx))
    wind = np.zeros((nx, ny, 2))
    wind[:, :, 1] = profile[:, None]
    dt_s = 0.5 * stable_step_s(1e-6, viscosity_m2_s, dx_m, dy_m)
    n_steps = round(0.02 / dt_s)
    advance_wind_inplace(wind, wind.copy(), dx_m, dy_m, viscosity_m2_s, dt_s, n_steps)
    # The border along x keeps its values, so look in the middle, before it has spread there.
    decay = np.exp(-viscosity_m2_s * (np.pi / 2.0) ** 2 * n_steps * dt_s)
    np.testing.assert_allclose(wind[1:-1, 4, 1], decay * profile[1:-1], rtol=5e-3)


def test_a_front_moves_with_the_wind():
    """Without viscosity a ramp of v is carried along x at u."""
    nx, ny = 60, 5
    wind = np.zeros((nx, ny, 2))
    wind[:, :, 0] = 2.0
    wind[:, :, 1] = (np.arange(nx) * 1e-7)[:, None]
    before = wind.copy()
    advance_wind_inplace(wind, wind.copy(), 0.1, 0.1, 0.0, 0.01, 20)
    np.testing.assert_allclose(wind[40, 2, 1], before[40, 2, 1] - 2.0 * 0.2 * 1e-6, rtol=1e-6)


def test_the_border_is_straight_between_the_corners():
    wind = np.zeros((3, 5, 2))
    set_edges_inplace(wind, np.array([[0.0, 4.0, 2.0, 8.0], [1.0, 1.0, 1.0, 1.0]]))
    assert wind[0, :, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert wind[:, -1, 0].tolist() == [4.0, 6.0, 8.0]
    assert wind[:, 0, 0].tolist() == [0.0, 1.0, 2.0]
    assert (wind[[0, -1], :, 1] == 1.0).all()


def test_cells_get_the_wind_between_the_nodes():
    nodes = np.zeros((3, 5, 2))
    nodes[..., 0], nodes[..., 1] = np.arange(3)[:, None], np.arange(5)[None, :]
    cells = wind_in_cells(nodes, 4, 8)
    assert cells.shape == (4, 8, 1, 3)
    np.testing.assert_allclose(cells[:, 0, 0, 0], (0.25, 0.75, 1.25, 1.75))
    np.testing.assert_allclose(cells[0, :, 0, 1], np.arange(8) * 0.5 + 0.25)


def test_the_stable_step_is_the_sum_of_both_limits():
    assert stable_step_s(1.0, 0.0, 0.5, 0.5) == pytest.approx(0.25)
    assert stable_step_s(0.0, 10.0, 0.5, 0.5) == pytest.approx(0.25 / 40.0)


def test_an_open_field_lets_gas_out_at_its_sides_and_top(make_room):
    room = make_room(obstacles=(("box", (0.0, 4.0, 0.0), (1.0, 5.0, 1.0)),))
    occupancy = open_sides_and_top(room).occupancy
    assert {int(occupancy[i, 2, 2]) for i in (0, -1)} == {Cell.OUTLET}
    assert {int(occupancy[2, j, 2]) for j in (0, -1)} == {Cell.OUTLET}
    assert (occupancy[2, 2, 0], occupancy[2, 2, -1]) == (Cell.FREE, Cell.OUTLET)
    assert occupancy[0, 17, 2] == Cell.SOLID
    assert (room.occupancy != Cell.OUTLET).all()
