"""Puff tracing against a plain double loop over cells and puffs, and against what uniform wind must do."""

import math

import numpy as np
import pytest
from briefings import observation

from gslcosim_search.bayes.puff_tracing import (
    PuffModel,
    SourceMap,
    displacements_m,
    partial_sums_m,
    trace_back,
    trace_puffs,
    update,
)
from gslcosim_search.beliefs import CellGrid, normalised
from gslcosim_search.senses.instruments import Vane
from gslcosim_search.senses.wind_field import WindField, WindRecord

GRID = CellGrid((0.0, 0.0), 0.5, (13, 9))
SENSOR_M = (4.2, 2.1)
WINDS_M_S = np.array([[0.4, 0.1], [0.5, -0.2], [0.2, 0.3], [0.6, 0.0]])


def below(x_m, sigma_m):
    return 0.5 * (1.0 + math.erf(x_m / sigma_m / math.sqrt(2.0)))


def plain_shares(grid, sensor_m, winds_m_s, step_s, spread, first=1):
    """S_i(l) for each cell and release time, by the definition: one integral after the other."""
    shares = []
    for age in range(first, len(winds_m_s) + 1):
        travelled_m = winds_m_s[len(winds_m_s) - age :].sum(axis=0) * step_s
        sigma_m = spread * math.sqrt(age * step_s)
        share = np.empty(grid.shape)
        for i in range(grid.shape[0]):
            for j in range(grid.shape[1]):
                low_m = (grid.origin_m[0] + i * grid.cell_m, grid.origin_m[1] + j * grid.cell_m)
                offsets_m = [low - (sensor - v) for low, sensor, v in zip(low_m, sensor_m, travelled_m, strict=True)]
                share[i, j] = math.prod(below(o + grid.cell_m, sigma_m) - below(o, sigma_m) for o in offsets_m)
        shares.append(share)
    return np.array(shares)


def traced(winds_m_s, *, spread=0.3, mu=0.9, grid=GRID, sensor_m=SENSOR_M):
    model = PuffModel(step_s=1.0, window_s=float(len(winds_m_s)), spread_m_sqrt_s=spread, detection_probability=mu)
    travelled_m = partial_sums_m(winds_m_s, 1.0)
    variance = model.variances_m2(len(travelled_m))
    low_m, sensor = np.array(grid.origin_m), np.array(sensor_m)
    return trace_puffs(low_m, grid.cell_m, *grid.shape, sensor, travelled_m[1:], variance[1:], mu, grid.cell_m**2)


def test_shares_are_those_of_a_plain_double_loop():
    shares = plain_shares(GRID, SENSOR_M, WINDS_M_S, 1.0, 0.3)
    mean_share, log_share = traced(WINDS_M_S)
    assert mean_share == pytest.approx(shares.mean(axis=0), abs=1e-14)
    assert log_share == pytest.approx(np.log(1.0 - 0.9 * shares).sum(axis=0), abs=1e-12)


@pytest.mark.parametrize("weight", [1.0, 0.4])
@pytest.mark.parametrize("hits", ["share", "chance"])
def test_a_map_is_what_bayes_rule_gives_cell_by_cell(hits, weight):
    """Two detections and a miss at three places, against products of the plain shares."""
    wind = np.tile([[0.5, 0.1]], (6, 1))
    expected = np.ones(GRID.shape)
    source_map = SourceMap(GRID)
    model = PuffModel(step_s=1.0, window_s=6.0, spread_m_sqrt_s=0.4, hits=hits)
    for sensor_m, is_hit in (((4.2, 2.1), True), ((4.0, 3.9), False), ((3.1, 1.9), True)):
        shares = plain_shares(GRID, sensor_m, wind, 1.0, 0.4)
        missed = (1.0 - 0.9 * shares).prod(axis=0)
        expected *= ((shares.mean(axis=0) if hits == "share" else 1.0 - missed) if is_hit else missed) ** weight
        update(source_map, model, sensor_m, partial_sums_m(wind, 1.0), is_hit=is_hit, weight=weight)
    assert source_map.probability() == pytest.approx(normalised(expected), abs=1e-12)


def test_partial_sums_count_from_the_newest_wind():
    assert partial_sums_m(np.array([[1.0, 0.0], [0.0, 2.0]]), 0.5) == pytest.approx(
        np.array([[0.0, 0.0], [0.0, 1.0], [0.5, 1.0]])
    )


def test_a_product_over_very_many_puffs_stays_a_number():
    mean_share, log_share = traced(np.zeros((5000, 2)), spread=0.001, mu=1.0)
    assert np.isfinite(log_share).all()
    assert np.isfinite(mean_share).all()


