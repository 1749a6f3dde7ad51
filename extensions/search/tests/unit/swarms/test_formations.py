import math
from types import SimpleNamespace

import numpy as np
import pytest
from briefings import observation, sensor
from built_messages import build_briefing

from gslcosim.agent_kit import Observation
from gslcosim.contract.messages import ChannelDescription
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.swarms.formations import (
    SHAPES,
    FormationAgent,
    PlumeMemory,
    centre_m,
    find_lane_point,
    find_next_lane_point,
    fit_plane,
    formation,
    in_world,
    inverted_v,
    laplacian_leg_m,
    laplacian_velocity_m_s,
    mixed_direction,
    nearest_axis_rad,
    next_width,
    odour_offset_m,
    plan_crosswind_lanes,
)
from gslcosim_search.swarms.rounds import Report, ReportedBest, encode

GAINS = {"formation_per_s": 0.4, "upwind_m_s": 0.3, "odour_per_s": 0.2}
NAMES = ("ada", "bob", "cyd")
SETTINGS = {
    "wall_margin_m": 0.5, "hold_s": 1.0, "gas_floor": 0.1, "mox_band_frac": 0.02, "calm_m_s": 0.05, "timeout_s": 2.0,
    "fades_s": 10.0, "declares": True, "near_m": 1.5, "near_s": 3.0, "unchanged_s": 100.0, "declare_factor": 5.0,
    "search_step_m": 2.0, "cast_m": 1.0, "n_casts": 2,
}  # fmt: skip
SENSORS = (sensor("pid", "nose"), sensor("anemometer", "vane"))
PLACES_M = {"ada": (4.0, 4.0), "bob": (5.0, 4.0), "cyd": (4.0, 5.0)}
ROOM = LegSpace(min_m=(1.0, 1.0, 0.5), max_m=(14.0, 9.0, 7.0))


def distances(places):
    return np.hypot(*(places[None, :, :] - places[:, None, :]).transpose(2, 0, 1))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n", range(1, 9))
def test_slots_are_centred_and_no_two_robots_share_one(shape, n):
    slots = formation(shape, n, 1.5)
    assert slots.shape == (n, 2)
    assert slots.mean(axis=0) == pytest.approx(0.0, abs=1e-12)
    apart = distances(slots) + 99.0 * np.eye(n)
    assert apart.min() > 0.5


def test_an_unknown_shape_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match=r"expected one of ring, square, .*, was star"):
        formation("star", 3, 1.0)


def test_the_first_of_an_inverted_v_is_upwind_of_all_and_the_arms_are_mirrored():
    slots = inverted_v(5, 1.0)
    assert np.all(slots[0, 0] > slots[1:, 0])
    assert slots[1::2, 1] == pytest.approx(-slots[2::2, 1])
    assert slots[1::2, 0] == pytest.approx(slots[2::2, 0])


def test_the_centre_is_found_though_some_robots_are_missing():
    offsets = formation("hexagon", 7, 1.0)
    some = [0, 2, 3]
    assert centre_m(offsets[some] + np.array((4.0, 5.0)), offsets[some]) == pytest.approx([4.0, 5.0])


@pytest.mark.parametrize("n", [3, 4, 7])
def test_a_plane_comes_back_exactly(n):
    positions = np.random.default_rng(n).uniform(0.0, 10.0, (n, 2))
    fit = fit_plane(positions, 3.0 + positions @ (0.7, -0.2))
    assert fit.gradient_per_m == pytest.approx((0.7, -0.2))
    assert fit.mean == pytest.approx(3.0 + positions.mean(axis=0) @ (0.7, -0.2))
    assert fit.residual == pytest.approx(0.0, abs=1e-9)
    assert fit.problem == ""


def test_what_no_plane_fits_is_in_the_residual():
    square = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    fit = fit_plane(square, np.array([1.0, -1.0, 1.0, -1.0]))
    assert fit.gradient_per_m == pytest.approx((0.0, 0.0), abs=1e-12)
    assert fit.residual == pytest.approx(1.0)


@pytest.mark.parametrize("across", [0.0, 1e-9, 0.02])
def test_robots_in_a_line_are_refused_with_a_reason(across):
    positions = np.array([[0.0, 0.0], [1.0, across], [2.0, 0.0]])
    fit = fit_plane(positions, np.array([1.0, 2.0, 3.0]))
    assert fit.gradient_per_m is None
    assert "the 3 were in a line" in fit.problem


