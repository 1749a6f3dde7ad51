"""Messages to msgpack bytes or JSON text and back, with errors that name the expected value."""

import base64
import contextlib
import json
import re
import threading
from functools import cache
from typing import Any, TypeVar, cast, get_args

import msgpack  # pyright: ignore[reportMissingTypeStubs]
import msgspec
from pydantic import ValidationError

from gslcosim.base.errors import ContractError
from gslcosim.contract.messages import Message
from gslcosim.contract.record import Record, get_pydantic_model, validate_fields, validate_json

AnyMessage = TypeVar("AnyMessage", bound=Message)

MAJOR_VERSION = 1
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack
_ENCODER = msgspec.msgpack.Encoder()
_DECODER_LOCK = threading.Lock()
# A float64 whose exponent has all its bits set; texts and arrays may contain the same bytes.
_NON_FINITE_PATTERN = re.compile(rb"\xcb[\x7f\xff][\xf0-\xff]")
MAX_MESSAGE_BYTES = 64 * 1024 * 1024
# Depth limit of lists and maps in a foreign message; those of a command are four deep.
MAX_NESTING = 32
_CONTAINER_TYPES = frozenset({dict, list, tuple})


def encode(message: Message) -> bytes:
    """Return the canonical bytes of a message: keys in the schema's order, shortest ints, reals as float64."""
    return _ENCODER.encode(message.sent)


def encode_finite(message: Message) -> bytes:
    """Return the bytes of `encode`, for messages that were built without checks: NaN and infinity are detected here.

    Raises:
        ContractError: a real is not finite.
    """
    payload = _ENCODER.encode(message.sent)
    if _NON_FINITE_PATTERN.search(payload):
        build_message(type(message), message.model_dump())
    return payload


def decode(message_type: type[AnyMessage], payload: bytes, *, max_bytes: int = MAX_MESSAGE_BYTES) -> AnyMessage:
    """Return the message in a payload.

    Raises:
        ContractError: too large, not msgpack, not a map, or not valid by the message's schema.
    """
    name = message_type.__name__
    if len(payload) > max_bytes:
        raise ContractError(f"{name}: expected at most {max_bytes} bytes, was {len(payload)}.")
    return build_message(message_type, _unpack_map(name, payload))


def decode_trusted(message_type: type[AnyMessage], payload: bytes) -> AnyMessage:
    """Return the message in a payload that one of our own services wrote: types are checked, limits are not.

    Raises:
        ContractError: as `decode`.
    """
    try:
        return _get_decoder(message_type).decode(payload)
    except (msgspec.DecodeError, RecursionError, ValueError):
        return decode(message_type, payload)  # for its error message


# Under a lock: msgspec exposes a type to other threads while it still reads its fields, and decoding then crashes.
@cache
def _get_decoder(message_type: type[AnyMessage]) -> msgspec.msgpack.Decoder[AnyMessage]:
    with _DECODER_LOCK:
        return msgspec.msgpack.Decoder(message_type)


def decode_untrusted(
    message_type: type[AnyMessage], payload: bytes, *, max_bytes: int = MAX_MESSAGE_BYTES
) -> AnyMessage:
    """Return the message in a payload that a foreign process wrote, by the rules of `unpack_untrusted`.

    Raises:
        ContractError: as `decode`; or a key is repeated, or lists and maps are nested too deep.
    """
    name = message_type.__name__
    if len(payload) > max_bytes:
        raise ContractError(f"{name}: expected at most {max_bytes} bytes, was {len(payload)}.")
    return build_message(message_type, unpack_untrusted(name, payload))


def unpack_untrusted(name: str, payload: bytes, *, has_lists: bool = False) -> dict[str, Any]:
    """Return the map in a payload that a foreign process wrote.

    Keys are unique, and lists and maps are at most `MAX_NESTING` deep. Our own services violate neither rule and are
    not checked: the check costs time.

    Args:
        has_lists: Arrays become lists, as in JSON, and not tuples, as in messages.

    Raises:
        ContractError: it is not one msgpack map, or violates one of the two rules.
    """
    fields = _unpack_map(name, payload, has_lists=has_lists, object_pairs_hook=_unique_keys)
    check_nesting(name, fields)
    return fields


def load_untrusted_json(name: str, text: str) -> Any:
    """Return the value in a JSON text that a foreign process wrote, by the rules of `unpack_untrusted`.

    Raises:
        ContractError: a key is repeated, or lists and objects are nested too deep.
        ValueError: it is not JSON.
    """
    try:
        value = json.loads(text, object_pairs_hook=_unique_keys)
    except _DuplicateKeyError as error:
        raise ContractError(f"{name}: {error}") from error
    check_nesting(name, value)
    return value


def check_nesting(name: str, value: object) -> None:
    """Check the nesting depth of the lists and maps of a value.

    Raises:
        ContractError: deeper than `MAX_NESTING`.
    """
    holders: list[Any] = [value] if type(value) in _CONTAINER_TYPES else []
    for _ in range(MAX_NESTING):
        items: list[Any] = []
        for holder in holders:
            items += cast(Any, holder).values() if isinstance(holder, dict) else holder
        holders = [item for item in items if type(item) in _CONTAINER_TYPES]
        if not holders:
            return
    raise ContractError(f"{name}: expected lists and maps at most {MAX_NESTING} deep, were deeper.")


class _DuplicateKeyError(ValueError):
    pass


# The effective one of two equal keys differs from reader to reader: Python takes the last, others the first.
def _unique_keys(pairs: list[tuple[Any, object]]) -> dict[Any, object]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _DuplicateKeyError(f"expected each key once, was {_shorten(twice)} {keys.count(twice)} times.")
    return fields


