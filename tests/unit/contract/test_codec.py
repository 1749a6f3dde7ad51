"""What a participant must not get away with, and what it is sent."""

import msgpack
import pytest
from contract_examples import EXAMPLES

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Ending, KnownMap, Observation, Score
from gslcosim.contract.record import NumericArray
from gslcosim.runtime.agents.validator import CommandValidator


def packed(**fields) -> bytes:
    return msgpack.packb(fields)


WAYPOINT = {"tick": 3, "kind": "waypoint", "position_world_m": [1.0, 2.0, 3.0]}


def nested(depth: int) -> bytes:
    """A map with an unknown key that holds arrays within arrays."""
    return b"\x83\xa4tick\x03\xa4kind\xa4noop\xa4junk" + b"\x91" * depth + b"\xc0"


MUST_REJECT = {
    "nan": (packed(**WAYPOINT | {"position_world_m": [1.0, float("nan"), 3.0]}), "position_world_m.1"),
    "float_tick": (packed(**WAYPOINT | {"tick": 3.0}), "tick: input should be a valid integer, was 3.0"),
    "huge_tick": (packed(**WAYPOINT | {"tick": 2**53 + 1}), "tick: input should be less than or equal"),
    "missing_kind": (packed(tick=3), "kind: field required"),
    "unknown_kind": (packed(tick=3, kind="jump"), "kind: input should be 'waypoint', 'hold'"),
    "waypoint_without_place": (packed(tick=3, kind="waypoint"), "a waypoint command needs position_world_m"),
    "two_coordinates": (packed(**WAYPOINT | {"position_world_m": [1.0, 2.0]}), "position_world_m.2: field required"),
    "text_coordinate": (packed(**WAYPOINT | {"position_world_m": [1.0, "2", 3.0]}), "position_world_m.1"),
    "long_reason": (packed(tick=3, kind="noop", reason="x" * 501), "reason: string should have at most 500"),
    "array": (msgpack.packb([1, 2, 3]), "expected a msgpack map, was tuple"),
    "nothing": (b"", "expected a msgpack map, was 0 bytes"),
    "trailing_bytes": (packed(tick=3, kind="noop") + b"\x00", "expected a msgpack map"),
    "bytes_keys": (msgpack.packb({b"tick": 3, b"kind": "noop"}), "field required"),
    "not_utf_8": (b"\x82\xa4tick\x03\xa4kind\xa4\xff\xfe\xfd\xfc", "expected a msgpack map"),
    "length_beyond_the_end": (b"\xdf\xff\xff\xff\xff", "expected a msgpack map"),
    "deep_nesting": (nested(100_000), "expected a msgpack map"),
}


# What a reader that trusts its writer does not look at.
BEYOND_LIMITS = {"nan", "huge_tick", "waypoint_without_place", "long_reason"}


def twice(*pairs) -> bytes:
    """A map with keys in a row, whether there twice or not."""
    return msgpack.Packer().pack_map_pairs(pairs)


FOREIGN_MUST_REJECT = {
    "tick_twice": (twice(("tick", 3), ("kind", "noop"), ("tick", 4)), "expected each key once, was 'tick' 2 times"),
    "equal_values": (twice(("tick", 3), ("kind", "noop"), ("tick", 3)), "expected each key once, was 'tick' 2 times"),
    "twice_within": (
        msgpack.packb({"tick": 3, "kind": "noop"})[:1].replace(b"\x82", b"\x83")
        + msgpack.packb({"tick": 3, "kind": "noop"})[1:]
        + msgpack.packb("later")
        + twice(("a", 1), ("a", 2)),
        "expected each key once, was 'a' 2 times",
    ),
    "too_deep": (nested(codec.MAX_NESTING), "expected lists and maps at most 32 deep, were deeper"),
}


@pytest.mark.parametrize("name", FOREIGN_MUST_REJECT)
def test_a_foreign_message_has_each_key_once_and_is_not_deep(name):
    payload, expected_text = FOREIGN_MUST_REJECT[name]
    assert codec.decode(Command, payload).kind == "noop"  # of our own services nobody asks
    with pytest.raises(ContractError) as caught:
        codec.decode_untrusted(Command, payload)
    assert str(caught.value) == f"Command: {expected_text}."
    (hold,) = _asked_validator().on_answer(payload)
    assert (hold.kind, hold.reason) == ("hold", f"refused: Command: {expected_text}.")


def _asked_validator() -> CommandValidator:
    validator = CommandValidator("agent")
    validator.on_observation(codec.ObservationHead(tick=3, awaiting_command=True))
    return validator


def test_the_deepest_that_is_allowed_is_taken():
    assert codec.decode_untrusted(Command, nested(codec.MAX_NESTING - 1)).tick == 3