def test_robots_in_one_place_two_robots_and_none_are_refused_with_a_reason():
    assert "in a line" in fit_plane(np.ones((3, 2)), np.arange(3.0)).problem
    assert "there were 2" in fit_plane(np.eye(2), np.arange(2.0)).problem
    assert "there were none" in fit_plane(np.empty((0, 2)), np.empty(0)).problem


def test_directions_mix_by_their_share_and_one_alone_is_enough():
    assert mixed_direction((0.0, 9.0), 0.0, 0.5) == pytest.approx(np.array([1.0, 1.0]) / math.sqrt(2.0))
    assert mixed_direction((0.0, 9.0), 0.0, 0.0) == pytest.approx([0.0, 1.0])
    assert mixed_direction(None, 0.0, 0.0) == pytest.approx([1.0, 0.0])
    assert mixed_direction((0.0, 2.0), None, 1.0) == pytest.approx([0.0, 1.0])
    assert mixed_direction((-3.0, 0.0), 0.0, 0.5) is None
    assert mixed_direction((0.0, 0.0), None, 0.5) is None


def velocities(positions, offsets, upwind_rad, odour_m):
    return np.array([
        laplacian_velocity_m_s(i, positions, offsets, upwind_rad, odour_m, **GAINS) for i in range(len(positions))
    ])  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_a_formation_in_its_places_moves_as_one(shape):
    """The shape is the equilibrium of the law: no robot moves against another."""
    offsets = in_world(formation(shape, 5, 1.0), 0.7)
    speeds = velocities(offsets + np.array((3.0, 4.0)), offsets, 0.7, 0.0)
    assert speeds == pytest.approx(np.tile(0.3 * np.array([math.cos(0.7), math.sin(0.7)]), (5, 1)))


def test_odour_on_the_left_moves_the_centre_to_the_left():
    offsets = formation("ring", 4, 1.0)
    speeds = velocities(offsets, offsets, math.pi, 1.5)
    # Looking upwind, to -x, left is -y.
    assert speeds.mean(axis=0) == pytest.approx([-0.3, -0.2 * 1.5])


def test_the_odour_lies_where_the_gas_is_and_nowhere_without_gas():
    positions = np.array([[5.0, 1.0], [5.0, 2.0], [5.0, 3.0]])
    assert odour_offset_m(positions, np.array([0.0, 0.0, 4.0]), 0.0) == pytest.approx(1.0)
    assert odour_offset_m(positions, np.array([0.0, 0.0, 4.0]), math.pi) == pytest.approx(-1.0)
    assert odour_offset_m(positions, np.array([2.0, 2.0, 2.0]), 0.0) == pytest.approx(0.0)
    assert odour_offset_m(positions, np.zeros(3), 0.0) == 0.0


@pytest.mark.parametrize(
    ("smells", "width"),
    [([0, 1, 0, 0, 0], 1.1), ([1, 0, 0, 0, 0], 1.0 / 1.1), ([0, 0, 0, 0, 0], 1.0), ([1, 1, 1, 1, 1], 1.1)],
)
def test_a_formation_widens_when_its_edge_smells_and_narrows_when_only_its_middle_does(smells, width):
    slots = formation("square", 5, 1.0)
    changed = next_width(1.0, slots, np.array(smells, bool), change_frac=0.1, least=0.5, most=2.0)
    assert changed == pytest.approx(width)


def test_the_width_keeps_within_its_limits():
    slots = formation("square", 5, 1.0)
    assert next_width(1.95, slots, np.ones(5, bool), change_frac=0.1, least=0.5, most=2.0) == 2.0
    middle = np.array([True, False, False, False, False])
    assert next_width(0.51, slots, middle, change_frac=0.1, least=0.5, most=2.0) == 0.5


def legs(positions, offsets, dt_s):
    return np.array([
        laplacian_leg_m(i, positions, offsets, 0.0, 0.5, dt_s=dt_s, **GAINS) for i in range(len(positions))
    ])  # fmt: skip


def test_a_short_leg_is_the_law_times_its_duration():
    positions, offsets = np.random.default_rng(5).uniform(0.0, 5.0, (5, 2)), formation("square", 5, 1.0)
    assert legs(positions, offsets, 1e-6) / 1e-6 == pytest.approx(velocities(positions, offsets, 0.0, 0.5), rel=1e-4)


def test_a_long_leg_ends_in_the_formation_and_never_beyond():
    positions, offsets = np.random.default_rng(6).uniform(0.0, 5.0, (5, 2)), formation("square", 5, 1.0)
    ends = positions + legs(positions, offsets, 30.0)
    assert ends - ends.mean(axis=0) == pytest.approx(offsets - offsets.mean(axis=0), abs=1e-6)
    assert ends.mean(axis=0) - positions.mean(axis=0) == pytest.approx([30.0 * 0.3, 30.0 * 0.2 * 0.5])


