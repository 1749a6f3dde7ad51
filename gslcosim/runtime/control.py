"""What the runtime's own processes tell each other: never part of a run's results."""

from typing import Any

import msgpack
from pydantic import BaseModel, ConfigDict, ValidationError

from gslcosim.errors import ContractError

START = "ctl/start"
STOP = "ctl/stop"
CLOSE = "ctl/close"
FAULT = "ctl/fault"


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


def resend(name: str) -> str:
    """Return the key on which a participant answers with a message it has sent before."""
    return f"rpc/{name}/resend"


def describe(name: str) -> str:
    """Return the key on which a participant says what it is."""
    return f"rpc/{name}/describe"


class Control(BaseModel):
    """Base of the control messages."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    def to_bytes(self) -> bytes:
        """Return the message as msgpack."""
        packed: Any = msgpack.packb(self.model_dump())
        return packed

    @classmethod
    def from_bytes(cls, payload: bytes) -> Any:
        """Return the message in a payload.

        Raises:
            ContractError: it is not this message.
        """
        try:
            return cls.model_validate(msgpack.unpackb(payload))
        except (ValueError, TypeError, ValidationError, msgpack.UnpackException) as error:
            raise ContractError(f"{cls.__name__}: expected a control message, was {payload[:32]!r}.") from error


class TickNote(Control):
    """A tick: the last one finished (progress), or the last one that counts (stop)."""

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


class Bye(Control):
    """A participant is done: the hash chains of its ports, and where its time went."""

    name: str
    trails: dict[str, dict[str, Any]]
    timing: dict[str, int]
