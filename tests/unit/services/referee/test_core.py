"""The referee fed with hand-made truth: one law of its rules per test."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from built_messages import build_body, build_sample
from built_rooms import build_air
from built_scenarios import build_agent, build_scenario

from gslcosim.base.errors import ModelError
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import (
    Belief,
    BodyPoses,
    BodyState,
    Command,
    Declaration,
    FieldSamples,
    MountSample,
    Score,
    Verdict,
)
from gslcosim.contract.participant import Episode
from gslcosim.contract.record import NumericArray
from gslcosim.environment.model import Box, Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.referee.core import RefereeCore

SOURCE = (2.0, 1.0, 2.0)
FAR = (8.0, 1.0, 2.0)  # 6 m from the source
START = (8.0, 1.0, 0.1)


def room() -> Environment:
    """Air of 10 x 6 x 4 m over a floor, without wind."""
    floor = Box(name="floor", kind="floor", min_m=(0.0, 0.0, -0.2), max_m=(10.0, 6.0, 0.0))
    return build_air((20, 12, 8), cell_m=0.5, boxes=[floor])


def scenario(*names: str, sources=(SOURCE,), mode="on_request", model="iris", **referee) -> Scenario:
    agents = (build_agent(name, START, mode=mode, vehicle={"model": model}) for name in names or ("beetle",))
    gas = {"sources": [{"position_m": place} for place in sources]}
    return build_scenario(*agents, gas=gas, referee=referee)


def body(agent: str = "beetle", position_m=FAR, **more) -> BodyState:
    return build_body(agent, position_m, **more)


def sample(ppm: float, agent: str = "beetle") -> MountSample:
    return build_sample(agent, ethanol=ppm)


class Court:
    """Steps a referee tick by tick and keeps what it said."""

    def __init__(self, plan: Scenario) -> None:
        self.core = RefereeCore(plan, room())
        assert self.core.reset(Episode(seed=1)) == {}
        self.tick = -1
        self.events: list[tuple[int, str | None, str]] = []
        self.texts: list[str] = []
        self.score: Score | None = None
        self.verdict: Verdict | None = None

    def step(
        self,
        *bodies: BodyState,
        samples: Iterable[MountSample] = (),
        command: Command | None = None,
        beginning: Iterable[int] = (),
    ) -> "Court":
        self.tick += 1
        inbox = {
            keys.BODIES: BodyPoses(tick=self.tick, bodies=bodies or (body(),)),
            keys.SAMPLES: FieldSamples(tick=self.tick, samples=tuple(samples)),
        }
        if command is not None:
            inbox[keys.command("beetle")] = command.model_copy(update={"tick": self.tick})
        if beginning:
            inbox[EVENTS] = EventsBeginning(tick=self.tick - 1, beginning=tuple(beginning))
        outbox = self.core.step(self.tick, inbox)
        self.score = outbox[keys.SCORE]
        self.verdict = outbox.get(keys.VERDICT)
        self.events += [(self.tick, event.agent, event.kind) for event in self.score.events]
        self.texts += [event.text for event in self.score.events]
        return self

    def kinds(self) -> list[str]:
        return [kind for _, _, kind in self.events]


def declare(position_m, confidence=0.5) -> Command:
    declaration = Declaration(position_world_m=position_m, confidence=confidence)
    return Command(tick=0, kind="declare_source", declaration=declaration)


def believing(x_m) -> Command:
    """Believe the source to be in one cell of a metre."""
    one = NumericArray.from_array(np.ones((1, 1), np.float32))
    return Command(tick=0, kind="noop", belief=Belief(origin_m=(x_m - 0.5, 1.0, 2.0), cell_m=1.0, probability=one))


WAYPOINT = Command(tick=0, kind="waypoint", position_world_m=FAR)
FAILED = Command(tick=0, kind="failed", reason="the process ended with exit code 1")


def test_a_score_comes_every_tick_and_the_verdict_only_with_the_final_one():
    court = Court(scenario(stop={"time_limit_s": 0.3}))
    for tick in range(3):
        court.step()
        assert (court.score.tick, court.score.is_final, court.verdict) == (tick, False, None)
    court.step()
    assert court.score.is_final
    assert court.verdict.tick == 3
    assert court.verdict.end_reason == "time_limit"


def test_coming_within_the_radius_is_success_and_its_time_is_that_of_the_tick():
    court = Court(scenario()).step(body(position_m=(3.01, 1.0, 2.0))).step(body(position_m=(3.0, 1.0, 2.0)))
    assert court.kinds()[-1] == "success"
    result = court.verdict.agents[0]
    assert court.verdict.end_reason == "success"
    assert (result.success, result.outcome, result.time_to_source_s) == (True, "success", 0.1)


@pytest.mark.parametrize(("is_horizontal", "distance_m"), [(True, 0.5), (False, math.hypot(0.5, 1.5))])
def test_heights_count_unless_the_criterion_is_horizontal(is_horizontal, distance_m):
    above_m = (SOURCE[0] + 0.5, SOURCE[1], SOURCE[2] + 1.5)
    court = Court(scenario(success={"within_m": 1.0, "horizontal": is_horizontal}))
    court.step().step(body(position_m=above_m))
    assert court.score.agents[0].distance_to_source_m == pytest.approx(distance_m)
    assert (court.verdict is not None) == is_horizontal
    if court.verdict:
        (result,) = court.verdict.agents
        assert (result.success, result.final_distance_m) == (True, pytest.approx(0.5))
        assert result.straight_line_m == pytest.approx(6.0)  # from FAR, in the plane


def test_the_last_belief_is_judged_until_the_next_and_in_the_result():
    court = Court(scenario(stop={"time_limit_s": 0.4}))
    assert court.step().score.agents[0].belief is None
    court.step(command=believing(9.5)).step()
    far = court.score.agents[0].belief
    assert far.expected_distance_m == pytest.approx(math.hypot(7.5, 0.5))
    court.step(command=believing(2.5)).step()
    near = court.score.agents[0].belief
    assert (near.mass_near_frac, near.entropy_bits) == (1.0, 0.0)
    assert court.verdict.agents[0].belief == near


def test_the_highest_confidence_of_all_declarations_is_kept():
    court = Court(scenario(stop={"time_limit_s": 0.3}))
    for confidence in (0.25, 0.75, 0.5):
        court.step(command=declare(FAR, confidence))
    court.step()
    assert court.verdict.agents[0].declared_confidence == 0.75
    assert Court(scenario(stop={"time_limit_s": 0.1})).step().step().verdict.agents[0].declared_confidence is None


def test_any_of_several_sources_counts_and_distances_are_to_the_nearest():
    court = Court(scenario(sources=(SOURCE, (9.0, 5.0, 2.0)))).step(body(position_m=(9.0, 2.0, 2.0)))
    assert court.score.agents[0].distance_to_source_m == 3.0
    assert court.step(body(position_m=(9.0, 4.5, 2.0))).verdict.end_reason == "success"


def test_success_in_the_last_tick_goes_before_the_time_limit():
    court = Court(scenario(stop={"time_limit_s": 0.1})).step().step(body(position_m=SOURCE))
    assert court.verdict.end_reason == "success"


@pytest.mark.parametrize("time_limit_s", [0.1, 0.25, 0.3, 0.7, 1.1])
def test_the_limit_is_the_first_tick_whose_time_reaches_it(time_limit_s):
    court = Court(scenario(stop={"time_limit_s": time_limit_s}))
    while court.verdict is None:
        court.step()
    assert court.tick == math.ceil(round(time_limit_s * 10, 6))


@pytest.mark.parametrize(
    ("phase", "contacts", "is_collision"),
    [
        ("on_ground", ("floor",), False),
        ("taking_off", ("floor",), False),
        ("on_ground", ("floor", "rack_1"), True),
        ("taking_off", ("rack_1",), True),
        ("flying", ("floor",), True),
        ("holding", ("floor",), True),
        ("flying", ("wall_x_min",), True),
        ("flying", ("second",), True),
        ("flying", (), False),
    ],
)
def test_a_collision_is_any_contact_but_with_the_floor_before_flight(phase, contacts, is_collision):
    court = Court(scenario()).step(body(phase=phase, contacts=contacts))
    assert (court.verdict is not None) == is_collision
    if is_collision:
        assert court.verdict.end_reason == court.verdict.agents[0].outcome == "collision"
        assert court.kinds()[-2:] == ["contact", "collision"]


def test_where_collisions_do_not_end_the_run_each_touch_is_reported_once():
    court = Court(scenario(stop={"on_collision": False}))
    for contacts in ((), ("rack",), ("rack",), (), ("rack",)):
        court.step(body(contacts=contacts))
    assert court.verdict is None
    assert [tick for tick, _, kind in court.events if kind == "contact"] == [1, 4]


@pytest.mark.parametrize(
    ("place_m", "contacts", "end_reason"),
    [(SOURCE, ("rack",), "collision"), ((10.06, 1.0, 2.0), (), "out_of_bounds"), ((5.0, 1.0, -0.04), (), None)],
    ids=["touches on arrival", "leaves the room", "is pressed into the floor"],
)
def test_an_agent_ends_as_it_touches_something_or_leaves_the_room(place_m, contacts, end_reason):
    verdict = Court(scenario()).step(body(position_m=place_m, contacts=contacts)).verdict
    assert (verdict and verdict.end_reason) == end_reason


def test_a_failed_agent_ends_and_its_failure_is_no_step():
    court = Court(scenario()).step(command=WAYPOINT).step(command=FAILED)
    assert court.verdict is None
    assert court.step(body(phase="failed")).verdict.end_reason == "agent_failed"
    assert court.verdict.agents[0].steps == 1
    assert "exit code 1" in court.texts[-1]


def test_a_right_declaration_wins_where_declarations_are_judged():
    court = Court(scenario(success={"within_m": 0.5, "of": "declaration"}))
    court.step(body(position_m=SOURCE)).step(command=declare((2.3, 1.4, 2.0))).step()
    assert court.verdict.end_reason == "success"
    assert court.verdict.agents[0].declared_error_m == pytest.approx(0.5)
    assert court.verdict.agents[0].time_to_source_s == 0.2


def test_a_wrong_declaration_ends_the_agent_where_declarations_are_judged():
    court = Court(scenario(success={"within_m": 0.5, "of": "declaration"})).step(command=declare(FAR)).step()
    assert court.verdict.end_reason == court.verdict.agents[0].outcome == "declared"
    assert court.verdict.agents[0].declared_error_m == 6.0


def test_declarations_are_only_noted_where_the_vehicle_is_judged_and_the_last_one_counts():
    court = Court(scenario(stop={"time_limit_s": 0.4}))
    court.step(command=declare(SOURCE)).step().step(command=declare(FAR)).step()
    assert court.verdict is None
    assert court.kinds().count("declaration") == 2
    assert court.step().verdict.agents[0].declared_error_m == 6.0


def test_a_command_counts_when_it_takes_effect():
    plan = scenario(mode={"latency": 3}, success={"within_m": 0.5, "of": "declaration"})
    court = Court(plan).step(command=declare(SOURCE)).step().step()
    assert (court.score.agents[0].n_commands, court.verdict) == (0, None)
    assert court.step().verdict.agents[0].time_to_source_s == pytest.approx(0.3)


def test_one_agents_end_does_not_end_the_others():
    court = Court(scenario("first", "second"))
    court.step(body("first", contacts=("rack",)), body("second"))
    assert court.verdict is None
    court.step(body("first", SOURCE, path_length_m=99.0), body("second"))
    assert court.verdict is None
    court.step(body("first"), body("second", SOURCE))
    assert court.verdict.end_reason == "success"
    assert [(result.name, result.outcome) for result in court.verdict.agents] == [
        ("first", "collision"), ("second", "success"),
    ]  # fmt: skip
    assert court.verdict.agents[0].path_length_m == 0.0


def test_without_success_the_reason_is_that_of_the_last_to_end():
    court = Court(scenario("first", "second"))
    court.step(body("first"), body("second", contacts=("rack",))).step(body("first", phase="failed"), body("second"))
    assert court.verdict.end_reason == "agent_failed"


def test_events_of_a_flight_come_once_and_in_order():
    court = Court(scenario())
    court.step(body(phase="on_ground", contacts=("floor",)), samples=[sample(0.2)])
    court.step(body(phase="taking_off", contacts=("floor",)), samples=[sample(0.3)])
    court.step(body(phase="taking_off"), samples=[sample(0.31)])
    court.step(body(phase="holding"), samples=[sample(5.0)])
    court.step(body(position_m=SOURCE))
    assert court.events == [(1, "beetle", "take_off"), (2, "beetle", "gas_contact"), (4, "beetle", "success")]
    assert "0.31 ppm at nose (more than 0.3 ppm)" in court.texts[1]


def test_gas_at_another_agent_is_not_mine():
    court = Court(scenario("first", "second"))
    court.step(body("first"), body("second"), samples=[sample(1.0, "second")])
    assert (0, "second", "gas_contact") in court.events
    assert (0, "first", "gas_contact") not in court.events


def test_each_refused_command_is_reported_once_also_when_two_in_a_row_are_refused_alike():
    court = Court(scenario()).step(command=WAYPOINT)
    for _ in range(3):
        court.step(body(rejected_command="outside the room"))
    court.step(body(rejected_command="outside the room"), command=WAYPOINT)
    court.step(body(rejected_command="outside the room")).step(body())
    assert [tick for tick, _, kind in court.events if kind == "refused"] == [1, 5]


def test_the_figures_of_a_straight_flight():
    court = Court(scenario()).step(body(position_m=(8.0, 1.0, 2.0), phase="on_ground"))
    court.step(command=WAYPOINT).step(body(position_m=(3.0, 1.0, 2.0), path_length_m=5.0))
    result = court.verdict.agents[0]
    assert result.straight_line_m == 6.0
    assert result.shortest_path_m == pytest.approx(5.0)
    assert result.movement_overhead == pytest.approx(0.0)
    assert result.directness == pytest.approx(1.0)
    assert (result.final_distance_m, result.path_length_m, result.steps) == (1.0, 5.0, 1)
    assert result.declared_error_m is None


@pytest.mark.parametrize(("success_of", "shortest_m"), [("source", 5.0), ("declaration", 6.0)])
def test_the_shortest_way_ends_at_the_success_radius_or_at_the_source_where_nothing_is_approached(
    success_of, shortest_m
):
    court = Court(scenario(success={"within_m": 1.0, "of": success_of}, stop={"time_limit_s": 0.1}))
    court.step(body(position_m=(8.0, 1.0, 2.0))).step()
    assert court.verdict.agents[0].shortest_path_m == pytest.approx(shortest_m)


def test_the_shortest_way_leads_around_obstacles_and_to_the_source_that_is_nearest_by_way():
    # A wall across the room at x = 5 m, with a gap at the far end; the second source is on this side of it.
    walled = room()
    walled.occupancy[10, :10, :] = 1
    core = RefereeCore(scenario(sources=(SOURCE,), stop={"time_limit_s": 0.1}), walled)
    both = RefereeCore(scenario(sources=(SOURCE, (8.0, 4.9, 2.0)), stop={"time_limit_s": 0.1}), walled)
    around_m, near_m = (shortest_of(referee) for referee in (core, both))
    assert around_m > 2 * math.hypot(3.0, 4.0) - 1.5
    assert near_m == pytest.approx(2.9)


def test_the_shortest_way_of_a_rover_stays_on_the_floor():
    stepped = room()
    stepped.occupancy[10, :6, :2] = 1
    level = RefereeCore(scenario(model="rover", success={"of": "declaration"}, stop={"time_limit_s": 0.1}), stepped)
    free = RefereeCore(scenario(success={"of": "declaration"}, stop={"time_limit_s": 0.1}), stepped)
    around_m, over_m = (shortest_of(core, start_m=(8.0, 1.0, 0.12)) for core in (level, free))
    assert over_m < 6.6
    assert around_m > 2 * math.hypot(3.0, 2.0) - 0.3


def shortest_of(core: RefereeCore, start_m=(8.0, 1.0, 2.0)) -> float:
    core.reset(Episode(seed=1))
    for tick in range(2):
        bodies = BodyPoses(tick=tick, bodies=(body(position_m=start_m),))
        outbox = core.step(tick, {keys.BODIES: bodies, keys.SAMPLES: FieldSamples(tick=tick, samples=())})
    return outbox[keys.VERDICT].agents[0].shortest_path_m


def test_overhead_is_absent_without_success():
    court = Court(scenario(stop={"time_limit_s": 0.1})).step().step(body(position_m=(5.0, 1.0, 2.0), path_length_m=9.0))
    result = court.verdict.agents[0]
    assert (result.movement_overhead, result.time_to_source_s) == (None, None)
    assert result.directness == pytest.approx(1 / 3)
    assert result.final_distance_m == 3.0


def test_a_reset_referee_repeats_itself():
    court = Court(scenario())
    first = court.step().step(body(position_m=SOURCE)).verdict
    court.core.reset(Episode(seed=2))
    court.tick = -1
    assert court.step().step(body(position_m=SOURCE)).verdict == first


def test_nothing_is_final_after_the_verdict():
    court = Court(scenario()).step(body(position_m=SOURCE)).step(body(position_m=SOURCE))
    assert (court.score.is_final, court.score.events, court.verdict) == (False, (), None)


def test_truth_without_an_agent_stops_the_run():
    with pytest.raises(ModelError, match=r"referee, tick 0: expected a body for 'beetle', was \['other'\]"):
        Court(scenario()).step(body("other"))


OTHER = (8.0, 1.0, 2.0)
TWO = {"sources": (SOURCE, OTHER), "success": {"within_m": 1.0, "of": "all_sources"}}


def test_where_all_sources_are_to_be_found_one_is_progress_and_the_last_is_success():
    court = Court(scenario(**TWO)).step(body(position_m=SOURCE)).step(body(position_m=(5.0, 1.0, 2.0)))
    assert court.verdict is None
    assert court.step(body(position_m=OTHER)).verdict.end_reason == "success"
    assert [kind for kind in court.kinds() if kind in ("progress", "success")] == ["progress", "progress", "success"]
    assert court.texts[-1].startswith("has found all sources after 0.2 s")
    assert court.verdict.agents[0].shortest_path_m is court.verdict.agents[0].movement_overhead is None


def test_a_source_at_which_the_vehicle_collides_is_not_found():
    court = Court(scenario(**TWO)).step(body(position_m=SOURCE, contacts=("rack",)))
    assert court.verdict.end_reason == "collision"
    assert "progress" not in court.kinds()


def test_a_belief_near_the_source_is_success_where_maps_are_judged_and_only_there():
    court = Court(scenario(success={"of": "map", "within_m": 1.0, "mass_at_least": 0.9}))
    court.step(body(position_m=SOURCE)).step(command=believing(5.0)).step()
    assert court.verdict is None
    court.step(command=believing(2.0)).step()
    assert court.verdict.end_reason == "success"
    assert court.texts[-1].startswith("has mapped the source")
    elsewhere = Court(scenario(success={"of": "source", "within_m": 1.0})).step(command=believing(2.0)).step()
    assert elsewhere.verdict is None


def test_a_declaration_does_not_end_a_run_in_which_maps_are_judged():
    court = Court(scenario(success={"of": "map"})).step(command=declare(FAR)).step()
    assert "declaration" in court.kinds()
    assert court.verdict is None


def with_decoy(*events: dict) -> Scenario:
    """A scenario whose first source releases another gas than the one to find."""
    values = plain_values(scenario(sources=((8.0, 4.0, 2.0), SOURCE)))
    values["gas"]["sources"][0]["gas"] = "methane"
    return Scenario.model_validate({**values, "events": list(events)})


def test_a_source_of_another_gas_is_a_decoy_and_no_source():
    court = Court(with_decoy()).step(body(position_m=(8.0, 4.0, 2.0)))
    assert court.verdict is None
    assert court.score.agents[0].distance_to_source_m > 2.0
    court.step(body(position_m=SOURCE))
    assert court.verdict.agents[0].success


def test_a_decoy_that_moves_leaves_the_sources_where_they_are():
    court = Court(with_decoy({"what": "source_moves", "source": 0, "at_s": 0.1, "to_m": (8.0, 1.0, 2.0)}))
    court.step(body(position_m=(8.0, 1.0, 2.0))).step(body(position_m=(8.0, 1.0, 2.0)), beginning=[0])
    assert court.verdict is None
    assert court.score.agents[0].distance_to_source_m == pytest.approx(math.dist((8.0, 1.0, 2.0), SOURCE))


def test_where_no_source_releases_the_gas_to_find_all_count():
    values = plain_values(scenario())
    values["gas"]["sources"][0]["gas"] = "methane"
    court = Court(Scenario.model_validate(values)).step(body(position_m=SOURCE))
    assert court.verdict.agents[0].success


def test_events_are_reported_and_sources_that_move_are_followed():
    plan = scenario()
    moves = {"what": "source_moves", "at_s": 0.1, "to_m": (8.0, 1.0, 2.0)}
    plan = Scenario.model_validate({**plain_values(plan), "events": [moves]})
    court = Court(plan)
    court.step(body(position_m=(5.0, 1.0, 2.0)))
    assert court.score.agents[0].distance_to_source_m == pytest.approx(3.0)
    court.step(body(position_m=(5.0, 1.0, 2.0)), beginning=[0])
    assert (court.events[-1], court.texts[-1]) == ((1, None, "event"), "source 0 moves to [8, 1, 2] m")
    court.step(body(position_m=(8.0, 1.0, 2.5)))
    assert court.verdict.agents[0].success
    assert court.verdict.agents[0].final_distance_m == pytest.approx(0.5)
    # From where it was at tick 0 to where the source is now.
    assert court.verdict.agents[0].straight_line_m == pytest.approx(3.0)
    assert court.verdict.agents[0].shortest_path_m == pytest.approx(2.0, abs=0.5)
    event = {"event": 0, "what": "source_moves", "tick": 1, "time_s": 0.1, "text": "source 0 moves to [8, 1, 2] m"}
    assert court.core.summary()["events"] == [{**event, "agent": None}]
    court.core.reset(Episode(seed=1))
    assert court.core.summary()["events"] == []


def test_refused_and_changed_commands_are_counted_with_the_first_reason():
    court = Court(scenario())
    court.step(command=WAYPOINT)  # takes effect a tick later
    court.step(body(rejected_command="too far"), command=WAYPOINT)
    court.step(
        body(rejected_command="too near", waypoint_world_m=FAR),
        command=Command(tick=0, kind="hold", reason="refused: no map"),
    )
    court.step(body(rejected_command="an edge"))
    court.step(body(), samples=[sample(0.5)])
    assert court.core.summary()["conduct"]["beetle"] == {
        "n_commands": 3, "n_refused": 3, "n_adjusted": 1, "first_refusal": "too far", "gas_contact_s": 0.4,
        "has_succeeded": False,
    }  # fmt: skip
