"""Whatever bytes an agent sends, the codec says what is wrong, and one valid command a question passes.

The inputs are random but named by a seed: a failure prints the seed and the bytes that caused it. A few seconds of it
are part of every test run; `make soak` fuzzes for ten minutes.
"""

import contextlib
import json
import resource
import struct
import time

import msgpack
import pytest

from gslcosim.base.errors import ContractError
from gslcosim.base.rng import stream
from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Ending
from gslcosim.contract.record import get_pydantic_model
from gslcosim.gateway.frame_codec import (
    LENGTH_BYTES,
    MAX_FRAME_BYTES,
    Frame,
    RefusedFrame,
    build_splitter,
    decode_payload,
)
from gslcosim.runtime.agents.validator import MAX_EARLY_ANSWERS, MAX_FAULTS, CommandValidator
from gslcosim_conformance.answers import read_answer
from gslcosim_conformance.message_schemas import list_message_types
from gslcosim_conformance.scripted_world import ScriptedWorld, build_briefing

MAX_GROWTH_MB = 200
LENGTHS = [pytest.param(4.0, marks=pytest.mark.slow), pytest.param(300.0, marks=pytest.mark.soak)]

SEEDLINGS = [
    codec.encode(Command(tick=5, kind="waypoint", position_world_m=(1.0, 2.0, 3.0), reason="näher")),
    codec.encode(Command(tick=5, kind="hold", hold_s=0.5, contract="1.0")),
    msgpack.packb({"tick": 5, "kind": "declare_source", "declaration": {"position_world_m": [1, 2, 3], "x": [None]}}),
    codec.encode(build_briefing(7)),
    codec.encode(ScriptedWorld(7).observe(5, is_asked=True)),
    codec.encode(Ending(tick=9, reason="time_limit")),
]  # fmt: skip
# What parsers stumble over: lengths that lie, extension types, the byte that is never used, deep nesting.
TRAPS = [
    b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc1",
    b"\xc9\xff\xff\xff\xff\x01", b"\xd6\xff\x00\x00\x00\x00", b"\xc7\x0c\xff" + bytes(12), b"\xd4\x05\x00",
    b"\x91" * 2000, b"\x81\xa1a" * 600, b"\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00",
    b"\xcb\x7f\xf0\x00\x00\x00\x00\x00\x00",
    b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff", b"\xd3\x80\x00\x00\x00\x00\x00\x00\x00", b"\xa4tick", b"\xa2\xff\xfe", b"",
    b"[" * 3000, b'{"a":' * 1500, b"1e999", b"NaN", b'"\\ud800"', b"9" * 5000,
    b"\xef\xbb\xbf{}", b'{"tick":5,"tick":6}',
]  # fmt: skip


def mutated(rng, data):
    """Return bytes changed in one of the ways in which senders and networks go wrong."""
    data = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(data) + 1))
        kind = int(rng.integers(6))
        if kind == 0 and data:
            data[at % len(data)] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del data[at:]
        elif kind == 2:
            data[at:at] = TRAPS[int(rng.integers(len(TRAPS)))]
        elif kind == 3:
            other = SEEDLINGS[int(rng.integers(len(SEEDLINGS)))]
            data[at:] = other[int(rng.integers(len(other))) :]
        elif kind == 4:
            data[at : at + int(rng.integers(9))] = rng.bytes(int(rng.integers(9)))
        else:
            data[at:at] = data[: int(rng.integers(40))]
    return bytes(data)


def command_like(rng):
    """Return a map that is nearly a command, with values of any type in its fields."""
    values = [
        None, True, -1, 0, 5, 6, 2**53, 2**63, 5.0, float("nan"), 1e308, "", "hold", "waypoint", "failed", b"\x00\xff",
        [], [1, 2, 3], [1.0, 2.0], [[1.0], 2.0, 3.0], {}, {"position_world_m": [0, 0, 0]}, "x" * 600, [{}] * 20,
    ]  # fmt: skip
    names = [*get_pydantic_model(Command).model_fields, "later"]
    fields = {"tick": 5, "kind": "hold"}
    for _ in range(int(rng.integers(4))):
        fields[names[int(rng.integers(len(names)))]] = values[int(rng.integers(len(values)))]
    return msgpack.packb(fields)


def any_input(rng):
    if rng.random() < 0.3:
        return command_like(rng)
    return mutated(rng, SEEDLINGS[int(rng.integers(len(SEEDLINGS)))])


