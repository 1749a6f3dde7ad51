"""Messages to msgpack bytes and back, with errors that say what was expected."""

from typing import Any, TypeVar, cast

import msgpack  # pyright: ignore[reportMissingTypeStubs]
from pydantic import ValidationError

from gslcosim.contract.messages import Message
from gslcosim.errors import ContractError

AnyMessage = TypeVar("AnyMessage", bound=Message)

MAJOR_VERSION = 1
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack
MAX_MESSAGE_BYTES = 64 * 1024 * 1024


def encode(message: Message) -> bytes:
    """Return the canonical bytes of a message: keys in the schema's order, shortest ints, reals as float64."""
    return _msgpack.packb(message.model_dump(), use_bin_type=True)


def decode(message_type: type[AnyMessage], payload: bytes, *, max_bytes: int = MAX_MESSAGE_BYTES) -> AnyMessage:
    """Return the message in a payload.

    Raises:
        ContractError: too large, not msgpack, not a map, or not what the message's schema says.
    """
    name = message_type.__name__
    if len(payload) > max_bytes:
        raise ContractError(f"{name}: expected at most {max_bytes} bytes, was {len(payload)}.")
    return from_fields(message_type, _unpack_map(name, payload))


def peek_tick(payload: bytes) -> int:
    """Return the tick of a message without judging the rest of it.

    Raises:
        ContractError: not a msgpack map with an integer `tick`.
    """
    tick = _unpack_map("message", payload).get("tick")
    if type(tick) is not int:
        raise ContractError(f"message: tick: expected an integer, was {_short(tick)}.")
    return tick


def from_fields(message_type: type[AnyMessage], fields: dict[str, object]) -> AnyMessage:
    """Return the message with these fields.

    Raises:
        ContractError: a field is missing, of the wrong type, or out of its range.
    """
    try:
        return message_type.model_validate(fields)
    except ValidationError as error:
        raise ContractError(f"{message_type.__name__}: {_problems_text(error)}") from error


def encoding_of(message_type: type[Message]) -> str:
    """Return the encoding header that travels with a message."""
    return f"application/msgpack;gslcosim.{message_type.__name__}/{MAJOR_VERSION}"


def _unpack_map(name: str, payload: bytes) -> dict[str, Any]:
    try:
        fields = _msgpack.unpackb(payload, raw=False, strict_map_key=True, use_list=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise ContractError(
            f"{name}: expected a msgpack map, was {len(payload)} bytes starting {payload[:16].hex()} ({error})."
        ) from error
    if not isinstance(fields, dict):
        raise ContractError(f"{name}: expected a msgpack map, was {type(fields).__name__}.")
    return cast(dict[str, Any], fields)


# pydantic's own text spans several lines and quotes whole inputs; an agent's author wants one line a field.
def _problems_text(error: ValidationError) -> str:
    problems: list[str] = []
    for problem in error.errors(include_url=False)[:8]:
        place = ".".join(str(part) for part in problem["loc"]) or "message"
        was = "" if problem["type"] == "missing" else f", was {_short(problem['input'])}"
        problems.append(f"{place}: {problem['msg'][:1].lower()}{problem['msg'][1:]}{was}")
    return "; ".join(problems) + "."


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
