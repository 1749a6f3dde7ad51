"""What is wrong with bytes that are no command, and the line that puts it right, as Python would write it."""

import json
from collections.abc import Iterator
from typing import Any

import msgpack

_LENGTH_BYTES = 4
_TO_STDERR = "Only commands belong there; write notes to the standard error: print(text, file=sys.stderr)."
_USE_JSON = (
    "Pack the command with a msgpack library, msgpack.packb(command) in place of json.dumps(command); behind "
    "the gateway you may also start it with format: json (--format json here)."
)
_JSON_ONCE = "Write one object, then a line feed, then flush: print(json.dumps(command), flush=True)."
_ONCE = (
    "Write each key once: fill a map (a dict) and encode it when it is complete, in place of joining pieces of text."
)
_SHALLOW = "Leave out what nests so deep: no field of Command does."
_UTF_8 = (
    "Write texts in UTF-8: text.encode('utf-8') in place of text.encode('latin-1'), or open the stream with "
    "encoding='utf-8'."
)
_AS_BIN = "Pack bytes as bin and texts as str: msgpack.packb(command, use_bin_type=True)."
_BASE64 = "JSON has no bytes: write base64 text, base64.b64encode(data).decode() in place of str(data) or list(data)."
_LENGTH_FIRST = "Write the length of each map before it: output.write(len(payload).to_bytes(4, 'big') + payload)."

# What the gateway says of what it refuses, the first that fits.
_REMEDY_OF_WORDS = (
    ("byte order mark", "Leave the mark out: encoding='utf-8' in place of 'utf-8-sig'."),
    ("begin a msgpack map", _LENGTH_FIRST),
    ("As little-endian it is", "Write the length big-endian: len(payload).to_bytes(4, 'big') in place of 'little'."),
    (
        "Is it JSON?",
        "Start it with format: json (--format json here), or write msgpack.packb(command) after its length.",
    ),
    ("expected the length of a frame", f"{_LENGTH_FIRST} {_TO_STDERR}"),
    ("as in format: msgpack", "Start it with format: msgpack (--format msgpack here), or write json.dumps(command)."),
    ("each key once", _ONCE),
    ("deep, were deeper", _SHALLOW),
    ("expected base64 text", _BASE64),
    ("expected a line in UTF-8", _UTF_8),
    ("Extra data", _JSON_ONCE),
    ("starting \"{'", "Write json.dumps(command) in place of str(command): JSON has double quotes."),
    ("starting '{", "Write the line with a JSON library: json.dumps(command)."),
    ("starting '[", 'Write an object {"tick": ..., "kind": ...}, not the list of its values.'),
    ("expected one JSON object a line", _TO_STDERR),
    ("line feed after each object", _JSON_ONCE),
)


def remedy_of_refusal(text: str) -> str:
    """Return what to change about a frame that the gateway refused with a text; empty where nothing more is known."""
    return next((remedy for words, remedy in _REMEDY_OF_WORDS if words in text), "")


def remedy_of_bytes(payload: bytes, said: str) -> str:
    """Return what to change about bytes that are no msgpack map as a command needs one; empty where nothing is known.

    Args:
        payload: What the agent sent.
        said: What is wrong with it, as the reader says it.
    """
    if "each key once" in said or "deep, were deeper" in said:
        return remedy_of_refusal(said)
    if "as bytes (bin)" in said:
        return _AS_BIN.replace("Pack bytes as bin and texts as str", "Keys are texts, 'tick' and not b'tick'")
    if (inner := payload[_LENGTH_BYTES:]) and int.from_bytes(payload[:_LENGTH_BYTES], "big") == len(inner):
        return "Send the map alone, without its length before it: publisher.put(msgpack.packb(command))."
    if payload.lstrip()[:1] == b"{":
        return _USE_JSON if _is_json(payload) else f"{_TO_STDERR} {_USE_JSON}"
    if payload[:16].isascii() and payload[:16].decode(errors="replace").isprintable() and payload:
        return _TO_STDERR
    if (raw := _raw(payload)) is None:
        return "Send whole maps, one a message or frame: msgpack.packb(command)."
    return _remedy_of_raw(raw)


def remedy_of_fields(fields: dict[str, Any]) -> str:
    """Return what to change about fields that a schema refuses, where it is how bytes were encoded; else empty."""
    for place, value in _leaves(fields.get("belief")):
        if place.endswith("data") and isinstance(value, str):
            return f"belief{place} is text. {_AS_BIN}"
        if place.endswith("data[0]"):
            return f"belief.probability.data is a list of numbers. In msgpack write bytes; in JSON: {_BASE64}"
    return ""


def start_of(payload: bytes) -> str:
    """Return the first bytes of something in hexadecimal, and as text where it is one."""
    shown = payload[:16].hex()
    is_text = payload[:16].isascii() and payload[:1].isascii() and payload[:16].decode(errors="replace").isprintable()
    return f"{shown} ({payload[:16].decode()!r} as text)" if payload and is_text else shown


# Read without a look at texts, so that the one that is no UTF-8 can be named.
def _remedy_of_raw(raw: object) -> str:
    if not isinstance(raw, dict):
        return "Pack a map {'tick': ..., 'kind': ...}, not the list of its values and not a text."
    for place, value in _leaves(raw):
        if isinstance(value, bytes) and not _is_utf_8(value):
            name = place.lstrip(".")
            if name.endswith("data"):
                return f"{name} holds bytes, packed as text (str). {_AS_BIN}"
            return f"{name} is {value.decode('latin-1')[:40]!r} in Latin-1. {_UTF_8}"
    return "Keys are texts: {'tick': ...}, and no numbers."


def _raw(payload: bytes) -> object:
    try:
        return msgpack.unpackb(payload, raw=True, strict_map_key=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None


# Without recursion, as agents may nest as they like. The places are written `.belief.probability.data`.
def _leaves(value: object) -> Iterator[tuple[str, object]]:
    waiting: list[tuple[str, object]] = [("", value)]
    while waiting:
        place, item = waiting.pop()
        if isinstance(item, dict):
            waiting += [(f"{place}.{_word(key)}", inner) for key, inner in item.items()]
        elif isinstance(item, list):
            waiting += [(f"{place}[{i}]", inner) for i, inner in enumerate(item)]
        else:
            yield place, item


def _word(key: object) -> str:
    return key.decode(errors="replace") if isinstance(key, bytes) else str(key)


def _is_utf_8(value: bytes) -> bool:
    try:
        value.decode()
    except UnicodeDecodeError:
        return False
    return True


def _is_json(payload: bytes) -> bool:
    try:
        return isinstance(json.loads(payload), dict)
    except (ValueError, RecursionError):
        return False
