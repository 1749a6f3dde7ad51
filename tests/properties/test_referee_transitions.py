"""Whatever happens to the vehicles, the referee keeps its promises to those who read the score."""

import pytest
from built_messages import build_body
from built_rooms import build_air
from built_scenarios import build_agent, build_scenario
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, BodyState, Command, FieldSamples, GasAmount, MountSample
from gslcosim.contract.participant import Episode
from gslcosim.contract.record import validate_fields
from gslcosim.environment.model import Box, Environment
from gslcosim.scenario import Scenario
from gslcosim_services.referee.core import RefereeCore

AGENTS = ("first", "second")
ONCE = {"take_off", "gas_contact", "success", "collision", "agent_failed", "out_of_bounds", "declared", "time_limit"}
ENDS = ONCE - {"take_off", "gas_contact"}


def scenario(success_of: str, *, on_collision: bool) -> Scenario:
    stop = {"time_limit_s": 2.0, "on_collision": on_collision}
    referee = {"success": {"within_m": 1.0, "of": success_of}, "stop": stop}
    return build_scenario(*(build_agent(name) for name in AGENTS), referee=referee)


@st.composite
def bodies(draw, agent: str) -> BodyState:
    # Most places are far from the source and inside, so that runs last for a while.
    inside = st.tuples(st.floats(6.5, 14.0), st.floats(3.0, 9.0), st.floats(0.5, 5.0))
    near_or_outside = st.sampled_from([(5.0, 1.5, 2.0), (99.0, 1.0, 1.0)])
    return build_body(
        agent,
        draw(st.one_of(*[inside] * 9, near_or_outside)),
        phase=draw(st.sampled_from(["on_ground", "taking_off", "flying", "holding"] * 4 + ["failed"])),
        awaiting_command=draw(st.booleans()),
        path_length_m=draw(st.integers(0, 400)) / 4,
        contacts=draw(st.sampled_from([(), (), (), (), ("floor",), ("wall_west",)])),
        rejected_command=draw(st.sampled_from([None, None, "outside the room"])),
    )


commands = st.sampled_from(
    [
        {"kind": "noop"},
        {"kind": "hold"},
        {"kind": "declare_source", "declaration": {"position_world_m": (5.0, 1.0, 2.0)}},
        {"kind": "declare_source", "declaration": {"position_world_m": (9.0, 9.0, 2.0)}},
        {"kind": "failed", "reason": "gone"},
    ]
)
moments = st.tuples(
    st.tuples(*(bodies(agent) for agent in AGENTS)),
    st.floats(0.0, 1.0),
    st.lists(st.none() | commands, min_size=2, max_size=2),
)


@pytest.fixture(scope="module")
def room() -> Environment:
    floor = Box(name="floor", kind="floor", min_m=(0.0, 0.0, -0.2), max_m=(15.0, 10.0, 0.0))
    return build_air((30, 20, 12), cell_m=0.5, boxes=[floor])


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.lists(moments, min_size=21, max_size=21), st.sampled_from(["source", "declaration"]), st.booleans())
def test_one_verdict_no_events_after_an_end_and_figures_that_agree(room, story, success_of, on_collision):
    core = RefereeCore(scenario(success_of, on_collision=on_collision), room)
    core.reset(Episode(seed=1))
    ended: dict[str, str] = {}
    seen: list[tuple[str, str]] = []
    for tick, (poses, ppm, answers) in enumerate(story):
        gases = (GasAmount(gas="ethanol", mixing_ratio_ppm=ppm),)
        samples = tuple(
            MountSample(agent=agent, sensor="nose", gases=gases, wind_world_m_s=(0.0, 0.0, 0.0)) for agent in AGENTS
        )
        inbox = {
            keys.BODIES: BodyPoses(tick=tick, bodies=poses),
            keys.SAMPLES: FieldSamples(tick=tick, samples=samples),
        }
        for agent, answer in zip(AGENTS, answers, strict=True):
            if answer is not None:
                inbox[keys.command(agent)] = validate_fields(Command, {"tick": tick, **answer})
        outbox = core.step(tick, inbox)
        score = outbox[keys.SCORE]
        for event in score.events:
            assert event.agent not in ended, "an event after the end"
            assert (event.agent, event.kind) not in seen or event.kind not in ONCE, (
                "an event that comes once came twice"
            )
            seen.append((event.agent, event.kind))
        ended |= {event.agent: event.kind for event in score.events if event.kind in ENDS}
        assert score.is_final == (keys.VERDICT in outbox)
        assert score.is_final == (len(ended) == len(AGENTS))
        assert score.announced_ports() == {keys.VERDICT} & outbox.keys()
        if score.is_final:
            break
    verdict = outbox[keys.VERDICT]
    assert verdict.tick <= 20
    assert {result.name: result.outcome for result in verdict.agents} == ended
    assert (verdict.end_reason == "success") == any(result.success for result in verdict.agents)
    assert verdict.end_reason in ended.values()
    for result in verdict.agents:
        assert result.success == (result.outcome == "success") == (result.time_to_source_s is not None)
        if result.success and success_of == "source":
            assert result.final_distance_m <= 1.0
