import math

import numpy as np
import pytest
from briefings import observation

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion import declaration
from gslcosim_search.motion.declaration import (
    DeclarationGuard,
    Estimate,
    ReactiveDeclarer,
    ReactiveRule,
    SwarmRule,
    UnchangedRule,
)
from gslcosim_search.senses.instruments import Nose

EAST_RAD = 0.0  # the wind comes from +x


def estimate(x_m, confidence=0.5) -> Estimate:
    return Estimate(position_m=(x_m, 0.0), confidence=confidence)


def test_an_estimate_passes_once_and_again_when_it_moved_or_is_surer():
    declared = DeclarationGuard()
    said = [declared.passes(estimate(*e)) is not None for e in [(1.0,), (1.4,), (1.6,), (1.6, 0.59), (1.6, 0.61)]]
    assert said == [True, False, True, False, True]
    assert declared.passes(None) is None
    assert declared.last == estimate(1.6, 0.61)


def ruled(stops, *, upwind_rad=EAST_RAD, n_legs=4, **parameters) -> Estimate | None:
    rule = ReactiveRule(threshold=0.1, n_legs=n_legs, **parameters)
    for x_m, y_m, gas in stops:
        rule.add((x_m, y_m), gas)
    return rule.estimate(upwind_rad)


AT_THE_SOURCE = [(0.0, 0.0, 2.0), (-0.5, 0.3, 4.0), (0.0, 0.5, 2.0), (1.1, 0.0, 0.0)]


def test_gas_that_ends_upwind_is_declared_at_its_centre():
    found = ruled(AT_THE_SOURCE)
    assert found.confidence == 0.75
    assert found.position_m == pytest.approx((-0.25, 0.275))


@pytest.mark.parametrize(
    ("stops", "changes"),
    [
        (AT_THE_SOURCE[1:], {}),  # too few legs
        ([*AT_THE_SOURCE[:3], (3.0, 0.0, 0.0)], {}),  # not together
        ([(x, y, gas / 10) for x, y, gas in AT_THE_SOURCE], {}),  # not enough gas
        (AT_THE_SOURCE, {"upwind_rad": math.pi}),  # nothing was flown upwind of the most gas
        ([*AT_THE_SOURCE[:3], (1.1, 0.0, 2.1)], {}),  # gas goes on upwind
    ],
)
def test_each_condition_alone_forbids_it(stops, changes):
    assert ruled(stops, **changes) is None


def test_only_the_last_legs_count():
    assert ruled([(9.0, 9.0, 0.0), *AT_THE_SOURCE]) is not None


def ring(n: int, gas: float, radius_m: float = 1.1):
    """Stops evenly around the origin, which has the most gas."""
    angles = [math.tau * i / n for i in range(n)]
    return [(0.0, 0.0, 4.0), *[(radius_m * math.cos(a), radius_m * math.sin(a), gas) for a in angles]]


def test_without_wind_the_gas_must_end_all_around():
    assert ruled(ring(3, 0.1), upwind_rad=None) is not None
    assert ruled(AT_THE_SOURCE, upwind_rad=None) is None  # it ends on one side
    assert ruled([*ring(4, 0.1)[:4], (0.1, 0.1, 0.0)], upwind_rad=None, n_legs=5) is None  # on three of four
    assert ruled([*ring(3, 0.1)[:3], (-0.55, -0.96, 3.0)], upwind_rad=None) is None  # it goes on to one side


