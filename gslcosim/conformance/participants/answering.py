"""Which rule a participant's frame breaks, if any, and how that is told."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from gslcosim.conformance.findings import Failure
from gslcosim.conformance.participants.scripted_inputs import message_name
from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.contract.participation import VENTILATION, ParticipantHello
from gslcosim.errors import ContractError
from gslcosim.runtime.foreign.hearing import is_name, read_hello, read_outputs


@dataclass(frozen=True)
class Answering:
    """Makes failures of one session."""

    session: str

    def failure(self, rule: str, sent: str, expected: str, got: str) -> Failure:
        """Return a break of a rule."""
        return Failure(rule=rule, flight=self.session, sent=sent, expected=expected, got=got)

    def with_words(self, failure: Failure, words: str) -> Failure:
        """Return a failure with the end of the program's log."""
        return replace(failure, got=f"{failure.got}\nThe end of its log: {words}")


def failure_of_hello(answering: Answering, payload: bytes) -> tuple[ParticipantHello | None, Failure | None]:
    """Return a program's hello, or the rule that it breaks."""
    sent = "its environment"
    try:
        codec.unpack_foreign("ParticipantHello", payload)
    except ContractError as error:
        return None, answering.failure("encoding", sent, "one map", str(error))
    try:
        hello = read_hello(payload)
    except ContractError as error:
        rule = "contract" if str(error).startswith("contract:") else "hello"
        return None, answering.failure(rule, sent, "a ParticipantHello", str(error))
    problems = [f"reads {port!r}, which no run has" for port in hello.reads if message_name(port) is None]
    problems += [f"writes {word!r}, which is no name" for word in hello.writes if not is_name(word)]
    for key, words in (("reads", hello.reads), ("writes", hello.writes)):
        problems += [f"{key} {word!r} twice" for word in dict.fromkeys(words) if words.count(word) > 1]
    if not hello.writes:
        problems.append("writes nothing")
    if problems:
        expected = f"ports of a run, and {VENTILATION} or words of its own, each once"
        return None, answering.failure("ports", sent, expected, "; ".join(problems))
    return hello, None


def failure_of_outputs(
    answering: Answering, payload: bytes, tick: int, words: Iterable[str]
) -> tuple[Mapping[str, Message] | None, Failure | None]:
    """Return the answers of a program to the inputs of a tick, or the rule that they break."""
    sent, declared = f"ParticipantInputs, tick {tick}", tuple(words)
    try:
        fields = codec.unpack_foreign("ParticipantOutputs", payload)
    except ContractError as error:
        return None, answering.failure("encoding", sent, "one map", str(error))
    try:
        return read_outputs(payload, tick, declared), None
    except ContractError as error:
        said = str(error)
    outputs = fields.get("outputs")
    if type(fields.get("tick")) is not int or fields["tick"] != tick:
        rule, expected = "tick", f"tick: {tick}"
    elif not isinstance(outputs, dict) or {*outputs} != {*declared}:
        rule, expected = "outputs", f"outputs with {', '.join(sorted(declared))}"
    else:
        rule, expected = "values", "finite numbers and truth values by name"
    return None, answering.failure(rule, sent, expected, said)
