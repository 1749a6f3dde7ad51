import math
from types import SimpleNamespace

import pytest
from briefings import briefing, observation, task_of

from gslcosim.agent_kit import Command
from gslcosim.scenario.models.success import DeclarationSuccess
from gslcosim_search.reactive.reactive_searcher import LossPoints, ReactiveAgent
from gslcosim_search.senses.stop_and_measure import Contact

SETTINGS = {
    "margin_m": 1.0, "hold_s": None, "explore_hold_s": 0.0, "explore_step_m": 1.8, "threshold_ppm": 0.1,
    "threshold_m_s": 0.1, "leash_legs": 5, "leash_m": 1.0, "leash_away_legs": 3, "declares": True,
}  # fmt: skip
WEST_RAD = math.pi  # the wind comes from -x, the source is where x is least


class Searcher(ReactiveAgent):
    """Holds at every stop, and notes the contact that it was given."""

    may_abort = False

    def next_step(self, observation, contact):
        self.contact = contact
        return Command(tick=observation.tick, kind="hold")


def searcher(mode="on_request", task=None, **changes):
    agent_briefing = briefing(sensors=(("pid", "nose"), ("anemometer", "vane")), mode=mode, task=task)
    return Searcher(agent_briefing, SimpleNamespace(**SETTINGS | changes))


def at(tick, place_m=(7.0, 5.0, 2.0), *, ppm=0.0, notice=None, status="holding"):
    readings = {"nose": ppm, "vane": (0.5, 0.0)}
    return observation(tick=tick, position_m=place_m, readings=readings, notice=notice, status=status)


def test_holds_are_those_of_the_settings():
    flown = searcher(hold_s=1.5)
    assert flown.fly_to(at(10), (8.0, 5.0)).hold_s == 1.5
    assert flown.cast_to(at(10), (8.0, 5.0)).hold_s == 0.0
    assert searcher().fly_to(at(10), (8.0, 5.0)).hold_s is None


def test_a_stuck_searcher_is_sent_away_for_some_legs():
    flown = searcher()
    for tick in range(5):
        assert not flown.is_away
        flown.decide(at(10 + tick, ppm=1.0))
    away = []
    for tick in range(5):
        away.append(flown.is_away)
        flown.explore(at(20 + tick))
    assert away == [True, True, True, False, False]


def test_a_place_that_was_refused_is_not_explored_again():
    flown = searcher()
    first_m = flown.explore(at(1)).position_world_m
    ends = [flown.explore(at(2 + i, notice="in an obstacle")).position_world_m for i in range(20)]
    assert first_m not in ends


def test_following_leaves_out_what_lies_behind_a_wall():
    places = [(20.0, 5.0), (15.0, 5.0), (13.0, 7.0), (0.0, 0.0)]
    flown = searcher()
    following = iter(places)
    command = flown.follow(at(1, (14.0, 5.0, 2.0)), lambda: next(following, None))
    assert command is not None
    assert command.position_world_m == (13.0, 7.0, 2.0)
    assert flown.follow(at(1), lambda: None) is None


def test_a_leg_under_way_goes_on_unless_gas_may_end_it():
    flown = searcher(mode="lockstep")
    flown.cast_to(at(10), (8.0, 5.0))
    assert flown.decide(at(20, ppm=1.0, status="flying")).kind == "noop"
    flown.may_abort = True
    assert flown.decide(at(21, ppm=0.0, status="flying")).kind == "noop"
    assert flown.decide(at(22, ppm=1.0, status="flying")).kind == "hold"


def legs_around_the_source(flown, declares=True):
    """Legs that find gas up to a place and none upwind (towards +x) of it; returns what was declared."""
    places = [(7.0, 5.0, 2.0), (7.6, 5.0, 2.0), (8.2, 5.0, 2.0), (6.6, 5.2, 2.0)]
    answers = [flown.decide(at(10 + i, places[i % 4], ppm=0.0 if i % 4 == 2 else 2.0)) for i in range(40)]
    return [answer for answer in answers if answer.kind == "declare_source"]


def test_it_declares_where_the_gas_ends_upwind_once():
    declared = legs_around_the_source(searcher(leash_legs=0))
    assert len(declared) == 1
    x_m, y_m, z_m = declared[0].declaration.position_world_m
    assert (x_m, y_m, z_m) == pytest.approx((7.07, 5.07, 2.0), abs=0.05)
    assert declared[0].declaration.confidence == pytest.approx(0.75)


def detections(places, *, n=3, spread_m=1.0, upwind_rad=WEST_RAD):
    found = LossPoints(n=n, spread_m=spread_m)
    for place in places:
        found.add(place, upwind_rad)
    return found


def test_the_source_is_declared_farthest_upwind_once_the_places_draw_together():
    places = [(9.0, 5.0, 2.0), (2.4, 5.1, 2.0), (2.0, 5.0, 2.0), (2.9, 4.8, 2.0)]
    assert detections(places[:3]).estimate(WEST_RAD) is None
    estimate = detections(places).estimate(WEST_RAD)
    assert estimate is not None
    assert estimate.position_m == (2.0, 5.0, 2.0)
    assert estimate.confidence == 1.0


def test_too_few_places_or_a_spread_as_long_as_allowed_declare_nothing():
    assert detections([(2.0, 5.0, 2.0), (2.0, 5.0, 2.0)]).estimate(WEST_RAD) is None
    assert detections([(2.0, 5.0, 2.0), (2.0, 5.0, 2.0), (3.0, 5.0, 2.0)]).estimate(WEST_RAD) is None


@pytest.mark.parametrize("turn_rad", [0.5, 2.0, -1.3])
def test_the_rule_turns_with_the_wind(turn_rad):
    places = [(2.0, 5.0, 2.0), (2.4, 5.1, 2.0), (2.9, 4.8, 2.0)]
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turned = [(c * x - s * y, s * x + c * y, z) for x, y, z in places]
    estimate = detections(turned, upwind_rad=WEST_RAD + turn_rad).estimate(WEST_RAD + turn_rad)
    assert estimate is not None
    assert estimate.position_m == turned[0]


def test_losses_that_agree_are_declared_where_no_posterior_is():
    def lose(flown):
        contact = Contact(
            has_gas=False, gas_m=None, last_m=(7.0, 5.0, 2.0), since_hit_s=9.0, upwind_rad=WEST_RAD, is_calm=False,
            gas_ppm=0.0,
        )  # fmt: skip
        return [flown.lose(at(10 + i), contact, WEST_RAD) for i in range(6)][-1]

    assert lose(searcher()).kind == "declare_source"
    asked = searcher(task=task_of(DeclarationSuccess()))
    assert lose(asked) is None
    assert lose(searcher(task=task_of(DeclarationSuccess()), plume_fit="never")).kind == "declare_source"
