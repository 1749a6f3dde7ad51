"""One thing that an agent sent is judged by the first rule that it breaks."""

import json
import math
import struct

import msgpack
import pytest

from gslcosim.base.errors import ContractError
from gslcosim.contract.version import CONTRACT_VERSION
from gslcosim.gateway import frame_codec
from gslcosim_conformance.answers import build_refused_answer, read_answer

RIGHT = {"tick": 5, "kind": "waypoint", "position_world_m": [1.0, 2.0, 3.0]}


def swapped(number):
    return struct.unpack("<d", struct.pack(">d", number))[0]


@pytest.mark.parametrize(
    ("rule", "payload"),
    [
        ("size", b"x" * 2_000_000),
        ("encoding", b"\xc1"),
        ("encoding", b""),
        ("encoding", msgpack.packb([1, 2])),
        ("encoding", msgpack.packb(RIGHT)[:-1]),
        ("encoding", msgpack.packb(RIGHT) + b"\x00"),
        ("encoding", msgpack.packb({1: 2})),
        ("encoding", b"\x81\xa1\xff\x01"),
        ("encoding", msgpack.packb({b"tick": 5, b"kind": "hold"})),
        ("encoding", msgpack.Packer().pack_map_pairs([("tick", 5), ("tick", 5), ("kind", "hold")])),
        (
            "encoding",
            msgpack.packb(RIGHT | {"later": [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]}),
        ),
        ("contract", msgpack.packb(RIGHT | {"contract": "9.0"})),
        ("contract", msgpack.packb(RIGHT | {"contract": "one"})),
        ("integers", msgpack.packb(RIGHT | {"tick": 5.0})),
        ("integers", msgpack.packb(RIGHT | {"tick": "5"})),
        ("integers", msgpack.packb(RIGHT | {"tick": True})),
        ("finite", msgpack.packb(RIGHT | {"position_world_m": [1.0, math.nan, 1.0]})),
        ("finite", msgpack.packb({"tick": 5, "kind": "hold", "hold_s": -math.inf})),
        ("byte-order", msgpack.packb(RIGHT | {"position_world_m": [swapped(v) for v in (1.0, 2.5, 3.0)]})),
        ("schema", msgpack.packb({"kind": "hold"})),
        ("schema", msgpack.packb(RIGHT | {"tick": -1})),
        ("schema", msgpack.packb(RIGHT | {"kind": "failed"})),
        ("schema", msgpack.packb(RIGHT | {"position_world_m": struct.pack(">3d", 1, 2, 3)})),
        ("schema", msgpack.packb(RIGHT | {"contract": 1.1})),
    ],
)
def test_each_fault_has_its_rule(rule, payload):
    answer = read_answer(payload)
    assert answer.problem is not None
    assert answer.problem.rule == rule
    assert answer.problem.expected
    assert answer.problem.got


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"later": [1, {"a": None}]},
        {"contract": CONTRACT_VERSION},
        {"position_world_m": [1, 2, 3]},
        {"position_world_m": [6.1e-17, 0.0, 2.0]},
        {"kind": "velocity", "velocity_world_m_s": [0.0, -0.0, 0.0]},
    ],
)
def test_a_right_command_has_no_problem(changes):
    answer = read_answer(msgpack.packb(RIGHT | changes))
    assert answer.problem is None
    assert answer.command is not None
    assert answer.tick == 5


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        ("size", "expected at most 1048576 bytes, was 50000000."),
        ("size", "expected a line of at most 1048576 bytes, was longer."),
        ("encoding", "expected one JSON object a line, was 5 bytes starting 'hello' (...)."),
    ],
)
def test_what_the_gateway_refuses_has_its_rule(rule, text):
    problem = build_refused_answer(text).problem
    assert problem is not None
    assert problem.rule == rule
    assert problem.got == text


def believing(data):
    probability = {"dtype": "float32", "shape": [1, 1], "data": data}
    return RIGHT | {"belief": {"origin_m": [0, 0, 0], "cell_m": 1, "probability": probability}}


ONE = struct.pack("<f", 1.0)


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (json.dumps(RIGHT).encode(), "msgpack.packb(command) in place of json.dumps(command)"),
        (len(msgpack.packb(RIGHT)).to_bytes(4, "big") + msgpack.packb(RIGHT), "without its length before it"),
        (b"deciding for tick 5", "print(text, file=sys.stderr)"),
        (msgpack.packb([5, "hold"]), "not the list of its values"),
        (msgpack.packb({1: 2}), "and no numbers"),
        (msgpack.packb({b"tick": 5, b"kind": "hold"}), "'tick' and not b'tick'"),
        (msgpack.packb(RIGHT | {"reason": b"gr\xfc\xdfe"}, use_bin_type=False), "reason is 'gr\xfc\xdfe' in Latin-1"),
        (msgpack.packb(believing(ONE), use_bin_type=False), "belief.probability.data holds bytes, packed as text"),
        (msgpack.packb(believing(bytes(4)), use_bin_type=False), "belief.probability.data is text"),
        (msgpack.packb(believing(list(ONE))), "base64.b64encode(data).decode()"),
        (msgpack.Packer().pack_map_pairs([("tick", 5), ("tick", 5)]), "Write each key once"),
        (msgpack.packb(RIGHT)[:-1], "Send whole maps"),
        (b"", "Send whole maps"),
    ],
)
def test_the_remedy_names_the_line_to_change(payload, words):
    problem = read_answer(payload).problem
    assert problem is not None
    assert words in problem.remedy


def refused_line(line):
    with pytest.raises(ContractError) as refusal:
        frame_codec.decode_payload("json", line)
    return str(refusal.value)


def refused_frame(data):
    (item,) = frame_codec.MsgpackSplitter().feed(data)
    return item.text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            refused_line(b'{"tick": 5, "reason": "gr\xfc\xdfe"}'),
            "text.encode('utf-8') in place of text.encode('latin-1')",
        ),
        (refused_line(b'\xef\xbb\xbf{"tick": 5}'), "encoding='utf-8' in place of 'utf-8-sig'"),
        (refused_line(str(RIGHT).encode()), "json.dumps(command) in place of str(command)"),
        (refused_line(json.dumps(RIGHT).encode() * 2), "print(json.dumps(command), flush=True)"),
        (refused_line(json.dumps(believing("b'abc'")).encode()), "base64.b64encode(data).decode()"),
        (refused_line(b'{"tick": 5, "tick": 5}'), "Write each key once"),
        (refused_line(b"deciding"), "print(text, file=sys.stderr)"),
        (refused_line(b"[5]"), "not the list of its values"),
        (refused_line(b"\x00\x00\x00\x05" + msgpack.packb(RIGHT)), "format: msgpack"),
        (refused_frame(msgpack.packb(RIGHT)), "len(payload).to_bytes(4, 'big') + payload"),
        (refused_frame(b"\x2a\x00\x00\x00"), "'big') in place of 'little'"),
        (refused_frame(json.dumps(RIGHT).encode()), "format: json"),
        (refused_frame(b"Hello"), "print(text, file=sys.stderr)"),
    ],
)
def test_what_the_gateway_refuses_has_the_line_to_change(text, words):
    problem = build_refused_answer(text).problem
    assert problem is not None
    assert words in problem.remedy
