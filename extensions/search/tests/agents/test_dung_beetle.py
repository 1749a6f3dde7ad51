import math

import briefings
import pytest

from gslcosim.agent_kit import Briefing, Observation
from gslcosim_agents.calling_beetle.agent import CallingBeetle
from gslcosim_agents.dung_beetle.agent import DungBeetle

WEST_WIND_RAD = math.pi  # comes from -x
HERE_M = (7.0, 5.0, 2.0)
CLEAN, GAS = 50_000.0, 20_000.0


def briefing(seed: int = 1) -> Briefing:
    return briefings.briefing(seed=seed, contract_version="1.0", name="beetle")


def observation(
    *, ohm: float, position_m=(7.0, 5.0, 2.0), upwind_rad: float = WEST_WIND_RAD, notice: str | None = None
) -> Observation:
    readings = {"nose": ohm, "vane": (0.5, upwind_rad)}
    return briefings.observation(position_m=position_m, readings=readings, notice=notice, name="beetle")


def leg_of(command, position_m=(7.0, 5.0, 2.0)) -> tuple[float, float]:
    """Length [m] and direction [degrees, counter-clockwise from +x] of the commanded leg."""
    dx, dy = command.position_world_m[0] - position_m[0], command.position_world_m[1] - position_m[1]
    return math.hypot(dx, dy), math.degrees(math.atan2(dy, dx))


def legs(ohms: list[float]) -> list[float]:
    beetle = DungBeetle(briefing())
    return [leg_of(beetle.decide(observation(ohm=ohm)))[1] for ohm in ohms]


def test_it_zigzags_and_swaps_sides_each_time_the_ohms_do_not_fall():
    # Upwind is 180 degrees: 60 left of it is 240 = -120, 60 right of it is 120.
    directions = legs([50_000.0, 49_000.0, 48_000.0, 48_000.0, 47_000.0, 47_500.0, 50_000.0])
    assert directions == pytest.approx([-90.0, -120.0, -120.0, 120.0, 120.0, -120.0, 120.0], abs=0.1)


def test_a_leg_is_80_centimetres_long_at_search_height_and_answers_the_tick():
    command = DungBeetle(briefing()).decide(observation(ohm=50_000.0, position_m=(7.0, 5.0, 1.7)))
    assert leg_of(command)[0] == pytest.approx(0.8, abs=0.001)
    assert command.position_world_m[2] == 2.0
    assert command.tick == 40


def test_a_zigzag_leg_is_mirrored_at_a_wall_and_goes_downwind_in_a_corner():
    beetle = DungBeetle(briefing())
    at_south_wall, in_west_corner = (7.0, 1.2, 2.0), (1.1, 1.2, 2.0)
    beetle.decide(observation(ohm=50_000.0))
    mirrored = beetle.decide(observation(ohm=49_000.0, position_m=at_south_wall))
    assert leg_of(mirrored, at_south_wall)[1] == pytest.approx(120.0, abs=0.1)
    downwind = beetle.decide(observation(ohm=48_000.0, position_m=in_west_corner))
    assert leg_of(downwind, in_west_corner)[1] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_a_seeking_beetle_never_aims_nearer_than_a_metre_to_the_walls(seed):
    beetle = DungBeetle(briefing(seed))
    for position_m in ((1.0, 1.0, 2.0), (14.0, 9.0, 2.0), (7.0, 1.1, 2.0), (0.1, 0.1, 2.0)):
        x_m, y_m, _ = beetle.decide(observation(ohm=50_000.0, position_m=position_m)).position_world_m
        assert 1.0 <= x_m <= 14.0
        assert 1.0 <= y_m <= 9.0


def test_the_generator_is_splitmix64():
    """The published outputs for seed 1234567 (S. Vigna's reference program), to the 53 bits that are used."""
    beetle = DungBeetle(briefing(1_234_567))
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [beetle.random_fraction() for _ in published] == [(value >> 11) / 2**53 for value in published]


def switched(**parameters) -> DungBeetle:
    return DungBeetle(briefing().model_copy(update={"parameters": parameters}))


def turned_wind(i: int) -> float:
    return WEST_WIND_RAD + 0.2 * i