@pytest.mark.parametrize(
    ("text", "ending"),
    [
        (b'{"tick":1,"kind":"noop","tick":2}', "Command: expected each key once, was 'tick' 2 times."),
        (b'{"tick":1,"kind":"noop","later":{"a":1,"a":1}}', "Command: expected each key once, was 'a' 2 times."),
        (
            b'{"tick":1,"kind":"noop","later":' + b"[" * 32 + b"]" * 32 + b"}",
            "Command: expected lists and maps at most 32 deep, were deeper.",
        ),
    ],
)
def test_json_has_each_key_once_and_is_not_deep(text, ending):
    with pytest.raises(ContractError) as caught:
        codec.decode_json(Command, text)
    assert str(caught.value) == ending


@pytest.mark.parametrize("name", MUST_REJECT)
def test_a_bad_command_is_refused_and_the_text_says_what_was_expected(name):
    payload, expected_text = MUST_REJECT[name]
    with pytest.raises(ContractError) as caught:
        codec.decode(Command, payload)
    assert str(caught.value).startswith("Command: ")
    assert expected_text in str(caught.value)


def test_a_big_payload_is_refused_before_it_is_read():
    with pytest.raises(ContractError, match=r"Command: expected at most 1000 bytes, was 100000\."):
        codec.decode(Command, bytes(100_000), max_bytes=1000)


def test_an_error_stays_short_however_much_is_wrong():
    many = {"tick": 1, "agents": [{"agent": "X" * 10_000}] * 1000}
    with pytest.raises(ContractError) as caught:
        codec.decode(Score, msgpack.packb(many))
    assert len(str(caught.value)) < 2000


def test_all_problems_are_reported_at_once():
    with pytest.raises(ContractError, match=r"Ending: tick: .*, was -1; reason: field required\."):
        codec.decode(Ending, packed(tick=-1))


def test_whole_numbers_pass_for_reals_because_some_languages_know_no_others():
    command = codec.decode(Command, packed(**WAYPOINT | {"position_world_m": [1, 2, 3]}))
    assert command.position_world_m == (1.0, 2.0, 3.0)
    assert all(type(value) is float for value in command.position_world_m)


def test_keys_may_come_in_any_order_and_optional_ones_may_be_absent():
    assert codec.decode(Command, msgpack.packb({"kind": "noop", "tick": 3})) == Command(tick=3, kind="noop")


def test_reals_travel_as_float64():
    command = codec.decode(Command, packed(**WAYPOINT | {"position_world_m": [1, 2, 3]}))
    assert codec.encode(command).count(b"\xcb") == 3


def test_the_validator_sees_the_tick_of_anything_and_keeps_what_comes_early():
    validator = CommandValidator("agent")
    assert validator.on_answer(packed(tick=41, nonsense=[])) == []
    (hold,) = validator.on_observation(codec.ObservationHead(tick=41, awaiting_command=True))
    assert hold.reason == "refused: Command: kind: field required."


@pytest.mark.parametrize(
    "payload", [packed(tick=1.0), packed(tick=True), packed(), b"", b"\x00", msgpack.packb("tick")]
)
def test_what_has_no_whole_tick_answers_the_question_and_is_refused(payload):
    (hold,) = _asked_validator().on_answer(payload)
    assert (hold.kind, hold.tick, hold.reason[:17]) == ("hold", 3, "refused: Command:")


@pytest.mark.parametrize("payload", [b"", packed(tick=1), packed(tick=1.5, awaiting_command=True), msgpack.packb(7)])
def test_an_observation_without_its_head_is_refused(payload):
    with pytest.raises(ContractError, match="Observation: expected a tick and awaiting_command, was "):
        codec.decode_observation_head(payload)


def test_the_encoding_names_message_and_major_version():
    assert codec.get_encoding(Observation) == "application/msgpack;gslcosim.Observation/1"


@pytest.mark.parametrize("name", sorted(BEYOND_LIMITS))
def test_a_reader_that_trusts_its_writer_does_not_look_at_limits(name):
    assert isinstance(codec.decode_trusted(Command, MUST_REJECT[name][0]), Command)


@pytest.mark.parametrize("name", sorted(MUST_REJECT.keys() - BEYOND_LIMITS))
def test_no_reader_takes_another_type(name):
    payload, expected_text = MUST_REJECT[name]
    with pytest.raises(ContractError) as caught:
        codec.decode_trusted(Command, payload)
    assert expected_text in str(caught.value)


def test_bytes_that_only_look_infinite_pass():
    ending = Ending(tick=1, reason="\x7f")
    assert codec.encode_finite(ending) == codec.encode(ending)
    cloud = NumericArray(dtype="uint8", shape=(3,), data=b"\xcb\x7f\xf0")
    map_ = KnownMap(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, occupied=cloud)
    briefing = EXAMPLES["briefing"].model_copy(update={"known_map": map_})
    assert b"\xcb\x7f\xf0" in codec.encode(briefing)
    assert codec.encode_finite(briefing) == codec.encode(briefing)
