"""What is seen at once about a stop is what the search for the quickest stop finds."""

import math

import numpy as np
import pytest

from gslcosim_services.fields.mixing_ratio import build_solid_sums
from gslcosim_services.world.trajectory import plan_quickest_inplace
from gslcosim_training.batch import batch_records
from gslcosim_training.batch.free_space import is_edge_ahead, is_open_ahead, longest_stop_s

RADIUS_M = 0.15
LIMITS = {"max_speed_m_s": 1.2, "max_acceleration_m_s2": 2.0}


@pytest.fixture(scope="module")
def room_and_occupancy():
    """Return a record of a room of 10 x 7 x 3 m with shelves, and the array that it points into."""
    occupancy = np.zeros((40, 28, 12), np.uint8)
    occupancy[10:12, 4:20, :8] = occupancy[25:27, 8:28, :5] = 1
    sums = build_solid_sums(occupancy)
    room = np.zeros((), batch_records.ROOM)
    room["origin_m"], room["max_m"], room["cell_m"], room["shape"] = (1, -2, 0), (11, 5, 3), 0.25, occupancy.shape
    room["occupancy"], room["solid_sums"] = occupancy.ctypes.data, sums.ctypes.data
    return room[()], (occupancy, sums)


def drawn_states(rng, n):
    """Return n states (3, 3): at rest, cruising, speeding up and slowing down, some beyond the limits."""
    places_m = rng.uniform((1.2, -1.8, 0.2), (10.8, 4.8, 2.8), (n, 3))
    directions = rng.normal(size=(2, n, 3)) * (1, 1, 0.3)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    velocities_m_s = directions[0] * rng.uniform(0, 1.4, (n, 1)) * rng.integers(0, 4, (n, 1)).clip(0, 1)
    accelerations_m_s2 = directions[1] * rng.uniform(0, 2.2, (n, 1)) * rng.integers(0, 4, (n, 1)).clip(0, 1)
    return np.stack([places_m, velocities_m_s, accelerations_m_s2], axis=1)


def test_where_nothing_is_seen_on_the_way_the_quickest_stop_is_no_edge(room_and_occupancy):
    room, _ = room_and_occupancy
    case = np.zeros((), batch_records.CASE)
    for name, value in LIMITS.items():
        case[name] = value
    coefficients, at_rest = np.zeros((3, 6)), np.zeros((3, 3))
    n_known = n_open = n_edges = 0
    for state in drawn_states(np.random.default_rng(2), 4000):
        longest_s = longest_stop_s(case[()], state[1], state[2])
        stop_s = plan_quickest_inplace(coefficients, state, at_rest, True, *LIMITS.values(), 0.0, 0.0)
        stop_m = np.array([np.polyval(coefficients[axis, ::-1], stop_s) for axis in range(3)])
        is_edge = is_edge_ahead(room, RADIUS_M, stop_m, state[1])
        assert stop_s <= longest_s
        n_edges += is_edge
        if longest_s < math.inf:
            n_known += 1
            is_open = is_open_ahead(room, RADIUS_M, state, longest_s)
            assert not (is_open and is_edge)
            n_open += is_open
    assert n_known > 2800
    assert n_open > 0.6 * n_known
    assert n_edges > 200
