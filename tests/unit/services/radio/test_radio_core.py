"""What is sent, when it is heard, and what is refused."""

import pytest
from built_messages import build_body

from gslcosim.base.errors import ModelError
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import BodyPoses, Command, RadioMessage
from gslcosim.contract.participant import Episode
from gslcosim.runtime.services import build_dataflow, list_service_names
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.radio.core import RadioCore


def body(agent, x_m=0.0):
    return build_body(agent, (float(x_m), 2.0, 1.0), phase="holding", awaiting_command=True)


@pytest.fixture
def with_channels(make_scenario):
    """Build a scenario of three agents, agent_0 to agent_2, with these channels."""

    def build(*channels, **options):
        return make_scenario({}, {}, {}, channels=[{"name": "radio", **channel} for channel in channels], **options)

    return build


@pytest.fixture
def core_of(with_channels):
    def build(*channels):
        core = RadioCore(with_channels(*channels))
        assert core.reset(Episode(seed=1)) == {}
        return core

    return build


def step(core, tick, *, sent=None, x_m=(0.0, 1.0, 2.0), more=None):
    """Step with commands of the tick before that carry these texts: {agent number: messages}."""
    inbox = dict(more or {})
    if tick > 0:
        inbox[keys.BODIES] = BodyPoses(tick=tick - 1, bodies=tuple(body(f"agent_{i}", x) for i, x in enumerate(x_m)))
    for i, messages in (sent or {}).items():
        inbox[keys.command(f"agent_{i}")] = Command(tick=tick - 1, kind="noop", outgoing=tuple(messages))
    (traffic,) = core.step(tick, inbox).values()
    return traffic


def said(text, **changes):
    return RadioMessage(channel="radio", text=text, **changes)


def receptions(traffic):
    return [(arrival.agent, arrival.reception.sender, arrival.reception.text) for arrival in traffic.arrivals]


def test_a_text_to_all_is_received_by_all_others_once(core_of):
    core = core_of({})
    assert receptions(step(core, 0)) == []
    traffic = step(core, 1, sent={1: [said("here")]})
    assert receptions(traffic) == [("agent_0", "agent_1", "here"), ("agent_2", "agent_1", "here")]
    assert {arrival.reception.sent_tick for arrival in traffic.arrivals} == {0}
    assert traffic.transmissions[0].reached == ("agent_0", "agent_2")
    assert step(core, 2).model_dump() == {"tick": 2, "transmissions": (), "arrivals": ()}


def test_a_text_to_one_is_received_by_that_one(core_of):
    traffic = step(core_of({}), 1, sent={0: [said("you", to="agent_2")]})
    assert receptions(traffic) == [("agent_2", "agent_0", "you")]
    assert traffic.transmissions[0].reached == ("agent_2",)


def test_texts_come_by_sender_and_then_as_they_were_sent(core_of):
    traffic = step(core_of({}), 1, sent={2: [said("c", to="agent_0")], 0: [said("b", to="agent_1"), said("a")]})
    assert [(t.sender, t.message.text) for t in traffic.transmissions] == [
        ("agent_0", "b"), ("agent_0", "a"), ("agent_2", "c"),
    ]  # fmt: skip
    assert [text for _, _, text in receptions(traffic)] == ["b", "a", "a", "c"]


def test_a_text_is_received_after_the_delay_of_its_channel(core_of):
    core = core_of({}, {"name": "slow", "delay_ticks": 3})
    sent = {0: [RadioMessage(channel="slow", text="late", to="agent_1"), said("soon", to="agent_1")]}
    texts = [
        [text for *_, text in receptions(step(core, tick, sent=sent if tick == 5 else None))] for tick in range(5, 9)
    ]
    assert texts == [["soon"], [], ["late"], []]


