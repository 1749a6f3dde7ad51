import math

import numpy as np
import pytest

from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.swarms.glowworms import (
    OdourGlow,
    SpiralSearch,
    attraction,
    brighter_neighbours,
    choose_by_probability,
    circling_m,
    is_in_excluded_region,
    next_luciferin,
    next_radius_m,
)

ROOM = LegSpace(min_m=(1.0, 1.0, 0.5), max_m=(9.0, 7.0, 2.5))


def at(*metres: float) -> np.ndarray:
    return np.array(metres, dtype=np.float64)


def test_luciferin_decays_and_is_fed_and_settles():
    assert next_luciferin(5.0, 2.0, decay=0.4, gain=0.6) == pytest.approx(0.6 * 5.0 + 0.6 * 2.0)
    luciferin = 5.0
    for _ in range(100):
        luciferin = next_luciferin(luciferin, 2.0, decay=0.4, gain=0.6)
    assert luciferin == pytest.approx(0.6 * 2.0 / 0.4)


def test_neighbours_are_brighter_and_nearer_than_the_radius():
    others = np.array([[1.0, 0.0], [2.9, 0.0], [3.0, 0.0], [0.0, 1.0]])
    found = brighter_neighbours(at(0, 0), 1.0, others, at(2.0, 1.5, 9.0, 1.0), 3.0)
    assert found.tolist() == [0, 1]
    assert brighter_neighbours(at(0, 0), 1.0, np.empty((0, 2)), np.empty(0), 3.0).tolist() == []


def test_neighbours_are_followed_by_how_much_brighter_they_are():
    assert attraction(1.0, at(2.0, 4.0)).tolist() == [0.25, 0.75]
    assert attraction(1.0, np.empty(0)).tolist() == []


def test_a_draw_falls_on_each_with_its_probability():
    assert [choose_by_probability(at(0.25, 0.75), draw) for draw in (0.0, 0.249, 0.25, 0.999)] == [0, 0, 1, 1]
    assert (
        choose_by_probability(at(0.1, 0.2, 0.7) * (1 - 1e-12), 1.0 - 1e-16) == 2
    )  # rounding must not fall off the end


def test_the_radius_grows_with_too_few_neighbours_and_shrinks_with_too_many():
    assert next_radius_m(3.0, 2, wanted=5, gain_m=0.08, sight_m=8.0) == pytest.approx(3.24)
    assert next_radius_m(3.0, 8, wanted=5, gain_m=0.08, sight_m=8.0) == pytest.approx(2.76)
    assert next_radius_m(7.9, 0, wanted=5, gain_m=0.08, sight_m=8.0) == 8.0
    assert next_radius_m(0.1, 8, wanted=5, gain_m=0.08, sight_m=8.0) == 0.0


def test_the_glow_is_the_brute_force_maximum():
    rng = np.random.default_rng(3)
    glow, samples = OdourGlow(memory_s=2.0, threshold=0.3), []
    for t in np.cumsum(rng.uniform(0.05, 0.9, 300)):
        samples.append((float(t), float(rng.uniform())))
        most = max(c for s, c in samples if s > t - 2.0)
        assert glow.add(*samples[-1]) == (most if most > 0.3 else 0.0)


@pytest.mark.parametrize("side", [1, -1])
def test_circling_keeps_its_distance_and_goes_round(side):
    place, other = at(3.0, 2.0), at(2.0, 2.0)
    angles = []
    for _ in range(4):
        place = circling_m(place, other, radius_m=2.0, step_m=math.pi, side=side)
        assert math.dist(place, other) == pytest.approx(2.0)
        angles.append(round(math.degrees(math.atan2(*(place - other)[::-1]))) % 360)
    assert angles == ([90, 180, 270, 0] if side == 1 else [270, 180, 90, 0])


def test_a_declared_region_is_a_disc():
    declared = [(2.0, 2.0), (9.0, 9.0)]
    assert is_in_excluded_region((3.0, 2.0), declared, 2.0)
    assert not is_in_excluded_region((4.0, 2.0), declared, 2.0)
    assert not is_in_excluded_region((3.0, 2.0), [], 2.0)


def places_of(search: SpiralSearch, place, n: int) -> np.ndarray:
    places = []
    for _ in range(n):
        step = search.step(place)
        assert np.hypot(*step) <= 1.0 + 1e-9
        place = place + step
        places.append(place)
    return np.array(places)


def test_a_spiral_begins_where_it_is_and_covers_the_room():
    places = places_of(SpiralSearch(ROOM, RandomStream(3), gap_m=2.0, leg_m=1.0), at(5.0, 4.0), 400)
    assert 0.5 < math.dist(places[0], (5.0, 4.0)) < 1.0  # an arc of a leg
    assert all(ROOM.contains(tuple(place)) for place in places)
    cells = {(int(x), int(y)) for x, y in places}
    assert len(cells) > 0.8 * 8 * 6


def test_places_that_are_not_worth_it_are_left_out():
    search = SpiralSearch(ROOM, RandomStream(3), gap_m=2.0, leg_m=1.0, is_left_out=lambda place: place[0] < 4.0)
    assert places_of(search, at(6.0, 4.0), 300)[:, 0].min() >= 4.0


def test_who_moves_on_flies_elsewhere_before_it_spirals():
    search, place = SpiralSearch(ROOM, RandomStream(5), gap_m=2.0, leg_m=1.0), at(2.0, 2.0)
    assert not search.is_on_its_way(place)
    search.move_on()
    headings = []
    while search.is_on_its_way(place):
        step = search.step(place)
        headings.append(math.atan2(step[1], step[0]))
        place = place + step
        assert len(headings) < 20
    assert len(headings) > 1
    assert headings == pytest.approx([headings[0]] * len(headings))
