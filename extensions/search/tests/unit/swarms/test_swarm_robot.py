import math
from types import SimpleNamespace

import numpy as np
import pytest
from briefings import observation, sensor
from built_messages import build_briefing

from gslcosim.contract.messages import Bounds, ChannelDescription, Observation
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.senses.instruments import Nose
from gslcosim_search.senses.stop_and_measure import Measurement
from gslcosim_search.swarms.swarm_robot import Explorer, GasScale, Particle

SETTINGS = SimpleNamespace(
    gas_floor=0.1, mox_band_frac=0.02, fades_s=0.0, declares=True, near_m=1.5, near_s=20.0, unchanged_s=60.0,
    leg_m=1.0, wall_margin_m=1.0, search_inertia=0.3, search_draw=0.7, waypoint_s=30.0, repel_m=1.5,
    inertia=0.5, own=0.0, swarm=0.0,
)  # fmt: skip
ROOM = LegSpace(min_m=(1.0, 1.0, 0.5), max_m=(9.0, 9.0, 2.5))


def measured(value: float, ppm: float) -> Measurement:
    return Measurement(
        position_world_m=(0.0, 0.0, 0.0), values=(value,), amounts=(value,), ppm=(ppm,), wind=None, n_samples=1
    )


def nose(unit: str, *, estimate: str | None = None) -> Nose:
    return Nose(name="nose", unit=unit, mount_body_m=(0.0, 0.0, 0.0), estimate=estimate)


def particle(*, name: str = "one", **changes) -> Particle:
    sensors = (sensor("pid", "nose"), sensor("anemometer", "vane"))
    channel = ChannelDescription(
        name="radio", members=("one", "two", "three"), range_m=None, delay_ticks=1, max_bytes=64
    )
    return Particle(
        build_briefing(
            agent=name,
            seed=5,
            bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=(10.0, 10.0, 3.0)),
            sensors=sensors,
            channels=(channel,),
        ),
        SimpleNamespace(**{**vars(SETTINGS), **changes}),
    )


def seen(ppm=0.0, *, time_s=10.0, place_m=(5.0, 5.0), heard=(), wind=(0.5, 0.0), notice=None) -> Observation:
    return observation(
        tick=round(10 * time_s), name="one", time_s=time_s, position_m=(*place_m, 1.0), notice=notice, heard=heard,
        readings={"nose": float(ppm), "vane": wind},
    )  # fmt: skip


def taken(robot: Particle, observation: Observation) -> Particle:
    robot.observe(observation)
    robot.take(observation)
    return robot


def test_ppm_count_above_the_floor_only():
    smell = GasScale(nose("ppm"), floor=0.1, band_frac=0.02)
    assert [smell.amount(measured(value, value)) for value in (0.0, 0.1, 0.11, 50.0)] == [0.0, 0.0, 0.11, 50.0]


def test_a_resistance_counts_outside_the_dead_band_by_its_estimate():
    """Just below clean air the estimate jumps to the sensor's floor: with noise, clean air would be full of gas."""
    smell = GasScale(nose("ohm", estimate="nose_ppm"), floor=0.1, band_frac=0.02)
    shown = [(50_000.0, 0.0), (49_500.0, 0.31), (45_000.0, 0.42), (20_000.0, 5.0)]
    assert [smell.amount(measured(*pair)) for pair in shown] == [0.0, 0.0, 0.42, 5.0]


def test_a_resistance_without_an_estimate_counts_by_its_conductance_beyond_air():
    smell = GasScale(nose("ohm"), floor=0.1, band_frac=0.02)
    assert [smell.amount(measured(ohm, ohm)) for ohm in (50_000.0, 40_000.0, 0.0)] == [0.0, 0.25, 0.0]


def test_explorers_reach_their_waypoints_and_take_others_inside_the_room():
    explorer, place, targets = (
        Explorer(ROOM, RandomStream(3), inertia=0.3, draw=0.7, waypoint_s=30.0),
        np.array([2.0, 2.0]),
        [],
    )
    for i in range(200):
        step = explorer.step(place, 2.0 * i, 1.0)
        assert np.hypot(*step) <= 1.0 + 1e-9
        place = place + step
        targets.append(tuple(place))
        assert ROOM.contains(tuple(place))
    assert np.ptp([x for x, _ in targets]) > 4.0
    assert np.ptp([y for _, y in targets]) > 4.0


def test_a_waypoint_is_given_up_after_its_time():
    explorer, place = Explorer(ROOM, RandomStream(3), inertia=0.0, draw=1.0, waypoint_s=30.0), np.array([2.0, 2.0])
    first = explorer.step(place, 0.0, 1.0)
    assert explorer.step(place, 30.0, 1.0) == pytest.approx(first)
    assert explorer.step(place, 30.1, 1.0) != pytest.approx(first)