def test_range_is_that_of_the_tick_of_sending(core_of):
    core = core_of({"range_m": 2.0, "delay_ticks": 2})
    far = step(core, 1, sent={0: [said("far")]}, x_m=(0.0, 2.0, 2.001))
    assert (far.transmissions[0].reached, far.transmissions[0].out_of_range) == (("agent_1",), ("agent_2",))
    near = step(core, 2, x_m=(0.0, 100.0, 0.0))
    assert receptions(near) == [("agent_1", "agent_0", "far")]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (said("ééé"), "outgoing[0].text: expected at most 5 bytes in UTF-8 on radio, was 6."),
        (said("x", to="agent_0"), "outgoing[0].to: expected one of all, agent_1, was 'agent_0'."),
        (said("x", to="agent_2"), "outgoing[0].to: expected one of all, agent_1, was 'agent_2'."),
        (RadioMessage(channel="other", text="x"), "outgoing[0].channel: expected one of radio, was 'other'."),
    ],
)
def test_a_text_that_cannot_be_sent_is_refused_with_a_reason(core_of, message, reason):
    members = ["agent_0", "agent_1"]
    core = core_of({"max_bytes": 5, "members": members}, {"name": "other", "members": ["agent_1", "agent_2"]})
    traffic = step(core, 1, sent={0: [message, said("fits")]})
    refused, sent = traffic.transmissions
    assert (refused.refusal, refused.reached) == (reason, ())
    assert (sent.refusal, sent.reached) == (None, ("agent_1",))


def test_who_is_on_no_channel_sends_nothing(core_of):
    traffic = step(core_of({"members": ["agent_0", "agent_1"]}), 1, sent={2: [said("x")]})
    expected = "outgoing[0].channel: expected none, for the agent is on no channel, was 'radio'."
    assert (traffic.transmissions[0].refusal, traffic.arrivals) == (expected, ())


def test_a_reset_forgets_what_is_on_its_way_and_repeats_the_losses(core_of):
    core = core_of({"loss_frac": 0.5, "delay_ticks": 5})

    def fates():
        core.reset(Episode(seed=3))
        return [step(core, tick, sent={0: [said("x")]}).model_dump() for tick in range(1, 30)]

    first = fates()
    assert first == fates()
    assert first[0]["arrivals"] == ()


def test_a_missing_pose_ends_the_run(core_of):
    with pytest.raises(ModelError, match="expected a pose of vehicle 'agent_2' in tick 0"):
        step(core_of({}), 1, x_m=(0.0, 1.0))


def test_radio_takes_part_only_in_runs_with_channels(with_channels, make_scenario):
    assert "radio" not in list_service_names(make_scenario())
    assert keys.RADIO not in build_dataflow(make_scenario()).writes
    scenario = with_channels({})
    assert "radio" in list_service_names(scenario)
    order = build_dataflow(scenario).order
    assert order.index("radio") < order.index("sensing")


def test_nobody_waits_longer_for_an_agent_that_is_slow(with_channels):
    """The radio reads a command when the world does, not when it could first be sent."""
    spec = build_dataflow(with_channels({}, mode={"latency": 4})).by_name["radio"]
    assert {read.delay_ticks for read in spec.reads if read.port.startswith("command/")} == {4}


def test_texts_are_lost_while_an_event_has_taken_the_radio_away(with_channels):
    lost = {"what": "radio_lost", "at_s": 0.2}
    lost_for_one = {"what": "radio_lost", "at_s": 0.4, "agent": "agent_2", "channel": "radio"}
    scenario = with_channels({})
    events = [lost, {**lost, "what": "radio_returns", "at_s": 0.3}, lost_for_one]
    scenario = type(scenario).model_validate({**plain_values(scenario), "events": events})
    core = RadioCore(scenario)
    core.reset(Episode(seed=1))
    text = [RadioMessage(channel="radio", text="here")]
    beginning = {2: (0,), 3: (1,), 4: (2,)}
    fates = []
    for tick in range(1, 6):
        inbox = {EVENTS: EventsBeginning(tick=tick - 1, beginning=beginning.get(tick, ()))}
        traffic = step(core, tick, sent={0: text}, more=inbox)
        (sent,) = traffic.transmissions
        fates.append((sent.reached, sent.lost))
    both, nobody = ("agent_1", "agent_2"), ()
    one_each = (("agent_1",), ("agent_2",))
    assert fates == [(both, nobody), (nobody, both), (both, nobody), one_each, one_each]
