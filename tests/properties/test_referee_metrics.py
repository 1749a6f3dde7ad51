import itertools
import math

from hypothesis import assume, given
from hypothesis import strategies as st

from gslcosim_services.referee.metrics import directness, find_nearest, movement_overhead

points = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
lengths = st.floats(0.01, 1000.0)


@given(st.lists(points, min_size=2, max_size=12), points)
def test_directness_is_the_mean_cosine_of_the_path_and_within_one(track_m, source_m):
    """Equation 7.1 of the thesis part by part equals what is computed from start, end and length."""
    parts = list(itertools.pairwise(track_m))
    path_length_m = sum(math.dist(a, b) for a, b in parts)
    reference_m = math.dist(track_m[0], source_m)
    assume(path_length_m > 0.01 and reference_m > 0.01)
    unit = [(s - a) / reference_m for s, a in zip(source_m, track_m[0], strict=True)]
    progress_m = sum(sum((y - x) * u for x, y, u in zip(a, b, unit, strict=True)) for a, b in parts)
    value = directness(track_m[0], track_m[-1], source_m, path_length_m)
    assert value is not None
    assert math.isclose(value, progress_m / path_length_m, abs_tol=1e-9)
    assert -1 - 1e-9 <= value <= 1 + 1e-9


@given(lengths, lengths, lengths)
def test_overhead_grows_with_the_path_and_never_shrinks_when_the_shortest_way_does(path_m, more_m, shortest_m):
    assert movement_overhead(path_m + more_m, shortest_m) >= movement_overhead(path_m, shortest_m)
    assert movement_overhead(path_m, shortest_m) >= movement_overhead(path_m, shortest_m + more_m)


@given(points, st.lists(points, min_size=1, max_size=6))
def test_no_place_is_nearer_than_the_nearest(point_m, places_m):
    chosen_m = find_nearest(point_m, places_m)
    assert all(math.dist(point_m, chosen_m) <= math.dist(point_m, place_m) for place_m in places_m)