def directions(beetle: DungBeetle, ohms: list[float]) -> list[float]:
    """Directions of its legs [degrees] in a wind that turns by 0.2 rad from decision to decision."""
    seen = [observation(ohm=ohm, upwind_rad=turned_wind(i)) for i, ohm in enumerate(ohms)]
    return [leg_of(beetle.decide(one))[1] % 360 for one in seen]


def test_a_beetle_with_heading_memory_reads_the_wind_only_when_it_changes_sides():
    ohms = [50_000.0, 49_000.0, 48_000.0, 47_000.0, 48_000.0, 47_000.0]
    upwind_deg = [math.degrees(turned_wind(i)) for i in range(6)]
    kept = [upwind_deg[0] + 90, *[upwind_deg[1] + 60] * 3, *[upwind_deg[4] - 60] * 2]
    fresh = [upwind_deg[0] + 90, *[upwind_deg[i] + 60 for i in (1, 2, 3)], *[upwind_deg[i] - 60 for i in (4, 5)]]
    assert directions(switched(heading_memory=True), ohms) == pytest.approx([x % 360 for x in kept], abs=0.1)
    assert directions(switched(), ohms) == pytest.approx([x % 360 for x in fresh], abs=0.1)


def test_a_bouncing_beetle_seeks_on_the_other_side_at_a_wall_and_stays_on_it():
    beetle, at_south_wall = switched(wall_rule="bounce"), (7.0, 1.1, 2.0)
    bounced = beetle.decide(observation(ohm=50_000.0, position_m=at_south_wall))
    assert leg_of(bounced, at_south_wall)[1] == pytest.approx(90.0, abs=0.1)
    assert leg_of(beetle.decide(observation(ohm=50_000.0)))[1] == pytest.approx(90.0, abs=0.1)
    refused = beetle.decide(observation(ohm=50_000.0, notice="in an obstacle"))
    assert leg_of(refused)[1] == pytest.approx(-90.0, abs=0.1)


def test_a_dead_band_keeps_a_small_fall_from_counting():
    beetle = switched(eps=0.01)
    for ohm in (50_000.0, 49_600.0):
        assert leg_of(beetle.decide(observation(ohm=ohm)))[1] == pytest.approx(-90.0, abs=0.1)
    assert leg_of(beetle.decide(observation(ohm=49_000.0)))[1] == pytest.approx(-120.0, abs=0.1)


def test_a_leg_with_a_duration_goes_to_the_same_place():
    timed = switched(leg_s=3.0).decide(observation(ohm=50_000.0))
    assert timed.kind == "mission"
    assert timed.waypoints[0].position_world_m == switched().decide(observation(ohm=50_000.0)).position_world_m
    assert (timed.waypoints[0].after_s, timed.waypoints[0].hold_s) == (3.0, 2.0)


def beetle(*, members=("searcher", "other"), **parameters) -> CallingBeetle:
    return CallingBeetle(briefings.briefing(members=members, parameters=parameters))


def shown(ohm, **changes):
    return briefings.observation(position_m=HERE_M, readings={"nose": ohm, "vane": (0.5, math.pi)}, **changes)


def direction_deg(command):
    x_m, y_m, _ = command.position_world_m
    return math.degrees(math.atan2(y_m - HERE_M[1], x_m - HERE_M[0]))


def test_in_gas_it_calls_with_its_place_and_zigzags():
    caller = beetle()
    assert caller.decide(shown(CLEAN)).outgoing == ()
    commands = [caller.decide(shown(GAS)) for _ in range(2)]
    assert [message.text for command in commands for message in command.outgoing] == ["7.00 5.00"] * 2
    assert sorted(abs(direction_deg(command)) for command in commands) == pytest.approx([120.0, 120.0])
    assert direction_deg(commands[0]) == pytest.approx(-direction_deg(commands[1]))


def test_called_it_comes_until_it_is_near():
    called = beetle()
    called.observe(shown(CLEAN, asked=False, heard=[("other", "10.00 5.00")]))
    assert direction_deg(called.decide(shown(CLEAN))) == pytest.approx(0.0)
    called.observe(shown(CLEAN, asked=False, heard=[("other", "7.50 5.00")]))
    assert abs(direction_deg(called.decide(shown(CLEAN)))) == pytest.approx(90.0)
