import math

import numpy as np
import pytest
from briefings import briefing, observation, task_of

from gslcosim.contract.messages import Bounds, Task
from gslcosim.scenario.models.success import DeclarationSuccess, SourceSuccess
from gslcosim_agents.e_coli.agent import EColi
from gslcosim_agents.surge_cast.agent import SurgeCast
from gslcosim_agents.sweep.agent import Sweep
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion import declaration
from gslcosim_search.motion.declaration import (
    DeclarationGuard,
    Estimate,
    MissionDeclarer,
    PlumeEndRule,
    ReactiveDeclarer,
    ReactiveRule,
    SwarmRule,
    UnchangedRule,
)
from gslcosim_search.senses.instruments import Nose, find_noses

EAST_RAD = 0.0  # the wind comes from +x
WEST_RAD = math.pi  # the wind comes from -x
DECLARE, ARRIVE = task_of(DeclarationSuccess()), task_of(SourceSuccess())
# A source at x = 4 m above the nose: the most gas is met 2 m downwind of it.
GAS = [(8.0, 4.0), (7.0, 6.0), (6.0, 9.0), (5.0, 6.0), (4.3, 2.0)]
PLUME = [*GAS, (3.0, 0.0), (2.0, 0.05), (1.0, 0.0)]


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


def end_estimates(readings=PLUME, *, upwind_rad=WEST_RAD, at_s=(20.0, 119.0, 121.0), **changes):
    """Return the estimates at some times, after one reading (x, gas) a second."""
    rule = PlumeEndRule(**({"threshold": 0.1, "wait_s": 100.0, "latest_s": 270.0} | changes))
    for i, (x_m, gas) in enumerate(readings):
        rule.add(float(i), (x_m, 5.0), gas, upwind_rad)
    return [rule.estimate(time_s) for time_s in at_s]


def test_the_upwind_end_is_declared_once_it_has_stayed():
    early, still_early, found = end_estimates()
    assert early is None
    assert still_early is None
    assert found.position_m == pytest.approx(((5.0 * 6 + 4.3 * 2) / 8, 5.0))
    assert found.confidence == pytest.approx(8 / 27)


def test_near_the_time_limit_it_is_declared_whether_it_has_stayed_or_not():
    assert end_estimates(at_s=(269.0,)) == [None]
    assert end_estimates(at_s=(270.0,))[0] is not None


def test_an_end_that_moves_is_waited_for_again():
    rule = PlumeEndRule(threshold=0.1, wait_s=100.0, latest_s=900.0)
    for time_s, x_m in enumerate([5.0, 4.0, 3.0]):
        rule.add(float(time_s), (x_m, 5.0), 0.0, WEST_RAD)
    said = []
    for time_s, x_m in [(0.0, 8.0), (90.0, 6.0), (150.0, 6.0), (189.0, 6.0), (190.0, 6.0)]:
        rule.add(time_s, (x_m, 5.0), 9.0, WEST_RAD)
        said.append(rule.estimate(time_s) is not None)
    assert said == [False, False, False, False, True]


@pytest.mark.parametrize(
    "behind",
    [
        [],  # nobody was there
        [(3.0, 0.0), (2.0, 0.0)],  # too few readings
        [(3.6, 0.0), (3.8, 0.0), (4.0, 0.0)],  # too near
        [(0.2, 0.0), (0.1, 0.0), (0.0, 0.0)],  # too far
        [(3.0, 0.0), (2.0, 0.0), (1.0, 0.0), (3.0, 0.2), (2.0, 0.2), (1.0, 0.2)],  # gas goes on there
    ],
)
def test_an_end_is_waited_with_until_the_air_behind_it_is_clean(behind):
    _, waited, late = end_estimates([*GAS, *behind], at_s=(20.0, 250.0, 270.0))
    assert waited is None
    shares = [gas == 0.0 for x_m, gas in behind if 0.3 <= x_m <= 3.3]
    assert late.confidence == pytest.approx(8 / 27 * sum(shares) / max(1, len(shares)))
    assert end_estimates([*GAS, *behind, *[(2.5, 0.0)] * 4], at_s=(20.0, 250.0))[1] is not None


