"""What a participant's program says is judged in words that name what was expected."""

import math

import msgpack
import pytest

from gslcosim.base.errors import ContractError
from gslcosim.contract.environment_messages import SourceRate, WindShare
from gslcosim.contract.participant_messages import ParticipantHello, ParticipantValues
from gslcosim.runtime.external.protocol import check_hello, read_hello, read_outputs

WORDS = ("ventilation", "state")
RIGHT = {"tick": 7, "outputs": {"ventilation": {"share": 2}, "state": {"level": 3, "is_on": True}}}


def refused(judge, *arguments, **names):
    with pytest.raises(ContractError) as caught:
        judge(*arguments, **names)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_right_answer_becomes_a_message_for_each_word():
    answers = read_outputs(msgpack.packb({**RIGHT, "later": [1]}), 7, WORDS)
    assert answers == {
        "ventilation": WindShare(tick=7, share=2.0),
        "state": ParticipantValues(tick=7, values={"level": 3.0, "is_on": True}),
    }
    outputs = {"source_10": {"filaments_per_s": 4}, "source_01": {"filaments_per_s": 4}}
    assert read_outputs(msgpack.packb({"tick": 7, "outputs": outputs}), 7, outputs) == {
        "source_10": SourceRate(tick=7, filaments_per_s=4.0),
        "source_01": ParticipantValues(tick=7, values={"filaments_per_s": 4.0}),
    }


def test_whole_numbers_and_reals_are_the_same_number():
    """Languages differ in how they write 3; the digest must not."""
    one, other = (
        read_outputs(msgpack.packb({"tick": 7, "outputs": {"state": {"level": level}}}), 7, ["state"])["state"]
        for level in (3, 3.0)
    )
    assert type(one.values["level"]) is type(other.values["level"]) is float


def with_output(word, fields):
    return {"tick": 7, "outputs": {**RIGHT["outputs"], word: fields}}


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        ({**RIGHT, "tick": 6}, "tick: expected 7, that of the inputs, was 6."),
        ({**RIGHT, "tick": 7.0}, "tick: "),
        ({"tick": 7}, "outputs: "),
        ({"tick": 7, "outputs": {"state": {}}}, "outputs: expected state, ventilation, as it declares, was state."),
        (with_output("gas", {}), "outputs: expected state, ventilation, as it declares, was gas, state, ventilation."),
        (with_output("ventilation", {"share": -1.0}), "outputs.ventilation: WindShare: share: "),
        (with_output("ventilation", {}), "outputs.ventilation: WindShare: share: "),
        (
            with_output("state", {"level": math.nan}),
            "state.level: expected a number or a truth value, was nan.",
        ),
        (with_output("state", {"level": "3"}), "outputs.state.level: expected a number or a truth value, was '3'."),
        (with_output("state", {"Level": 3}), "outputs.state: expected names of at most 40 lower-case letters"),
        (with_output("state", {f"n{i}": 0 for i in range(257)}), "expected at most 256 values, was 257."),
    ],
)
def test_a_wrong_answer_is_refused_in_one_sentence(answer, expected):
    assert expected in refused(read_outputs, msgpack.packb(answer), 7, WORDS)


@pytest.mark.parametrize("payload", [b"", b"\xc1", msgpack.packb([1]), b"\x82\xa4tick\x07\xa4tick\x07"])
def test_what_is_no_map_is_refused(payload):
    assert refused(read_outputs, payload, 7, WORDS).startswith("ParticipantOutputs: ")


def test_a_hello_names_its_ports_in_any_order():
    hello = read_hello(msgpack.packb({"tick": 0, "reads": ["b", "a"], "writes": ["state"], "contract": "1.7"}))
    check_hello(hello, reads=["a", "b"], writes=["state"])


@pytest.mark.parametrize(
    ("key", "reads", "writes", "expected"),
    [
        ("reads", ("truth/bodies",), ("state",), "truth/samples, was truth/bodies."),
        ("reads", (), ("state",), "truth/samples, was nothing."),
        ("writes", ("truth/samples",), ("state", "other"), "state, was other, state."),
    ],
)
def test_a_program_that_was_made_for_other_ports_is_refused(key, reads, writes, expected):
    hello = ParticipantHello(tick=0, reads=reads, writes=writes)
    text = refused(check_hello, hello, reads=["truth/samples"], writes=["state"])
    assert text.startswith(f"ParticipantHello: {key}: expected what the scenario declares, ")
    assert expected in text


@pytest.mark.parametrize("contract", ["2.0", "one"])
def test_a_program_of_another_contract_is_refused(contract):
    hello = {"tick": 0, "reads": [], "writes": ["state"], "contract": contract}
    assert "contract: expected " in refused(read_hello, msgpack.packb(hello))