def fuzz(name, seconds, try_one):
    """Try random inputs until the time is over; every input is named by seed and number."""
    seed = int(time.time())
    rng = stream(seed, f"fuzz.{name}")
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    deadline, n_inputs = time.monotonic() + seconds, 0
    while time.monotonic() < deadline:
        for _ in range(100):
            data = any_input(rng)
            n_inputs += 1
            try:
                try_one(rng, data)
            except Exception as error:
                error.add_note(f"seed {seed}, input {n_inputs}: {data[:200].hex()} ({len(data)} bytes)")
                raise
    growth_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before_mb
    assert growth_mb < MAX_GROWTH_MB
    assert n_inputs > 100 * seconds


@pytest.mark.timeout(900)
@pytest.mark.parametrize("seconds", LENGTHS)
def test_the_codec_refuses_or_reads_and_what_it_reads_it_can_write(seconds):
    types = list_message_types()

    def try_one(rng, data):
        message_type = types[int(rng.integers(len(types)))] if rng.random() < 0.5 else Command
        refusal, message = "", None
        try:
            message = codec.decode(message_type, data)
        except ContractError as error:
            refusal = str(error)
        assert bool(refusal) == (message is None)
        assert len(refusal) < 5000
        assert message is None or codec.decode(message_type, codec.encode(message)) == message
        answer = read_answer(data)
        assert (answer.command is None) == (answer.problem is not None) or answer.problem.rule == "byte-order"

    fuzz("codec", seconds, try_one)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("seconds", LENGTHS)
def test_the_validator_lets_through_one_valid_command_for_each_question(seconds):
    world = ScriptedWorld(3)
    state = {"door": CommandValidator("agent"), "tick": 0, "asked": set(), "passed": []}

    def take(commands):
        state["passed"] += [command.tick for command in commands]
        for command in commands:
            assert codec.decode(Command, codec.encode(command)) == command
            assert command.kind != "failed" or state["door"].is_closed
        assert set(state["passed"]) <= state["asked"]
        assert len(state["passed"]) == len(set(state["passed"]))

    def try_one(rng, data):
        if state["door"].is_closed or state["tick"] > 300:
            state.update(
                door=CommandValidator("agent", may_overlap=bool(rng.random() < 0.3)), tick=0, asked=set(), passed=[]
            )
        validator = state["door"]
        if rng.random() < 0.5:
            state["tick"] += 1
            is_asked = bool(rng.random() < 0.7) and (validator.may_overlap or not validator.pending)
            if is_asked:
                state["asked"].add(state["tick"])
            take(validator.on_observation(world.observe(state["tick"], is_asked=is_asked)))
        if rng.random() < 0.3 and validator.pending:
            data = codec.encode(Command(tick=validator.pending[0], kind="hold"))
        take(validator.on_answer(data))
        assert len(validator.faults) <= MAX_FAULTS
        assert len(validator._early) <= MAX_EARLY_ANSWERS

    fuzz("door", seconds, try_one)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("frame_format", ["msgpack", "json"])
@pytest.mark.parametrize(
    "seconds", [pytest.param(2.0, marks=pytest.mark.slow), pytest.param(60.0, marks=pytest.mark.soak)]
)
def test_the_gateway_cuts_any_stream_into_frames_or_says_why_not(seconds, frame_format):
    state = {"splitter": build_splitter(frame_format)}

    def try_one(rng, data):
        if frame_format == "json" and rng.random() < 0.5:
            data = json.dumps({"tick": 5, "kind": "hold", "reason": data.hex()}).encode()[: int(rng.integers(4, 400))]
        ends = {"msgpack": struct.pack(">I", len(data)) + data, "json": data + b"\n"}
        sent = ends[frame_format] if rng.random() < 0.8 else data
        cut = int(rng.integers(len(sent) + 1))
        for piece in (sent[:cut], sent[cut:]):
            for item in state["splitter"].feed(piece):
                judge(item)
        assert len(state["splitter"]._buffer) <= MAX_FRAME_BYTES + LENGTH_BYTES + len(sent)

    def judge(item):
        if isinstance(item, RefusedFrame):
            assert item.text
            if item.is_fatal:
                state["splitter"] = build_splitter(frame_format)
            return
        assert isinstance(item, Frame)
        with contextlib.suppress(ContractError):
            CommandValidator("agent").on_answer(decode_payload(frame_format, item.payload))

    fuzz(f"gateway.{frame_format}", seconds, try_one)