def encode_json(message: Message) -> bytes:
    """Return a message as one line of JSON in UTF-8, without a newline; bytes become base64 text."""
    return dump_json_line(message.model_dump())


def dump_json_line(fields: dict[str, Any]) -> bytes:
    """Return the fields of a message as one line of JSON in UTF-8, without a newline."""
    text = json.dumps(fields, default=encode_base64, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.encode()


def encode_base64(value: object) -> str:
    """Return bytes as base64 text; for `json.dumps` as `default`."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    raise TypeError(f"expected bytes, was {type(value).__name__}")


def decode_base64_fields(message_type: type[Message], fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a JSON object with its base64 texts decoded to bytes.

    Raises:
        ContractError: such a text is not base64.
    """
    for path in _find_bytes_paths(message_type):
        fields = _decode_base64_at(fields, path, f"{message_type.__name__}: {'.'.join(path)}")
    return fields


def _decode_base64_at(fields: dict[str, Any], path: tuple[str, ...], place: str) -> dict[str, Any]:
    name, *rest = path
    value: Any = fields.get(name)
    if rest:
        return {**fields, name: _decode_base64_at(value, tuple(rest), place)} if isinstance(value, dict) else fields  # pyright: ignore[reportUnknownArgumentType]
    if not isinstance(value, str):
        return fields
    try:
        return {**fields, name: base64.b64decode(value, validate=True)}
    except ValueError as error:
        raise ContractError(f"{place}: expected base64 text, was {_shorten(value)} ({error}).") from error


# Lists are left out: no message that an agent writes has bytes in a list.
@cache
def _find_bytes_paths(record: type[Record]) -> tuple[tuple[str, ...], ...]:
    paths: list[tuple[str, ...]] = []
    for name, field in get_pydantic_model(record).model_fields.items():
        for kind in (field.annotation, *get_args(field.annotation)):
            if kind is bytes:
                paths.append((name,))
            elif isinstance(kind, type) and issubclass(kind, Record):
                paths += [(name, *rest) for rest in _find_bytes_paths(kind)]
    return tuple(paths)


def decode_json(message_type: type[AnyMessage], text: bytes, *, max_bytes: int = MAX_MESSAGE_BYTES) -> AnyMessage:
    """Return the message in a JSON object that a foreign process wrote, by the rules of `decode_untrusted`.

    Raises:
        ContractError: too large, not UTF-8, not a JSON object, a key is repeated, or not valid by the schema.
    """
    name = message_type.__name__
    if len(text) > max_bytes:
        raise ContractError(f"{name}: expected at most {max_bytes} bytes, was {len(text)}.")
    with contextlib.suppress(ValueError, RecursionError):  # malformed JSON is reported below, in the parser's words
        load_untrusted_json(name, text.decode())
    try:
        return validate_json(message_type, text)
    except ValidationError as error:
        if error.errors(include_url=False)[0]["type"] in ("json_invalid", "model_type", "model_attributes_type"):
            what = error.errors(include_url=False)[0]["msg"]
            raise ContractError(
                f"{name}: expected a JSON object in UTF-8, was {_shorten(text)} ({what[:1].lower()}{what[1:]})."
            ) from error
        raise ContractError(f"{name}: {_format_problems(error)}") from error


class ObservationHead(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of an observation that a run itself needs: its tick, and whether it awaits a command."""

    tick: int
    awaiting_command: bool


_HEAD_DECODER = msgspec.msgpack.Decoder(ObservationHead)


def decode_observation_head(payload: bytes) -> ObservationHead:
    """Return the head of an observation that one of our own services wrote; the rest is not validated.

    Raises:
        ContractError: not a msgpack map with both fields.
    """
    try:
        return _HEAD_DECODER.decode(payload)
    except msgspec.DecodeError as error:
        raise ContractError(
            f"Observation: expected a tick and awaiting_command, was {_shorten(payload)} ({error})."
        ) from error


def build_message(message_type: type[AnyMessage], fields: dict[str, object]) -> AnyMessage:
    """Return the message with these fields.

    Raises:
        ContractError: a field is missing, of the wrong type, or out of its range.
    """
    try:
        return validate_fields(message_type, fields)
    except ValidationError as error:
        raise ContractError(f"{message_type.__name__}: {_format_problems(error)}") from error


def get_encoding(message_type: type[Message]) -> str:
    """Return the encoding header that travels with a message."""
    return f"application/msgpack;gslcosim.{message_type.__name__}/{MAJOR_VERSION}"


def _unpack_map(name: str, payload: bytes, *, has_lists: bool = False, **hooks: Any) -> dict[str, Any]:
    try:
        fields = _msgpack.unpackb(payload, raw=False, strict_map_key=True, use_list=has_lists, **hooks)
    except _DuplicateKeyError as error:
        raise ContractError(f"{name}: {error}") from error
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise ContractError(
            f"{name}: expected a msgpack map, was {len(payload)} bytes starting {payload[:16].hex()} ({error})."
        ) from error
    if not isinstance(fields, dict):
        raise ContractError(f"{name}: expected a msgpack map, was {type(fields).__name__}.")
    return cast(dict[str, Any], fields)


# pydantic's own text spans several lines and quotes whole inputs; one line per problem is enough for an agent's author.
def _format_problems(error: ValidationError) -> str:
    problems: list[str] = []
    for problem in error.errors(include_url=False)[:8]:
        place = ".".join(str(part) for part in problem["loc"]) or "message"
        was = "" if problem["type"] == "missing" else f", was {_shorten(problem['input'])}"
        problems.append(f"{place}: {problem['msg'][:1].lower()}{problem['msg'][1:]}{was}")
    return "; ".join(problems) + "."


def _shorten(value: object) -> str:
    try:
        text = repr(value)
    except RecursionError:  # msgpack and pydantic can read values too deep for repr
        return f"a deeply nested {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."
