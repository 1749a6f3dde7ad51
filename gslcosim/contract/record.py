"""What all messages are made of: numbers and names, frozen records, and the base of messages."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

Quaternion = tuple[float, float, float, float]
Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Tick = Annotated[int, Field(ge=0, le=2**53)]


class Record(BaseModel):
    """Base of all parts of messages: frozen, no conversion of types, unknown keys ignored, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore", allow_inf_nan=False, val_json_bytes="base64")


class Message(Record):
    """Base of all messages: a fact about one tick."""

    tick: Tick

    @property
    def closes_port(self) -> bool:
        """Whether no further message follows on this port."""
        return False

    @property
    def is_question(self) -> bool:
        """Whether somebody's answer to this message is waited for."""
        return False

    def announced_ports(self) -> frozenset[str]:
        """Return the announced ports that carry a message for this tick because of this one."""
        return frozenset()
