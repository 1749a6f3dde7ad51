"""What the runtime's own processes tell each other: never part of a run's results."""

from collections.abc import Iterable
from typing import Annotated, Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError
from typing_extensions import TypedDict

from gslcosim.contract import keys
from gslcosim.contract.schema import contract_hash
from gslcosim.errors import ContractError
from gslcosim.runtime.stepper import Sent

START = "ctl/start"
STOP = "ctl/stop"
CLOSE = "ctl/close"
FAULT = "ctl/fault"
BUNDLES = "bundle/"
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack

LARGE_BYTES = 4096

# These messages cross hosts: no number, name or text of another host is taken as it comes.
MAX_MESSAGE_BYTES = 1 << 30
MAX_TICK = 1 << 53
MAX_TEXT = 1 << 20
Tick = Annotated[int, Field(ge=-1, le=MAX_TICK)]
ParticipantName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}$")]
PortName = Annotated[
    str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}(/[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}){0,9}$")
]
ShortText = Annotated[str, StringConstraints(max_length=300)]
Text = Annotated[str, StringConstraints(max_length=MAX_TEXT)]
Amount = Annotated[int, Field(ge=0, le=1 << 62)]
_MAX_ITEMS = 100_000
_Base64 = Annotated[str, StringConstraints(pattern=r"^([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?$")]


def alive(name: str) -> str:
    """Return the key of a participant's liveliness token."""
    return f"alive/{name}"


def progress(name: str) -> str:
    """Return the key on which a participant tells which tick it has finished."""
    return f"ctl/progress/{name}"


def waiting(name: str) -> str:
    """Return the key on which a participant tells what it has been waiting for."""
    return f"ctl/waiting/{name}"


def bye(name: str) -> str:
    """Return the key on which a participant hands over its digests when it is done."""
    return f"ctl/bye/{name}"


def bundle(writer: str, readers: Iterable[str]) -> str:
    """Return the key on which a participant sends the messages of several ports and ticks in one, to its readers.

    They are named so that each gets all that concerns it, and no more, with one subscription.
    """
    return f"{BUNDLES}{writer}/.{'.'.join(sorted(readers))}."


def bundles_for(reader: str) -> str:
    """Return the keys on which others send bundles to a participant."""
    return f"{BUNDLES}*/$*.{reader}.$*"


def bundles_of(writer: str) -> str:
    """Return the keys on which a participant sends bundles, whoever reads them."""
    return f"{BUNDLES}{writer}/*"


def is_for_agents(port: str) -> bool:
    """Return whether agents read a port: then each message is also sent on its own key, as the contract says."""
    return port.startswith("agents/")


def is_for_all(port: str) -> bool:
    """Return whether a port is sent whoever shares the writer's process: agents read it, or the supervisor."""
    return is_for_agents(port) or port == keys.VERDICT


def fits_in_bundle(sent: Sent) -> bool:
    """Return whether a message travels in a bundle; a large one would only burden those who do not read it."""
    return len(sent.payload) <= LARGE_BYTES or is_for_agents(sent.port)


def question_key(port: str) -> str:
    """Return the key on which a question to the agent of this port is asked beside the port's own."""
    return keys.question(port.split("/")[1])


def travels_alone(sent: Sent) -> bool:
    """Return whether a message travels on its own key."""
    return len(sent.payload) > LARGE_BYTES or is_for_agents(sent.port)


def pack_bundle(messages: list[tuple[str, bytes]]) -> bytes:
    """Return messages as one payload: a msgpack list of (port, payload)."""
    return _msgpack.packb(messages)


def unpack_bundle(payload: bytes) -> list[tuple[str, bytes]]:
    """Return the messages of a bundle.

    Raises:
        ContractError: it is not a bundle.
    """
    try:
        messages: Any = _msgpack.unpackb(payload, use_list=False)
        return [(str(port), bytes(message)) for port, message in messages]
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise ContractError(f"bundle: expected a list of (port, payload), was {payload[:32]!r}.") from error


