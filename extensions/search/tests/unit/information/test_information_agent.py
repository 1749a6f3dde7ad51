"""What information-driven agents share: what they learn, where they may go, when they declare."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from briefings import PLUME, briefing, observation, open_map, task_of

from gslcosim.scenario.models.success import AllSourcesSuccess, DeclarationSuccess, MapSuccess, SourceSuccess
from gslcosim_search.bayes.encounter_model import likelihoods_into
from gslcosim_search.beliefs import CellGrid, best_ball, entropy_bits, mass_within
from gslcosim_search.information import objectives as information_kernels
from gslcosim_search.information.information_agent import (
    InformationAgent,
    Infotaxis,
    Infotaxis3d,
    arrival_radius_m,
    assumed_dispersal,
    direction_spread_rad,
    max_box_probability,
)

WEST_RAD = math.pi  # the wind comes from -x and blows to +x
PID = (("pid", "nose"), ("anemometer", "vane"))
COME = task_of(SourceSuccess())
SETTINGS = {
    "cell_m": 0.5, "step_m": 1.0, "n_headings": 4, "climb_m": 1.0, "hold_s": None, "may_stay": False, "stop_s": 1.0,
    "wall_margin_m": 0.5, "threshold_ppm": 0.1, "floor": 0.02, "power": 0.5, "hits_at_1m": 1.0,
    "diffusivity_m2_s": 0.05, "lifetime_s": 100.0, "detector_m": 0.1, "wind_memory_s": 10.0, "correlation_s": 5.0,
    "arrival": "by_mission", "declares": True, "radius_m": 1.0, "mass": 0.9, "entropy_bits": 1.0, "monitor_stops": 20,
}  # fmt: skip


def searcher(kind=Infotaxis, *, briefed=None, **changes) -> InformationAgent:
    return kind(briefed or briefing(sensors=PID), SimpleNamespace(**{**SETTINGS, **changes}))


def seen(time_s, place_m=(7.0, 5.0, 2.0), *, ppm=0.0, speed_m_s=0.4, notice=None):
    readings = {"nose": ppm, "vane": (speed_m_s, WEST_RAD)}
    return observation(tick=round(10 * time_s), position_m=place_m, readings=readings, notice=notice)


def smell(search, place_m, ppm, *, start_s=0.0, n_s=3):
    """Hold at a place for some seconds, then decide; return the command."""
    for k in range(10 * n_s):
        search.observe(seen(start_s + 0.1 * k, place_m, ppm=ppm))
    return search.decide(seen(start_s + n_s, place_m, ppm=ppm))


def test_the_second_finding_at_a_place_weighs_half_the_third_a_third():
    search = searcher(may_stay=True)
    smell(search, (12.0, 8.0, 2.0), 0.0, n_s=5)
    upwind, aside = search.grid.cell_at((5.0, 5.0)), search.grid.cell_at((5.0, 1.0))
    odds = [math.log(search.p[upwind] / search.p[aside])]
    for k in range(3):
        smell(search, (7.0, 5.0, 2.0), 1.0, start_s=5.0 + k, n_s=1)
        odds.append(math.log(search.p[upwind] / search.p[aside]))
        assert search.build_context((7.0, 5.0)).novelty[0] == pytest.approx(1.0 / (2.0 + k))
    first, second, third = np.diff(odds)
    assert (second, third) == pytest.approx((first / 2.0, first / 3.0), rel=1e-6)


def test_what_was_passed_is_ruled_out_where_arrival_would_end_the_run():
    coming, declaring = searcher(briefed=briefing(sensors=PID, task=COME)), searcher()
    for search in (coming, declaring):
        search.observe(seen(0.0, speed_m_s=0.0))
    even = 1.0 / (30 * 20)
    assert mass_within(coming.p, coming.grid, (7.0, 5.0), 0.9) < 0.2 * mass_within(
        declaring.p, declaring.grid, (7.0, 5.0), 0.9
    )
    assert declaring.p == pytest.approx(even)


def test_a_model_that_is_wrong_again_and_again_is_trusted_less():
    watched, blind = (searcher(monitor_stops=n, hits_at_1m=0.01, floor=0.01) for n in (3, 1000))
    for search in (watched, blind):
        for k in range(10):
            smell(search, (3.0 + k, 5.0, 2.0), 1.0, start_s=10.0 * k, n_s=2)
    assert entropy_bits(watched.p) > entropy_bits(blind.p) + 0.5


def test_a_refused_end_is_not_offered_again():
    search = searcher()
    first = smell(search, (7.0, 5.0, 2.0), 0.0).position_world_m
    assert any(math.dist(end, first[:2]) < 0.01 for end in search.neighbours((7.0, 5.0)))
    search.decide(seen(10.0, notice="in an obstacle"))
    assert all(math.dist(end, first[:2]) > 0.2 for end in search.neighbours((7.0, 5.0)))


def test_where_every_step_is_refused_it_stays():
    search = searcher()
    for k in range(6):
        command = search.decide(seen(5.0 * k, notice="in an obstacle" if k else None))
    assert command.position_world_m == (7.0, 5.0, 2.0)


def test_with_a_map_neither_belief_nor_steps_enter_walls():
    wall = (8.0, 3.0, 9.0, 7.0)
    search = searcher(briefed=briefing(sensors=PID, known_map=open_map(walls=(wall,))))
    x, y = np.meshgrid(search.grid.axis_m(0), search.grid.axis_m(1), indexing="ij")
    inside = (x > 8.0) & (x < 9.0) & (y > 3.0) & (y < 7.0)
    smell(search, (7.0, 5.0, 2.0), 1.0)
    assert search.p[inside] == pytest.approx(0.0)
    assert all(end[0] < 8.0 for end in search.neighbours((7.5, 5.0)))


def test_in_space_it_also_goes_up_and_down():
    search = searcher(Infotaxis3d, cell_m=1.0)
    heights = {end[2] for end in search.neighbours((7.0, 5.0, 2.0))}
    assert heights == {1.0, 2.0, 3.0}
    assert search.p.shape == (15, 10, 8)


def test_a_tree_surveys_each_place_once():
    context = searcher().build_context((7.0, 5.0))
    tree = context.tree(2)
    assert len(tree.start) == 4
    # Two steps along the axes: 4 places one step away, and 9 that lie two steps away.
    assert len(tree.candidates.places_m) == 13
    assert [len(tree.moves[place]) for place in tree.start] == [4, 4, 4, 4]


def test_what_is_declared_is_the_place_of_the_belief_at_search_height():
    search = searcher()
    search._memory.p = np.where(np.arange(600) == 250, 1.0, 1e-9)
    search._memory.p /= search._memory.p.sum()
    declared = search.decide(seen(5.0)).declaration
    assert math.dist(declared.position_world_m, (*search.grid.centre_m((12, 10)), 2.0)) < 0.1
    assert declared.confidence > 0.9


def test_arrival_ends_the_search_where_one_source_has_to_be_reached():
    assert arrival_radius_m(briefing(task=task_of(SourceSuccess(within_m=0.75)))) == 0.75
    for success in (DeclarationSuccess(), AllSourcesSuccess(), MapSuccess()):
        assert arrival_radius_m(briefing(task=task_of(success))) == 0.0
    assert arrival_radius_m(briefing(task=None)) == 0.0


def test_a_granted_plume_replaces_the_frozen_figures():
    settings = SimpleNamespace(**SETTINGS)
    frozen = assumed_dispersal(briefing(sensors=PID), settings, 2)
    granted = assumed_dispersal(briefing(sensors=PID, plume=PLUME), settings, 2)
    assert (frozen.diffusivity_m2_s, frozen.hits_at_1m) == (0.05, 1.0)
    assert granted.diffusivity_m2_s == pytest.approx(0.0025)
    assert granted.room_length_m == frozen.room_length_m == 15.0


def test_the_spread_of_directions_is_the_circular_one():
    winds = np.array([[math.cos(a), math.sin(a)] for a in (0.3, -0.3)])
    assert direction_spread_rad(winds) == pytest.approx(math.sqrt(-2.0 * math.log(math.cos(0.3))))
    assert direction_spread_rad(np.array([[0.2, 0.0]] * 5)) == pytest.approx(0.0, abs=1e-7)
    assert direction_spread_rad(np.array([[1.0, 0.0], [-1.0, 0.0]])) == 1.5
    assert direction_spread_rad(np.zeros((3, 2))) == 0.0


@pytest.mark.parametrize("shape", [(7, 5), (5, 4, 6)])
def test_the_fullest_box_is_that_of_all_boxes_and_holds_every_ball(shape):
    p = np.random.default_rng(2).random(shape) ** 4
    p /= p.sum()
    reach = 1
    boxes = [p[tuple(slice(max(0, i - reach), i + reach + 1) for i in index)].sum() for index in np.ndindex(shape)]
    assert max_box_probability(p, reach) == pytest.approx(max(boxes))
    grid = CellGrid((0.0,) * len(shape), 1.0, shape)
    assert best_ball(p, grid, 1.5)[1] <= max_box_probability(p, reach) + 1e-12


def test_nothing_compiles_after_the_briefing():
    search = searcher()
    kernels = (information_kernels.predict_stops_into, likelihoods_into)
    before = [len(kernel.signatures) for kernel in kernels]
    smell(search, (7.0, 5.0, 2.0), 1.0)
    assert [len(kernel.signatures) for kernel in kernels] == before