def test_tracing_back_follows_the_wind_of_the_place():
    """West of x = 5 the air goes east, east of it north: a puff met in the east has come from the south."""
    wind = np.zeros((10, 10, 2))
    wind[:5, :, 0], wind[5:, :, 1] = 0.5, 0.5
    east = trace_back(np.array([8.0, 4.0]), 4, 1.0, np.zeros(2), 1.0, wind)[-1]
    west = trace_back(np.array([3.0, 4.0]), 4, 1.0, np.zeros(2), 1.0, wind)[-1]
    assert east == pytest.approx([0.0, 2.0])
    assert west == pytest.approx([2.0, 0.0])


def test_between_centres_the_wind_is_linear_and_beyond_them_constant():
    wind = np.zeros((3, 2, 2))
    wind[:, :, 0] = [[1.0, 3.0], [2.0, 4.0], [3.0, 5.0]]
    places_m = {(1.0, 1.0): 2.5, (0.5, 0.5): 1.0, (-9.0, 9.0): 3.0, (9.0, -9.0): 3.0, (2.5, 1.0): 4.0}
    for place_m, expected in places_m.items():
        travelled = trace_back(np.array(place_m), 1, 1.0, np.zeros(2), 1.0, wind)
        assert travelled[1] == pytest.approx([expected, 0.0]), place_m


def test_a_sensor_that_meets_puffs_in_more_than_a_cell_misses_fewer():
    shares = plain_shares(GRID, SENSOR_M, WINDS_M_S, 1.0, 0.3)
    travelled_m, model = partial_sums_m(WINDS_M_S, 1.0), PuffModel(step_s=1.0, spread_m_sqrt_s=0.3)
    variance = model.variances_m2(len(travelled_m))
    _, log_share = trace_puffs(
        np.zeros(2), 0.5, *GRID.shape, np.array(SENSOR_M), travelled_m[1:], variance[1:], 0.9, 0.5
    )
    assert log_share == pytest.approx(np.log(1.0 - 0.9 * np.minimum(1.0, 2.0 * shares)).sum(axis=0), abs=1e-12)


def test_displacements_go_back_over_the_window_with_the_mean_wind_where_none_is_known():
    record = WindRecord(Vane(name="vane"), step_s=0.5, n_steps=100)
    model = PuffModel(step_s=0.5, window_s=4.0)
    assert np.array_equal(displacements_m(record, model, SENSOR_M), np.zeros((9, 2)))
    for tick in range(1, 22):
        record.add(observation(tick=tick, readings={"vane": (0.1 * (tick > 11), math.pi)}))
    assert displacements_m(record, model, SENSOR_M)[[4, 8], 0] == pytest.approx([0.095, 0.19], abs=0.02)
    record = WindRecord(Vane(name="vane"), step_s=0.5, n_steps=100)
    for tick in range(1, 102):
        record.add(observation(tick=tick, readings={"vane": (0.5, math.pi)}))
    assert displacements_m(record, model, SENSOR_M)[-1] == pytest.approx([2.0, 0.0])
    field = WindField(GRID, reach_m=1.0)
    field.add((7.0, 5.0), (0.3, 0.1))
    assert displacements_m(record, model, SENSOR_M, field=field)[-1] == pytest.approx([1.2, 0.4])


def test_a_puff_with_a_size_at_birth_is_seen_where_it_is_released():
    model = PuffModel(step_s=1.0, initial_sigma_m=0.3, spread_m_sqrt_s=0.1)
    assert model.variances_m2(3)[:, 0] == pytest.approx([0.09, 0.10, 0.11])
    source_map = SourceMap(GRID)
    update(source_map, model, SENSOR_M, np.zeros((1, 2)), is_hit=True)
    best = np.unravel_index(source_map.probability().argmax(), GRID.shape)
    assert tuple(best) == GRID.cell_at(SENSOR_M)


def test_the_floor_limits_what_one_measurement_takes_away():
    source_map = SourceMap(GRID, floor_frac=0.1)
    update(source_map, PuffModel(step_s=1.0), SENSOR_M, np.zeros((2, 2)), is_hit=True)
    p = source_map.probability()
    assert p.max() / p.min() == pytest.approx(10.0, rel=1e-6)


def test_cells_in_walls_never_hold_the_source_and_the_map_survives_what_no_cell_explains():
    free = np.ones(GRID.shape, bool)
    free[4:9, 2:6] = False
    source_map = SourceMap(GRID, free=free)
    before = source_map.probability()
    far_m, still = (100.0, 100.0), np.zeros((3, 2))
    update(source_map, PuffModel(step_s=1.0), far_m, still, is_hit=True)
    assert source_map.probability() == pytest.approx(before)
    update(source_map, PuffModel(step_s=1.0), SENSOR_M, still, is_hit=True)
    assert source_map.probability()[~free].max() == 0.0
    source_map.multiply(np.zeros(GRID.shape))
    assert source_map.probability().sum() == pytest.approx(1.0)