STOPS = [((0.3 * (i % 4), 0.3 * (i // 4)), 3.0) for i in range(11)] + [((-1.1, 0.0), 0.0)]


def said_at(declarer: ReactiveDeclarer, stops, **options):
    return [
        declarer.command(observation(tick=i, position_m=(*place_m, 2.0)), ppm, **options)
        for i, (place_m, ppm) in enumerate(stops)
    ]


def declarer(**options) -> ReactiveDeclarer:
    return ReactiveDeclarer(Nose(name="nose", unit="ppm", mount_body_m=(0.0, 0.0, 0.0)), height_m=2.5, **options)


def test_a_reactive_method_declares_once_at_its_height():
    said = said_at(declarer(), [*STOPS, STOPS[-1]], upwind_rad=math.pi)
    assert [command is not None for command in said] == [False] * 11 + [True, False]
    assert said[11].kind == "declare_source"
    assert said[11].declaration.position_world_m[2] == 2.5
    assert said[11].declaration.confidence == pytest.approx(11 / 12)


def test_a_method_in_space_declares_in_space():
    (command,) = [one for one in said_at(declarer(), STOPS, upwind_rad=math.pi, is_planar=False) if one]
    assert command.declaration.position_world_m[2] == pytest.approx(2.0)


def test_questions_at_one_stop_count_once_and_readings_that_mean_nothing_not_at_all():
    assert not any(said_at(declarer(), [STOPS[0]] * 20 + [STOPS[-1]], upwind_rad=math.pi))
    assert not any(said_at(declarer(), [(place_m, None) for place_m, _ in STOPS], upwind_rad=math.pi))
    assert not any(said_at(declarer(is_on=False), STOPS, upwind_rad=math.pi))


def test_a_peak_that_stays_is_declared_and_one_that_moves_starts_again():
    rule = UnchangedRule(n_legs=3)
    assert [rule.add((x, 0.0)) for x in (0.0, 0.4, 0.4, 1.0, 1.0, 1.0)] == [False, False, True, False, False, True]


def test_a_best_place_must_stay_for_a_time():
    rule = UnchangedRule(n_legs=1, for_s=60.0)
    assert [rule.add((0.0, 0.0), time_s=t) for t in (10.0, 69.0, 70.0)] == [False, False, True]


def test_a_swarm_declares_when_all_have_been_near_the_best_for_a_time():
    rule, best_m = SwarmRule(), (1.0, 1.0)
    near, one_away = [(1.0, 2.0), (2.0, 1.0)], [(1.0, 2.0), (3.0, 1.0)]
    assert rule.add(0.0, best_m, near) is None
    assert rule.add(15.0, best_m, one_away) is None
    assert rule.add(16.0, best_m, near) is None
    assert rule.add(35.9, best_m, near) is None
    assert rule.add(36.0, best_m, near) == Estimate(position_m=best_m, confidence=1.0)


def test_a_swarm_declares_an_old_best_with_the_share_that_is_near():
    rule, members_m = SwarmRule(), [(1.0, 2.0), (9.0, 1.0)]
    assert rule.add(0.0, (1.0, 1.0), members_m) is None
    assert rule.add(60.0, (1.0, 1.0), members_m).confidence == 0.5
    assert rule.add(61.0, (1.1, 1.0), members_m) is None
    assert SwarmRule().add(99.0, (1.0, 1.0), []) is None


GRID = CellGrid((0.0, 0.0), 0.5, (20, 12))


def peaked(sigma_m: float, place_m=(4.25, 2.75)):
    squares = ((GRID.centres_m() - place_m) ** 2).sum(axis=1).reshape(GRID.shape)
    p = np.exp(-squares / (2 * sigma_m**2))
    return p / p.sum()


@pytest.mark.parametrize(
    ("rule", "narrow_m", "wide_m"),
    [(declaration.by_variance, 0.45, 0.55), (declaration.by_mass, 0.4, 0.6), (declaration.by_entropy, 0.12, 0.4)],
)
def test_a_narrow_belief_is_declared_at_its_peak_and_a_wide_one_is_not(rule, narrow_m, wide_m):
    found = rule(peaked(narrow_m), GRID)
    assert found.position_m == pytest.approx((4.25, 2.75), abs=0.05)
    assert 0.8 < found.confidence <= 1.0
    assert rule(peaked(wide_m), GRID) is None


def test_particles_declare_when_they_agree():
    places_m = np.array([[1.0, 2.0], [1.2, 2.0], [9.0, 9.0]])
    found = declaration.by_spread(places_m, np.array([3.0, 3.0, 0.0]))
    assert found.position_m == pytest.approx((1.1, 2.0))
    assert found.confidence == 1.0
    assert declaration.by_spread(places_m, np.array([3.0, 3.0, 0.1])) is None