@pytest.mark.parametrize(("min_x_m", "is_declared"), [(3.5, True), (3.0, False)])
def test_no_clean_air_is_asked_for_behind_the_bounds(min_x_m, is_declared):
    bounds = Bounds(min_m=(min_x_m, 0.0, 0.0), max_m=(15.0, 10.0, 4.0))
    assert (end_estimates(GAS, at_s=(20.0, 250.0), bounds=bounds)[1] is not None) == is_declared


def test_without_a_wind_the_most_gas_is_declared():
    (found,) = end_estimates(upwind_rad=None, at_s=(270.0,))
    assert found.position_m == pytest.approx((6.0, 5.0), abs=0.1)


@pytest.mark.parametrize(
    "readings",
    [
        [(x_m, gas / 20) for x_m, gas in PLUME],  # too little gas
        [(x_m, math.inf) for x_m, _ in PLUME],  # a broken sensor
        [],
    ],
)
def test_without_enough_gas_nothing_is_declared(readings):
    assert end_estimates(readings, at_s=(270.0,)) == [None]


def declared_m(task: Task | None, *, sensor: str = "pid", values=(0.0, 5.0), **parameters):
    """Where a watch that has met gas at x = 7 m sees the source at the end of the time."""
    one = briefing(sensors=((sensor, "nose"),), task=task)
    watch = MissionDeclarer(one, find_noses(one)[0], **parameters)
    clean, gas = values
    for tick in range(200):
        at_m = (7.0 if 80 <= tick < 120 else 2.0, 5.0, 2.0)
        watch.add(observation(tick=tick, position_m=at_m, readings={"nose": gas if at_m[0] > 5.0 else clean}))
    late = observation(tick=200).model_copy(update={"time_s": 299.0})
    found = watch.estimate(late)
    return None if found is None else found.position_m


def test_a_nose_in_ppm_and_one_in_ohms_see_the_same_end():
    assert declared_m(DECLARE) == pytest.approx((7.0, 5.0, 2.0))
    assert declared_m(DECLARE, sensor="tgs2600", values=(40e3, 20e3)) == pytest.approx((7.0, 5.0, 2.0))


def test_clean_air_another_task_and_the_setting_declare_nothing():
    assert declared_m(DECLARE, values=(0.0, 0.0)) is None
    assert declared_m(ARRIVE) is None
    assert declared_m(None) is None
    assert declared_m(DECLARE, plume_end="never") is None


@pytest.mark.parametrize("agent_type", [SurgeCast, EColi])
@pytest.mark.parametrize("task", [DECLARE, ARRIVE], ids=["declare", "arrive"])
def test_reactive_methods_declare_late_where_the_task_asks_for_it(agent_type, task):
    agent = agent_type(briefing(sensors=(("pid", "nose"), ("anemometer", "vane")), task=task))
    said = []
    for i, ppm in enumerate([5.0, 0.0, 0.0]):
        readings = {"nose": ppm, "vane": (0.5, WEST_RAD)}
        seen = observation(tick=40 + 400 * i, position_m=(7.0 - i, 5.0, 2.0), readings=readings)
        agent.observe(seen := seen.model_copy(update={"time_s": 1.0 + 140.0 * i}))
        said.append(agent.decide(seen))
    places = [command.declaration.position_world_m for command in said if command.declaration is not None]
    assert places == ([pytest.approx((7.0, 5.0, 2.0))] if task is DECLARE else [])


def test_the_blind_guess_is_the_middle_of_the_room_once():
    agent = Sweep(briefing(parameters={"guesses": True}))
    first, second = (agent.decide(observation(tick=tick)) for tick in (1, 2))
    assert first.declaration.position_world_m == (7.5, 5.0, 2.0)
    assert first.declaration.confidence == 0.0
    assert second.kind == "mission"


def test_a_nose_of_hits_counts_them():
    one = briefing(sensors=(("binary", "nose"),), task=DECLARE)
    watch = MissionDeclarer(one, Nose(name="nose", unit="1", mount_body_m=(0.0, 0.0, 0.0)))
    watch.add(observation(tick=1, readings={"nose": 1.0}))
    assert watch.estimate(observation(tick=2).model_copy(update={"time_s": 299.0})) is not None
