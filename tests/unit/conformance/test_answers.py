"""One thing that an agent sent is judged by the first rule that it breaks."""

import math
import struct

import msgpack
import pytest

from gslcosim.conformance.answers import read_answer, refused_answer
from gslcosim.contract.messages import CONTRACT_VERSION

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


def test_a_tiny_number_among_sane_ones_is_no_question_of_byte_order():
    """Half of all velocities along an axis have a sine of a half turn in them."""
    fields = {"tick": 5, "kind": "velocity", "velocity_world_m_s": [-0.5, math.sin(math.pi), 0.0]}
    assert read_answer(msgpack.packb(fields)).problem is None


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        ("size", "expected at most 1048576 bytes, was 50000000."),
        ("size", "expected a line of at most 1048576 bytes, was longer."),
        ("encoding", "expected one JSON object a line, was 5 bytes starting 'hello' (...)."),
    ],
)
def test_what_the_gateway_refuses_has_its_rule(rule, text):
    problem = refused_answer(text).problem
    assert problem is not None
    assert problem.rule == rule
    assert problem.got == text
