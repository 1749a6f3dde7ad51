from types import SimpleNamespace

import numpy as np
import pytest
from briefings import observation, sensor
from built_messages import build_briefing

from gslcosim.agent_kit import Observation
from gslcosim.contract.messages import ChannelDescription
from gslcosim_search.swarms.formations import FormationAgent, formation
from gslcosim_search.swarms.rounds import Report, ReportedBest, encode

NAMES = ("ada", "bob", "cyd")
SETTINGS = {
    "wall_margin_m": 0.5, "hold_s": 1.0, "gas_floor": 0.1, "mox_band_frac": 0.02, "calm_m_s": 0.05, "timeout_s": 2.0,
    "fades_s": 10.0, "declares": True, "near_m": 1.5, "near_s": 3.0, "unchanged_s": 100.0, "declare_factor": 5.0,
    "search_step_m": 2.0, "cast_m": 1.0, "n_casts": 2,
}  # fmt: skip
SENSORS = (sensor("pid", "nose"), sensor("anemometer", "vane"))
PLACES_M = {"ada": (4.0, 4.0), "bob": (5.0, 4.0), "cyd": (4.0, 5.0)}


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


def test_gas_up_to_the_floor_is_none():
    team = flight()
    play_round(team, 1.0, ppm=0.1, amount=0.0)
    assert not team.now.has_gas
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


def test_the_centre_is_where_the_slots_say():
    team = flight()
    offsets = formation("ring", 3, 1.0)
    play_round(team, 1.0)
    places = np.array([PLACES_M[name] for name in NAMES])
    assert team.centre_of(team.now, offsets) == pytest.approx((places - offsets).mean(axis=0))


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


def test_a_team_that_is_not_to_declare_never_does():
    team = flight(declares=False)
    assert {play_round(team, 1.0 + 2.0 * i, ppm=3.0).kind for i in range(8)} == {"waypoint"}


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