class Robot(FormationAgent):
    """Goes where a test says."""

    goal_m = (4.0, 4.0)

    def next_place_m(self, now):
        return np.array(self.goal_m)


def flight(**changes) -> Robot:
    channel = ChannelDescription(name="radio", members=NAMES, range_m=None, delay_ticks=1, max_bytes=1024)
    agent_briefing = build_briefing(agent="ada", sensors=SENSORS, channels=(channel,))
    return Robot(agent_briefing, SimpleNamespace(**{**SETTINGS, **changes}))


def seen(time_s, *, ppm=0.0, heard=(), notice=None, upwind_rad=0.0, speed_m_s=0.5) -> Observation:
    readings = {"nose": ppm, "vane": (speed_m_s, upwind_rad)}
    return observation(
        tick=round(time_s * 10), name="ada", time_s=time_s, position_m=(*PLACES_M["ada"], 1.0), notice=notice,
        heard=heard, readings=readings,
    )  # fmt: skip


def says(name, number, time_s, *, amount=0.0, best=None, wind_m_s=(-0.5, 0.0)):
    report = Report(
        time_s=time_s, position_m=(*PLACES_M[name], 1.0), amount=amount, wind_m_s=wind_m_s, best=best, numbers=(number,)
    )
    return name, encode(report, max_bytes=1024)


def play_round(team, time_s, *, ppm=0.0, **of_the_others):
    """Let ada read, hear the two others a moment later, and return what she does then."""
    number = team.rounds.number
    first = seen(time_s, ppm=ppm)
    team.observe(first)
    assert team.decide(first).kind == "hold"
    then = seen(time_s + 0.2, ppm=ppm, heard=[says(name, number, time_s, **of_the_others) for name in ("bob", "cyd")])
    team.observe(then)
    return team.decide(then)


def test_it_waits_for_the_others_and_sends_them_its_own_reading_meanwhile():
    team, first = flight(), seen(1.0, ppm=2.0)
    team.observe(first)
    waiting = team.decide(first)
    assert waiting.kind == "hold"
    assert waiting.hold_s < 1.0
    assert waiting.outgoing


def test_the_best_place_of_all_is_known_and_is_forgotten_when_its_gas_is_old():
    team = flight()
    elsewhere = ReportedBest(position_m=(7.0, 7.0, 1.0), amount=8.0)
    play_round(team, 1.0, ppm=2.0, amount=1.0, best=elsewhere)
    assert team.best.place_m == (7.0, 7.0)
    play_round(team, 31.0, ppm=2.0)
    assert team.best.place_m == PLACES_M["ada"]
    play_round(team, 90.0)
    assert team.best is None


def test_the_wind_is_that_of_the_team_and_calm_air_keeps_the_last_direction():
    team = flight()
    play_round(team, 1.0)
    assert team.upwind_rad == pytest.approx(0.0, abs=1e-9)
    for i in range(2, 9):
        number = team.rounds.number
        calm = seen(3.0 * i, speed_m_s=0.0, heard=[says(n, number, 3.0 * i, wind_m_s=(0.0, 0.0)) for n in NAMES[1:]])
        team.observe(calm)
        team.decide(calm)
        team.decide(seen(3.0 * i + 0.2, speed_m_s=0.0))
    assert team.wind.is_calm
    assert team.upwind_rad == pytest.approx(0.0, abs=1e-9)


def test_a_step_ends_in_the_room_and_shows_the_reading_again():
    team = flight()
    team.goal_m = (20.0, 4.0)
    leg = play_round(team, 1.0)
    assert leg.kind == "waypoint"
    assert leg.position_world_m == pytest.approx((8.5, 4.0, 1.0))
    assert leg.outgoing


def test_a_refused_step_is_not_flown_again_as_it_was():
    team = flight()
    team.goal_m = (6.0, 4.0)
    first = play_round(team, 1.0)
    team.observe(seen(3.0, notice="in an obstacle"))
    assert play_round(team, 5.0).position_world_m != first.position_world_m


@pytest.mark.parametrize(("ppm", "is_declared"), [(2.0, True), (0.4, False)])
def test_all_near_a_place_with_much_gas_for_long_is_a_declaration_said_once(ppm, is_declared):
    team = flight()
    commands = [play_round(team, 1.0 + 2.0 * i, ppm=ppm) for i in range(8)]
    said = [command for command in commands if command.declaration is not None]
    assert len(said) == int(is_declared)
    if said:
        assert said[0].declaration.position_world_m == pytest.approx((*PLACES_M["ada"], 1.0))
        assert said[0].outgoing


