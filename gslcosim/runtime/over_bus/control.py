"""What the runtime's own processes tell each other: never part of a run's results."""

from collections.abc import Iterable
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]
from pydantic import BaseModel, ConfigDict, ValidationError

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
        try:
            return cls.model_validate(_msgpack.unpackb(payload))
        except (ValueError, TypeError, ValidationError, msgpack.UnpackException) as error:
            raise ContractError(f"{cls.__name__}: expected a control message, was {payload[:32]!r}.") from error


class TickNote(Control):
    """A tick: the last one finished (progress), or the last one that counts (stop)."""

    tick: int


class ReaderNote(Control):
    """The last tick that a participant has finished, with its name."""

    name: str
    tick: int


class WaitingNote(Control):
    """What a participant needs for its next tick and does not have: (port, tick) pairs, or credit of readers."""

    tick: int
    missing: list[tuple[str, int]] = []
    lacking_credit: list[str] = []


class FaultNote(Control):
    """A participant's own failure."""

    participant: str
    tick: int
    text: str


class ResendRequest(Control):
    """Ask for the message of a port at a tick."""

    port: str
    tick: int


class Description(Control):
    """What a participant is: its name, version, and the hash of the contract it speaks."""

    name: str
    version: str
    contract_hash: str
    pid: int
    host: str

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

    name: str
    tick: int
    is_finished: bool
    waits_for: list[str]
    queued_ticks: int
    pid: int
    cpu_s: float
    memory_bytes: int | None
    n_resends: int


class Bye(Control):
    """A participant is done: its last tick, the hash chains of its ports, where its time went, what it has to tell."""

    name: str
    last_tick: int
    trails: dict[str, dict[str, Any]]
    timing: dict[str, int]
    account: dict[str, Any] = {}
