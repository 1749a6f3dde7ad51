"""Protocol between the supervisor and hosts: keys, control messages, bundles, and events of the supervisor."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import msgpack  # pyright: ignore[reportMissingTypeStubs]
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError
from typing_extensions import TypedDict

from gslcosim.base.errors import ContractError
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.runtime.agents.session import AgentEvent
from gslcosim.runtime.participant_status import MissingMessage, ParticipantName, PortName, Tick

START_KEY = "ctl/start"
STOP_KEY = "ctl/stop"
CLOSE_KEY = "ctl/close"
FAULT_KEY = "ctl/fault"
BUNDLE_PREFIX = "bundle/"
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack

LARGE_BYTES = 4096

# These messages cross hosts: no number, name or text of another host is taken as it comes.
MAX_MESSAGE_BYTES = 1 << 30
MAX_TEXT = 1 << 20
ShortText = Annotated[str, StringConstraints(max_length=300)]
Text = Annotated[str, StringConstraints(max_length=MAX_TEXT)]
Amount = Annotated[int, Field(ge=0, le=1 << 62)]
_MAX_ITEMS = 100_000
_Base64 = Annotated[str, StringConstraints(pattern=r"^([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?$")]


# Keys by the name of a participant, or of an agent on the bus, which the contract names.
build_liveliness_key = "alive/{}".format
build_agent_liveliness_key = "agents/{}/alive".format
# Which tick it has finished, and in the end its digests.
build_progress_key = "ctl/progress/{}".format
build_final_report_key = "ctl/bye/{}".format
# Questions to it: a message that it has sent before, what it is, which tick it has finished, and how it goes.
build_resend_key = "rpc/{}/resend".format
build_description_key = "rpc/{}/describe".format
build_finished_key = "rpc/{}/finished".format
build_inspection_key = "rpc/{}/inspect".format
# Bundles that others send to it, and those that it sends, to any reader.
build_incoming_bundles_key = (BUNDLE_PREFIX + "*/$*.{}.$*").format
build_outgoing_bundles_key = (BUNDLE_PREFIX + "{}/*").format


def build_bundle_key(writer: str, readers: Iterable[str]) -> str:
    """Return the key on which a participant sends the messages of several ports and ticks in one, to its readers.

    They are named so that each gets all that concerns it, and no more, with one subscription.
    """
    return f"{BUNDLE_PREFIX}{writer}/.{'.'.join(sorted(readers))}."


def is_read_by_agents(port: str) -> bool:
    """Return whether agents read a port: each message is then also sent on its own key, as the contract requires."""
    return port.startswith("agents/")


def pack_bundle(messages: list[tuple[str, bytes]]) -> bytes:
    """Return messages as one payload: a msgpack list of (port, payload)."""
    return _msgpack.packb(messages)


def unpack_bundle(payload: bytes) -> list[tuple[str, bytes]]:
    """Return the messages of a bundle."""
    try:
        messages: Any = _msgpack.unpackb(payload, use_list=False)
        return [(str(port), bytes(message)) for port, message in messages]
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise ContractError(f"bundle: expected a list of (port, payload), was {payload[:32]!r}.") from error


class ControlMessage(BaseModel):
    """Base of the control messages."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    def to_bytes(self) -> bytes:
        """Return the message as msgpack."""
        return _msgpack.packb(self.model_dump())

    @classmethod
    def from_bytes(cls, payload: bytes) -> Self:
        """Return the message in a payload."""
        if len(payload) > MAX_MESSAGE_BYTES:
            raise ContractError(
                f"{cls.__name__}: expected at most {MAX_MESSAGE_BYTES} bytes, was {len(payload)}. Another host sends "
                "what gslcosim does not."
            )
        try:
            return cls.model_validate(_msgpack.unpackb(payload))
        except ValidationError as error:
            # In one sentence, with no more of the value than fits in it.
            first = error.errors(include_url=False, include_context=False)[0]
            place = ".".join(str(part)[:80] for part in first["loc"]) or "message"
            text = f"expected something else ({first['msg'][:300]}), was {str(first['input'])[:80]!r}."
            raise ContractError(f"{cls.__name__}: {place}: {text}") from error
        except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
            raise ContractError(f"{cls.__name__}: expected a control message, was {payload[:32]!r}.") from error


class TickReport(ControlMessage):
    """A tick: the last one finished (progress), or the last one that counts (stop)."""

    tick: Tick


class ReaderReport(ControlMessage):
    """The last tick that a participant has finished, with its name."""

    name: ParticipantName
    tick: Tick


class FaultReport(ControlMessage):
    """A participant's own failure."""

    participant: ParticipantName
    tick: Tick
    text: Text


class ResendRequest(ControlMessage):
    """Ask for the message of a port at a tick."""

    port: PortName
    tick: Tick


class ParticipantDescription(ControlMessage):
    """Description of a participant: its name, version, and the hash of the contract it speaks."""

    name: ParticipantName
    version: ShortText
    contract_hash: ShortText
    pid: Amount
    host: ShortText

    @property
    def difference(self) -> str:
        """Why it cannot take part in a run of this process: its contract is another; empty where it can."""
        if self.contract_hash == CONTRACT_HASH:
            return ""
        return (
            f"expected contract {CONTRACT_HASH}, was {self.contract_hash} (gslcosim {self.version} on "
            f"{self.host}). Install the same version everywhere."
        )


class ParticipantInspection(ControlMessage):
    """One moment of a service, as it sees itself; see `ParticipantStatus`, whose fields these are."""

    name: ParticipantName
    state: Literal["working", "waiting", "done"]
    tick: Tick
    missing: tuple[MissingMessage, ...] = Field(max_length=_MAX_ITEMS)
    lacking_credit: tuple[ParticipantName, ...] = Field(max_length=_MAX_ITEMS)
    occupied_s: float | None = Field(ge=0, allow_inf_nan=False)
    queued_ticks: Amount
    pid: Amount
    cpu_s: float = Field(ge=0, allow_inf_nan=False)
    memory_bytes: Amount | None
    n_resends: Amount


class HashChainFields(TypedDict):
    """The hash chain of a port; see `gslcosim.runtime.digest.HashChain`."""

    ticks: list[Tick]
    links: _Base64


class FinalReport(ControlMessage):
    """Final report of a participant: its last tick, the hash chains of its ports, where its time went, its summary."""

    name: ParticipantName
    last_tick: Tick
    trails: dict[PortName, HashChainFields]
    timing: dict[ShortText, int]
    summary: dict[str, Any] = {}


@dataclass(frozen=True)
class MessageReceived:
    """A message has arrived over the bus; its key shows its type.

    A requested message comes with the key on which it would have come without a request; a description comes with the
    key of its request.
    """

    key: str
    payload: bytes


@dataclass(frozen=True)
class LivelinessChanged:
    """The liveliness token of a service or of an agent on the bus is there, or is gone."""

    key: str
    is_alive: bool


@dataclass(frozen=True)
class ProcessEnded:
    """A process that joins the bus has ended: in words how, and whether by itself with an error, which it reports."""

    name: str
    how: str
    is_by_itself: bool


@dataclass(frozen=True)
class ProcessStopped:
    """A process that joins the bus has been stopped for too long, and is being killed."""

    name: str


@dataclass(frozen=True)
class Interrupted:
    """A request to end the run."""


SupervisorEvent = MessageReceived | LivelinessChanged | ProcessEnded | ProcessStopped | Interrupted | AgentEvent