def test_without_gas_it_searches_lanes_and_after_gas_about_where_it_was():
    team = flight()
    play_round(team, 1.0)
    here = np.array([4.0, 4.0])
    lanes = {"lane_m": 3.0, "inset_m": 0.5}
    first = team.searching_centre_m(here, **lanes)
    assert not np.allclose(first, here)
    team.met_gas(here, **lanes)
    casts = [team.searching_centre_m(here, **lanes) for _ in range(2)]
    # The wind comes from +x: a cast goes along y, to either side.
    assert sorted(place[1] for place in casts) == pytest.approx([3.0, 5.0])


def points_on(lanes_m, n=2000):
    length = np.hypot(*np.diff(lanes_m, axis=0).T).sum()
    return np.array([find_lane_point(lanes_m, length * i / n * (1.0 - 1e-9)) for i in range(n)])


@pytest.mark.parametrize("upwind_rad", [0.0, 0.6, math.pi / 2.0, 2.5, math.pi, -1.4])
def test_no_place_of_the_room_is_farther_than_half_a_lane_from_the_lanes(upwind_rad):
    path = points_on(plan_crosswind_lanes(ROOM, upwind_rad, 2.0))
    places = np.random.default_rng(1).uniform(ROOM.min_m[:2], ROOM.max_m[:2], (200, 2))
    nearest = np.min(np.hypot(*(places[:, None] - path[None]).transpose(2, 0, 1)), axis=1)
    assert nearest.max() <= 1.0 + 0.05


@pytest.mark.parametrize(("upwind_rad", "axis", "sign"), [(0.3, 0, 1), (math.pi, 0, -1), (1.2, 1, 1), (-1.5, 1, -1)])
def test_lanes_lie_across_the_wind_and_go_up_it(upwind_rad, axis, sign):
    lanes_m = plan_crosswind_lanes(ROOM, upwind_rad, 2.0)
    lanes = lanes_m[::2, axis]
    assert lanes_m[1::2, axis] == pytest.approx(lanes)
    assert np.all(sign * np.diff(lanes) > 0.0)


def test_a_step_leads_along_the_lanes_and_from_its_end_to_its_beginning():
    lanes_m = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]])
    assert find_next_lane_point(lanes_m, (1.0, 0.3), 1.0) == pytest.approx([2.0, 0.0])
    assert find_next_lane_point(lanes_m, (3.5, 0.0), 1.0) == pytest.approx([4.0, 0.5])
    assert find_next_lane_point(lanes_m, (4.0, 0.0), 1.0) == pytest.approx([4.0, 1.0])
    assert find_next_lane_point(lanes_m, (0.3, 2.0), 1.0) == pytest.approx([0.0, 2.0])
    assert find_next_lane_point(lanes_m, (0.0, 2.0), 1.0) == pytest.approx([0.0, 0.0])


def test_distances_beyond_the_end_of_the_lanes_begin_again():
    lanes_m = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert find_lane_point(lanes_m, 5.0) == pytest.approx([1.0, 0.0])
    assert find_lane_point(np.array([[2.0, 2.0], [2.0, 2.0]]), 5.0) == pytest.approx([2.0, 2.0])


def test_lost_gas_is_cast_for_to_both_sides_of_where_it_was_and_then_the_lanes_go_on():
    lanes_m = plan_crosswind_lanes(ROOM, math.pi / 2.0, 2.0)
    memory = PlumeMemory(lanes_m, step_m=1.0, cast_m=1.0, n_casts=2)
    assert memory.next_place_m((7.0, 2.0)) == pytest.approx(find_next_lane_point(lanes_m, (7.0, 2.0), 1.0))
    memory.met_gas((7.0, 4.0), math.pi / 2.0)
    assert memory.next_place_m((7.0, 5.0)) == pytest.approx([6.0, 4.0])
    assert memory.next_place_m((6.0, 4.0)) == pytest.approx([8.0, 4.0])
    assert memory.next_place_m((8.0, 4.0)) == pytest.approx(find_next_lane_point(lanes_m, (8.0, 4.0), 1.0))


def test_the_nearest_axis_of_a_heading():
    assert [nearest_axis_rad(a) for a in (0.2, 1.4, 3.0, -1.7)] == pytest.approx(
        [0.0, math.pi / 2.0, math.pi, -math.pi / 2.0]
    )
