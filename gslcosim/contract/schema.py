"""The contract as JSON Schema 2020-12, and its identity: a hash over what the schemas say, without their prose."""

import hashlib
import json
from functools import cache
from typing import Any, cast

from gslcosim.contract import messages, participation
from gslcosim.contract.description import description_of
from gslcosim.contract.messages import CONTRACT_VERSION, Message
from gslcosim.contract.participation import PARTICIPATION_VERSION
from gslcosim.contract.ventilation import WindShare

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_BYTES = {"type": "string", "contentEncoding": "base64"}
_PROSE = ("title", "description")
_LIMITS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def message_types() -> tuple[type[Message], ...]:
    """Return all message types of the contract, by name."""
    found = [item for item in vars(messages).values() if isinstance(item, type) and issubclass(item, Message)]
    return tuple(sorted((item for item in found if item is not Message), key=lambda item: item.__name__))


def participation_types() -> tuple[type[Message], ...]:
    """Return the message types between a run and models of a user's own, by name; agents meet none of them."""
    found = [item for item in vars(participation).values() if isinstance(item, type) and issubclass(item, Message)]
    own = (item for item in found if item.__module__ == participation.__name__)
    return tuple(sorted((*own, WindShare), key=lambda item: item.__name__))


def published_types() -> tuple[type[Message], ...]:
    """Return all message types that are published, by name."""
    return tuple(sorted((*message_types(), *participation_types()), key=lambda item: item.__name__))


def json_schema_of(message_type: type[Message]) -> dict[str, Any]:
    """Return the JSON Schema of a message, complete in itself.

    It is open: unknown keys are allowed. Two rules JSON Schema cannot say are left to the reader: a whole number
    written with a point (`3.0`) is no integer here, and reals are finite.
    """
    # pydantic's titles only repeat the names.
    schema = _pruned(description_of(message_type).model_json_schema(), ("title",))
    name = message_type.__name__
    is_agents = message_type in message_types()
    part = f"contract:{CONTRACT_VERSION}" if is_agents else f"participation:{PARTICIPATION_VERSION}"
    return {"$schema": DIALECT, "$id": f"urn:gslcosim:{part}:{name}", "title": name, **schema}


@cache
def contract_hash() -> str:
    """Return the hash of the canonical JSON Schemas; two processes that speak the same contract have the same."""
    return _hash_of(message_types())


@cache
def participation_hash() -> str:
    """Return the hash of the canonical JSON Schemas of all that a participant may be sent or send."""
    return _hash_of(published_types())


def _hash_of(types: tuple[type[Message], ...]) -> str:
    schemas = {item.__name__: _pruned(description_of(item).model_json_schema(), _PROSE) for item in types}
    text = json.dumps(schemas, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


# pydantic's word for bytes is no standard's, and its versions differ in how they write limits (1 or 1.0). In
# `properties` and `$defs` a key is a name, which may well be `title`; elsewhere it is a word of JSON Schema.
def _pruned(schema: Any, dropped: tuple[str, ...]) -> Any:
    if isinstance(schema, list):
        return [_pruned(item, dropped) for item in cast(list[Any], schema)]
    if not isinstance(schema, dict):
        return schema
    words = cast(dict[str, Any], schema)
    if words.get("type") == "string" and words.get("format") in ("binary", "base64url"):
        return _BYTES
    changed: dict[str, Any] = {}
    for word, value in words.items():
        if word in ("properties", "$defs"):
            changed[word] = {name: _pruned(item, dropped) for name, item in value.items()}
        elif word in _LIMITS and float(value).is_integer():
            changed[word] = int(value)
        elif word not in dropped:
            changed[word] = _pruned(value, dropped)
    return changed