def resend(name: str) -> str:
    """Return the key on which a participant answers with a message it has sent before."""
    return f"rpc/{name}/resend"


def describe(name: str) -> str:
    """Return the key on which a participant says what it is."""
    return f"rpc/{name}/describe"


def finished(name: str) -> str:
    """Return the key on which a participant says which tick it has finished, for who has missed that."""
    return f"rpc/{name}/finished"


def inspect(name: str) -> str:
    """Return the key on which a participant says how it goes."""
    return f"rpc/{name}/inspect"


class Control(BaseModel):
    """Base of the control messages."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    def to_bytes(self) -> bytes:
        """Return the message as msgpack."""
        return _msgpack.packb(self.model_dump())

    @classmethod
    def from_bytes(cls, payload: bytes) -> Any:
        """Return the message in a payload.

        Raises:
            ContractError: it is not this message.
        """
        if len(payload) > MAX_MESSAGE_BYTES:
            raise ContractError(
                f"{cls.__name__}: expected at most {MAX_MESSAGE_BYTES} bytes, was {len(payload)}. Another host sends "
                "what gslcosim does not."
            )
        try:
            return cls.model_validate(_msgpack.unpackb(payload))
        except ValidationError as error:
            raise ContractError(f"{cls.__name__}: {_first_problem(error)}") from error
        except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
            raise ContractError(f"{cls.__name__}: expected a control message, was {payload[:32]!r}.") from error


# In one sentence, with no more of the value than fits in it.
def _first_problem(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    place = ".".join(str(part)[:80] for part in first["loc"]) or "message"
    return f"{place}: expected something else ({first['msg'][:300]}), was {str(first['input'])[:80]!r}."


class TickNote(Control):
    """A tick: the last one finished (progress), or the last one that counts (stop)."""

    tick: Tick


class ReaderNote(Control):
    """The last tick that a participant has finished, with its name."""

    name: ParticipantName
    tick: Tick


class WaitingNote(Control):
    """What a participant needs for its next tick and does not have: (port, tick) pairs, or credit of readers."""

    tick: Tick
    missing: list[tuple[PortName, Tick]] = Field(default=[], max_length=_MAX_ITEMS)
    lacking_credit: list[ParticipantName] = Field(default=[], max_length=_MAX_ITEMS)


class FaultNote(Control):
    """A participant's own failure."""

    participant: ParticipantName
    tick: Tick
    text: Text


class ResendRequest(Control):
    """Ask for the message of a port at a tick."""

    port: PortName
    tick: Tick


class Description(Control):
    """What a participant is: its name, version, and the hash of the contract it speaks."""

    name: ParticipantName
    version: ShortText
    contract_hash: ShortText
    pid: Amount
    host: ShortText

    @property
    def difference(self) -> str:
        """Why it cannot take part in a run of this process: its contract is another; empty where it can."""
        if self.contract_hash == contract_hash():
            return ""
        return (
            f"expected contract {contract_hash()}, was {self.contract_hash} (gslcosim {self.version} on {self.host}). "
            "Install the same version everywhere."
        )


class Inspection(Control):
    """How a participant goes, and what its process has taken; see `ParticipantStatus`."""

    name: ParticipantName
    tick: Tick
    is_finished: bool
    waits_for: list[ShortText] = Field(max_length=_MAX_ITEMS)
    queued_ticks: Amount
    pid: Amount
    cpu_s: float = Field(ge=0, allow_inf_nan=False)
    memory_bytes: Amount | None
    n_resends: Amount


class TrailFields(TypedDict):
    """The hash chain of a port; see `gslcosim.runtime.digest.Trail`."""

    ticks: list[Tick]
    links: _Base64


class Bye(Control):
    """A participant is done: its last tick, the hash chains of its ports, where its time went, what it has to tell."""

    name: ParticipantName
    last_tick: Tick
    trails: dict[PortName, TrailFields]
    timing: dict[ShortText, int]
    account: dict[str, Any] = {}
