"""A participant's program behind its core, without a run around it: transports, faults, and what is refused."""

import json
import sys
from pathlib import Path

import pytest
from built_messages import build_sample
from built_runs import build_setup

from gslcosim.base.errors import SimulationFault
from gslcosim.contract.messages import FieldSamples
from gslcosim.contract.participant import Episode
from gslcosim.contract.participant_messages import ParticipantValues
from gslcosim.runtime.external.core import ExternalCore
from gslcosim.scenario import load_scenario
from gslcosim.scenario.problems import InvalidScenarioError

PROGRAM = Path(__file__).parents[1] / "shared" / "foreign_program.py"
TYPES = {"truth/samples": "FieldSamples", "participant/model/state": "ParticipantValues"}
ANSWER = "expected an answer to the inputs of tick 3, "


def block(fault="right", tick=3, door="stdio", **more):
    command = [sys.executable, str(PROGRAM), fault, str(tick)]
    start = {"command": command, "door": door, "format": "json"}
    own = {"name": "model", "start": start, "reads": [{"port": "truth/samples"}], "writes": ["state"]}
    return {**own, "sandbox": "none", "answer_within_s": 25.0, **more}


@pytest.fixture
def core_of(tmp_path):
    """Return the core of a participant, which is closed in the end."""
    cores = []

    def build(*, snapshots=False, **words):
        overrides = [f"participants=[{json.dumps(block(**words))}]"]
        overrides += ["snapshots.every_s=1"] if snapshots else []
        loaded = load_scenario("tiny_room", overrides=overrides)
        setup = build_setup(loaded, tmp_path, directory=tmp_path)
        cores.append(ExternalCore(loaded.scenario.participants[0], setup, TYPES))
        return cores[-1]

    yield build
    for core in cores:
        core.close()


def samples(tick, ppm=1.0):
    sample = build_sample(wind_m_s=(0.5, 0.0, 0.0), ethanol=ppm)
    return {"truth/samples": FieldSamples(tick=tick, samples=(sample,))}


def flown(core, n_ticks=6):
    core.reset(Episode(seed=1))
    return [core.step(tick, samples(tick)) for tick in range(n_ticks)]


@pytest.mark.parametrize("door", ["stdio", "unix", "tcp"])
def test_over_every_transport_each_step_has_its_answer(core_of, door):
    values = [{"n_samples": 1.0, "tick": float(tick)} for tick in range(6)]
    core = core_of(door=door)
    expected = [{"participant/model/state": ParticipantValues(tick=i, values=each)} for i, each in enumerate(values)]
    assert flown(core) == expected
    # A second episode is one with a program that has seen nothing of the first.
    assert flown(core) == expected


def test_it_goes_on_at_a_snapshot_where_it_was(core_of):
    """Its past is played to a new start of it: what it counts goes on, as if it had never ended."""
    first = core_of(fault="counts", snapshots=True)
    whole = flown(first, n_ticks=6)
    later = core_of(fault="counts", snapshots=True)
    flown(later, n_ticks=3)
    state = later.state()
    again = core_of(fault="counts", snapshots=True)
    again.reset(Episode(seed=1))
    again.restore(state)
    assert [again.step(tick, samples(tick)) for tick in range(3, 6)] == whole[3:]
    assert again.state() == first.state()


def test_one_that_does_not_repeat_its_past_is_named(core_of):
    flown(core := core_of(fault="random", snapshots=True), n_ticks=3)
    again = core_of(fault="random", snapshots=True)
    again.reset(Episode(seed=1))
    with pytest.raises(SimulationFault, match="expected the answers of the past 3 steps again, were others"):
        again.restore(core.state())


def test_nothing_is_kept_where_no_snapshots_are_taken(core_of):
    flown(core := core_of())
    assert core.state()["past"] == []


def test_between_its_steps_it_is_not_asked(core_of):
    assert [len(outbox) for outbox in flown(core_of(period_s=0.3), n_ticks=7)] == [1, 0, 0, 1, 0, 0, 1]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("exits", f"{ANSWER}but its process ended with exit code 7. The end of its log:\nthe model has blown up"),
        ("is_killed", f"{ANSWER}but its process was killed by SIGKILL."),
        ("hangs", f"{ANSWER}nothing came within 2 s."),
        ("closes", f"{ANSWER}it closed its output."),
        ("garbage", f"{ANSWER}expected one JSON object a line, was 11 bytes starting 'hello world'"),
        ("wrong_tick", "ParticipantOutputs: tick: expected 3, that of the inputs, was 2."),
        ("other_output", "ParticipantOutputs: outputs: expected state, as it declares, was gas."),
        ("nan", "ParticipantOutputs: outputs.state.level: expected a number or a truth value, was nan."),
        ("too_big", "expected a line of at most 1048576 bytes, was longer."),
        ("twice", "ParticipantOutputs: tick: expected 4, that of the inputs, was 3."),
        ("wrong_reads", "Hello: reads: expected what the scenario declares, truth/samples, was truth/bodies."),
        ("wrong_writes", "Hello: writes: expected what the scenario declares, state, was gas, state."),
        ("never_says_hello", "expected its hello (ParticipantHello), but its process ended with exit code 4."),
    ],
)
def test_each_fault_is_one_sentence_that_says_what_was_expected(core_of, fault, expected):
    with pytest.raises(SimulationFault) as caught:
        flown(core_of(fault=fault, answer_within_s=2.0 if fault == "hangs" else 25.0))
    # A second answer may be seen before the next inputs are sent, or be taken for the answer to them.
    other = "expected no answer before the inputs of tick 4, something came before it was asked."
    assert expected in str(caught.value) or (fault == "twice" and str(caught.value) == other)


def test_who_connects_without_the_token_is_named(core_of):
    with pytest.raises(SimulationFault, match="expected its program to connect to GSLCOSIM_GATEWAY, but its process"):
        flown(core_of(fault="wrong_token", door="unix"))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"start": {"command": ["./nothing"]}},
            "participants[0].start.command[0]: expected a program, was './nothing'.",
        ),
        ({"period_s": 0.25}, "participants[0].period_s: expected a whole number of 100 ms ticks, was 0.25 s."),
        ({"writes": ["state", "state"]}, "participants[0].writes: expected each port once, was 'state' 2 times."),
        (
            {"answer_within_s": 60},
            "participants[0].answer_within_s: expected a number greater than 0 to 25 in seconds, was 60.",
        ),
        (
            {"start": {"command": ["cat"], "door": "zenoh"}},
            "participants[0].start.door: expected one of stdio, tcp or unix",
        ),
    ],
)
def test_a_block_that_cannot_be_is_refused(changes, expected):
    with pytest.raises(InvalidScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"participants=[{json.dumps({**block(), **changes})}]"])
    assert expected in str(caught.value)


def test_two_that_drive_the_wind_are_refused():
    blocks = [{**block(), "name": name, "writes": ["ventilation"]} for name in ("one", "two")]
    with pytest.raises(InvalidScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"participants={json.dumps(blocks)}"])
    assert "participants: expected at most one that changes the wind, was one and two." in str(caught.value)