def test_the_own_best_stays_when_the_robot_flies_on_to_less_gas():
    """The fault of a best that shares memory with the place: p_i must differ from x_i after a worse reading."""
    robot = taken(particle(), seen(5.0, place_m=(5.0, 5.0)))
    taken(robot, seen(4.0, time_s=13.0, place_m=(6.0, 5.0)))
    assert robot.own_best.place_m == (5.0, 5.0)
    assert robot.place_m.tolist() == [6.0, 5.0]
    assert robot.swarm_best().place_m == (5.0, 5.0)


def test_the_swarms_best_is_the_most_that_any_robot_reported():
    robot = taken(
        particle(), seen(5.0, heard=[("two", "g 90 100 100 100 3 b200 300 100 8"), ("three", "g 90 1 1 1 7")])
    )
    assert (robot.swarm_best().place_m, robot.swarm_best().amount) == ((2.0, 3.0), 8.0)


def test_bests_of_others_fade_from_when_they_were_sent():
    robot = taken(particle(fades_s=60.0), seen(5.0, heard=[("two", "g 90 100 100 100 3 b200 300 100 8")]))
    assert robot.swarm_best().amount == pytest.approx(8.0 * math.exp(-1.0 / 60.0))
    taken(robot, seen(0.0, time_s=70.0))
    assert robot.swarm_best().amount == pytest.approx(8.0 * math.exp(-61.0 / 60.0))


def test_what_is_ignored_counts_neither_here_nor_from_others():
    robot = particle()
    robot.is_ignored = lambda place_m: place_m[0] < 6.0
    taken(robot, seen(5.0, heard=[("two", "g 90 700 100 100 3 b200 300 100 8")]))
    assert robot.amount == 0.0
    assert robot.swarm_best().place_m == (7.0, 1.0)


def test_who_forgets_receives_again():
    robot = taken(particle(), seen(5.0, heard=[("two", "g 90 100 100 100 3 b200 300 100 8")]))
    robot.forget()
    assert robot.swarm_best() is None
    assert robot.others_m().tolist() == [[1.0, 1.0]]
    taken(robot, seen(0.0, time_s=13.0, heard=[("two", "g 120 100 100 100 3")]))
    assert robot.swarm_best().amount == 3.0


def test_the_lost_are_not_where_they_were():
    robot = taken(particle(), seen(heard=[("two", "g 90 100 100 100 0")]))
    taken(robot, seen(time_s=39.0))
    assert len(robot.others_m()) == 1
    taken(robot, seen(time_s=39.2))
    assert len(robot.others_m()) == 0


def test_who_is_near_is_flown_away_from_instead():
    robot = taken(particle(), seen(5.0, heard=[("two", "g 90 500 400 100 0")]))
    step = robot.swarm_step(robot.swarm_best(), lambda best: np.array([0.0, -1.0]))
    assert step == pytest.approx([0.0, 1.0])
    alone = taken(particle(repel_m=0.0), seen(5.0, heard=[("two", "g 90 500 400 100 0")]))
    assert alone.swarm_step(alone.swarm_best(), lambda best: np.array([0.0, -1.0])) == pytest.approx([0.0, -1.0])


def test_a_step_out_of_the_room_is_drawn_again():
    robot = taken(particle(), seen(5.0, place_m=(8.9, 5.0)))
    draws = iter([(1.0, 0.0), (0.9, 0.0), (0.0, 0.5), (0.0, 0.7)])
    assert robot.drawn_inside(lambda: np.array(next(draws))).tolist() == [0.0, 0.5]
    assert np.hypot(*robot.drawn_inside(lambda: np.array([-3.0, 4.0]))) == pytest.approx(1.0)


def test_the_step_that_was_flown_is_the_velocity_of_the_next():
    """A step cut by a wall counts as far as it went."""
    robot = taken(particle(), seen(5.0, place_m=(8.6, 5.0)))
    robot.leg(seen(place_m=(8.6, 5.0)), np.array([1.0, 0.0]))
    assert robot.step_m == pytest.approx([0.4, 0.0], abs=2e-3)
    robot.own_best = None
    step = robot.track(taken(robot, seen(6.0)).own_best)
    assert step == pytest.approx([0.2, 0.0], abs=2e-3)


def test_who_does_not_send_keeps_a_declaration_for_nearness_back():
    robot = particle(unchanged_s=1000.0)
    for i in range(30):
        now = seen(5.0, time_s=10.0 + i, heard=[("two", f"g {100 + 10 * i} 500 500 100 0")])
        assert robot.decide(now).declaration is None
    for i in range(30, 60):
        both = [(other, f"g {100 + 10 * i} 500 500 100 0") for other in ("two", "three")]
        command = robot.decide(seen(5.0, time_s=10.0 + i, heard=both))
        if command.declaration is not None:
            break
    assert command.declaration.confidence == 1.0
    assert 10.0 + i == pytest.approx(10.0 + 30 + 20)
