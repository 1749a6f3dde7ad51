"""The reference of all keys and messages as Markdown, made from the code: `make docs` writes docs/messages.md."""

import inspect
import json
import sys
import types
import typing
from typing import Any

from pydantic.fields import FieldInfo

from gslcosim.contract.version import CONTRACT_VERSION
from gslcosim.contract.codec import MAX_NESTING
from gslcosim_conformance.key_table import KEY_TABLE, KeyEntry
from gslcosim.contract.messages import Message, Record
from gslcosim.contract.participant_messages import PARTICIPATION_VERSION
from gslcosim.contract.record import get_pydantic_model
from gslcosim_conformance.message_schemas import list_message_types, list_participation_types

# Which message travels on which key.
MESSAGES_BY_KEY = {channel.key: channel.message for channel in KEY_TABLE}

_HEAD = f"""# Keys and messages, contract {CONTRACT_VERSION}

<!-- Made by `make docs` from gslcosim/contract; do not edit. -->

A message is a msgpack map with string keys; its encoding header is `application/msgpack;gslcosim.<Message>/1`.
Reals are float64, or whole numbers where a language has no others; NaN and infinity are refused.
Unknown keys are ignored; a key with a default may be absent; a changed meaning gets a new name.
In a command each key is there once, and lists and maps are at most {MAX_NESTING} deep.
[notation.md](notation.md) has frames, units and words.
The same for programs, as JSON Schema, AsyncAPI and golden bytes, is in [agents/contract](../agents/contract/README.md).
"""


_PARTICIPANTS = f"""## Messages of participants, contract {PARTICIPATION_VERSION}

Your own model sends and receives these through the gateway; see [participant.md](extend/participant.md).
In a run `WindShare` is on the key `truth/wind`, `SourceRate` on `truth/sources/<index>`, `ProbeSamples` on
`truth/probes`, and `ParticipantValues` on `participant/<name>/<word>`; the others stay between the program and the
one who started it.
They are a contract of their own, with the rules of [contract-evolution.md](contract-evolution.md).
"""


def build_messages_markdown() -> str:
    """Return the whole reference."""
    found, with_participants = list_message_types(), list_participation_types()
    return "\n".join(
        [
            _HEAD,
            _keys_table(),
            "## Messages\n",
            *map(_section, found),
            _PARTICIPANTS,
            *map(_section, with_participants),
            "## Parts of messages\n",
            *map(_section, _parts((*found, *with_participants))),
        ]
    )


def _keys_table() -> str:
    return "\n".join(
        [
            "## Keys\n",
            "Keys are relative to the run's namespace `gsl/<run>`.",
            "An agent reaches those under `agents/<its name>/`, and no others.\n",
            "| key | message | written by | when | read by |",
            "|---|---|---|---|---|",
            *map(_key_row, KEY_TABLE),
            "",
        ]
    )


def _key_row(channel: KeyEntry) -> str:
    name = channel.message
    cells = (f"`{channel.key}`", f"[{name}](#{name.lower()})", channel.writer, channel.when, channel.readers)
    return f"| {' | '.join(cells)} |"


def _section(record: type[Record]) -> str:
    text = inspect.cleandoc(record.__doc__ or "")
    rows = [_row(name, field) for name, field in get_pydantic_model(record).model_fields.items()]
    return "\n".join([f"### {record.__name__}\n", text, "", "| field | type | default |", "|---|---|---|", *rows, ""])


def _row(name: str, field: FieldInfo) -> str:
    default = "" if field.is_required() else f"`{json.dumps(field.default)}`".replace("null", "nil")
    limits = "".join(f", {text}" for text in _limits(field.annotation, tuple(field.metadata)))
    return f"| `{name}` | {_type_text(field.annotation)}{limits} | {default} |"


# Records and arrays that messages are made of, in the order in which they are met.
def _parts(found: tuple[type[Message], ...]) -> list[type[Record]]:
    parts: list[type[Record]] = []
    waiting: list[Any] = [annotation for message in found for annotation in _types_in(message)]
    while waiting:
        annotation = waiting.pop(0)
        waiting += typing.get_args(annotation)
        if not isinstance(annotation, type) or not issubclass(annotation, Record) or annotation in parts:
            continue
        parts.append(annotation)
        waiting += _types_in(annotation)
    return parts


def _types_in(record: type[Record]) -> list[Any]:
    return [field.annotation for field in get_pydantic_model(record).model_fields.values()]


def _type_text(annotation: Any) -> str:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return "".join([_type_text(arguments[0]), *(f", {text}" for text in _limits(arguments[0], arguments[1:]))])
    if origin is typing.Literal:
        return " or ".join(f"`{value}`" for value in arguments)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_type_text(argument) for argument in arguments)
    if origin is tuple and arguments[-1] is Ellipsis:
        return f"list of {_type_text(arguments[0])}"
    if annotation is typing.Any:
        return "any"
    if origin is dict:
        return f"map of {_type_text(arguments[0])} to {_type_text(arguments[1])}"
    if origin is tuple:
        return f"{len(arguments)} x {_type_text(arguments[0])}"
    if isinstance(annotation, type) and issubclass(annotation, Record):
        return f"[{annotation.__name__}](#{annotation.__name__.lower()})"
    return _TYPE_WORDS[annotation]


_TYPE_WORDS: dict[Any, str] = {
    types.NoneType: "nil",
    bool: "bool",
    bytes: "bin",
    float: "float",
    int: "int",
    str: "str",
}
_LIMIT_WORDS = {
    "ge": "at least {}",
    "gt": "above {}",
    "le": "at most {}",
    "lt": "below {}",
    "pattern": "`{}`",
    "min_length": "at least {} {counted}",
    "max_length": "at most {} {counted}",
}


def _limits(annotation: Any, metadata: tuple[Any, ...]) -> list[str]:
    counted = {tuple: "items", dict: "entries"}.get(typing.get_origin(annotation), "characters")
    flat = [item for entry in metadata for item in (getattr(entry, "metadata", None) or [entry])]
    texts = [(words, getattr(item, name, None)) for item in flat for name, words in _LIMIT_WORDS.items()]
    said = [words.format(value, counted=counted) for words, value in texts if value is not None]
    return [text.replace(" 1 items", " 1 item") for text in said]


if __name__ == "__main__":
    sys.stdout.write(build_messages_markdown())
