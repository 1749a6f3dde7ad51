"""Protocol of external participants: the ports they declare, and checks of the frames they send."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from gslcosim.base.errors import ContractError
from gslcosim.base.problems import Problem
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract import codec
from gslcosim.contract.environment_messages import PROBES
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import AGENT_PREFIX, ParticipantSpec, Read, Write
from gslcosim.contract.participant_messages import (
    MAX_VALUES,
    PARTICIPATION_VERSION,
    ParticipantHello,
    ParticipantOutputs,
    ParticipantValues,
    find_room_output,
)
from gslcosim.contract.version import check_version
from gslcosim.gateway.frame_codec import MAX_FRAME_BYTES
from gslcosim.runtime.dataflow import ONCE, find_port_problems, find_undelayed_cycle
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim.scenario.problems import did_you_mean

# Names of processes, and of other parts of a run that a fault can name, besides the names of services.
_RESERVED_NAMES = ("supervisor", "runtime", "fork_server")
_NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,39}")
_MAX_SHOWN = 60


def get_period_ticks(own: ParticipantProgramSpec, scenario: Scenario) -> int:
    """Return every how many ticks a participant steps."""
    return 1 if own.period_s is None else max(1, ticks_from_seconds(own.period_s, scenario.tick_ns))


def build_external_spec(own: ParticipantProgramSpec, scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of a participant; what it makes of the room is there every tick, also between steps."""
    period_ticks = get_period_ticks(own, scenario)
    return ParticipantSpec(
        name=own.name,
        reads=tuple(Read(port=read.port, delay_ticks=read.delay) for read in own.reads),
        writes=tuple(
            Write(port=own.port_of(word), message_type=ParticipantValues, period_ticks=period_ticks)
            if (room := find_room_output(word)) is None
            else Write(port=room.port, message_type=room.message_type)
            for word in own.writes
        ),
    )


def find_declaration_problems(
    scenario: Scenario, services: Sequence[str], specs: Sequence[ParticipantSpec]
) -> Iterable[Problem]:
    """Return what is wrong with the participants of a scenario in the run that it makes.

    Args:
        services: The names of all services that there are, whether the run has them or not.
        specs: All participants of the run, sessions of agents and these among them.
    """
    found = [*_find_reserved_names(scenario, services), *_find_unknown_ports(scenario, specs)]
    if found:
        return found
    if problems := [*find_port_problems(specs)]:
        where, _, rest = problems[0].partition(": expected ")
        expected, _, was = rest.rstrip(".").rpartition(", ")
        return [
            Problem(
                where="participants",
                expected=f"{expected} ({where})",
                found=was.removeprefix("was ").removeprefix("found "),
            )
        ]
    if cycle := find_undelayed_cycle(specs):
        ring = " → ".join([*cycle, cycle[0]])
        expected = "a delay of at least 1 tick on one of the reads in each ring"
        return [Problem(where="participants", expected=expected, found=ring, remedy="Add delay: 1 to one of them.")]
    return []


def _find_reserved_names(scenario: Scenario, services: Sequence[str]) -> Iterator[Problem]:
    others = [service.name for service in scenario.services]
    for i, own in enumerate(scenario.participants):
        if own.name in (*services, *others, *_RESERVED_NAMES) or own.name.startswith(AGENT_PREFIX):
            yield Problem(
                where=f"participants[{i}].name",
                expected=f"a name that no service has, and that does not begin with {AGENT_PREFIX}",
                found=f"'{own.name}'",
                remedy=f"For example my_{own.name}.",
            )


def _find_unknown_ports(scenario: Scenario, specs: Sequence[ParticipantSpec]) -> Iterator[Problem]:
    known = {write.port: write for spec in specs for write in spec.writes if write.announced_in != ONCE}
    for i, own in enumerate(scenario.participants):
        delays = {read.port: read.delay for read in own.reads}
        for j, read in enumerate(own.reads):
            path = f"participants[{i}].reads[{j}].port"
            if read.port not in known:
                expected = f"a port of this run ({', '.join(sorted(known))})"
                remedy = did_you_mean(read.port, known) if read.port != PROBES else "Add probes to the scenario."
                yield Problem(where=path, expected=expected, found=f"'{read.port}'", remedy=remedy)
                continue
            announcer = known[read.port].announced_in
            if announcer is not None and delays.get(announcer, read.delay + 1) > read.delay:
                yield Problem(
                    where=path,
                    expected=f"{announcer}, which announces {read.port}, among the reads with a delay of at most "
                    f"{read.delay}",
                    found=f"a delay of {delays[announcer]}" if announcer in delays else "none",
                    remedy=f"Add {{port: {announcer}, delay: {read.delay}}}.",
                )


def read_hello(payload: bytes) -> ParticipantHello:
    """Return a program's hello."""
    hello = codec.decode_untrusted(ParticipantHello, payload, max_bytes=MAX_FRAME_BYTES)
    if hello.contract is not None:
        check_version(hello.contract, PARTICIPATION_VERSION)
    return hello


def check_hello(hello: ParticipantHello, *, reads: Iterable[str], writes: Iterable[str]) -> None:
    """Check that a program was made for the ports that its scenario declares."""
    for key, answered, declared in (("reads", hello.reads, tuple(reads)), ("writes", hello.writes, tuple(writes))):
        if {*answered} != {*declared}:
            raise ContractError(
                f"ParticipantHello: {key}: expected what the scenario declares, {_join_words(declared)}, was "
                f"{_join_words(answered)}. Correct the scenario or the program."
            )


def read_outputs(payload: bytes, tick: int, words: Iterable[str]) -> Mapping[str, Message]:
    """Return the messages in a program's answer by the words of its outputs."""
    answer = codec.decode_untrusted(ParticipantOutputs, payload, max_bytes=MAX_FRAME_BYTES)
    if answer.tick != tick:
        raise ContractError(f"ParticipantOutputs: tick: expected {tick}, that of the inputs, was {answer.tick}.")
    declared = tuple(words)
    if answer.outputs.keys() != {*declared}:
        raise ContractError(
            f"ParticipantOutputs: outputs: expected {_join_words(declared)}, as it declares, was "
            f"{_join_words(answer.outputs)}."
        )
    return {word: build_output(word, tick, answer.outputs[word]) for word in declared}


def is_valid_name(word: str) -> bool:
    """Return whether a word can be the name of an output or of a value in it."""
    return _NAME_PATTERN.fullmatch(word) is not None


def build_output(word: str, tick: int, fields: Mapping[str, Any]) -> Message:
    """Return the message of an output of a participant."""
    room = find_room_output(word)
    if room is not None:
        try:
            return codec.build_message(room.message_type, {**fields, "tick": tick})
        except ContractError as error:
            raise ContractError(f"ParticipantOutputs: outputs.{word}: {error}") from error
    if len(fields) > MAX_VALUES:
        raise ContractError(
            f"ParticipantOutputs: outputs.{word}: expected at most {MAX_VALUES} values, was {len(fields)}."
        )
    for name, value in fields.items():
        place = f"ParticipantOutputs: outputs.{word}"
        if not is_valid_name(name):
            expected = "names of at most 40 lower-case letters, digits and _"
            raise ContractError(f"{place}: expected {expected}, was {_format_value(name)}.")
        if not isinstance(value, bool | int | float) or not math.isfinite(value):
            raise ContractError(f"{place}.{name}: expected a number or a truth value, was {_format_value(value)}.")
    values = {name: value if isinstance(value, bool) else float(value) for name, value in fields.items()}
    return ParticipantValues(tick=tick, values=values)


def _join_words(words: Iterable[str]) -> str:
    found = sorted(words)
    text = ", ".join(found[:8]) + (" …" if len(found) > 8 else "")
    return text or "nothing"


def _format_value(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."
