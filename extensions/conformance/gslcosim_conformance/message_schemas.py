"""JSON Schemas of the messages of the contract."""

from typing import Any, cast

from gslcosim.contract import messages, participant_messages
from gslcosim.contract.environment_messages import ProbeSamples, SourceRate, WindShare
from gslcosim.contract.messages import Message
from gslcosim.contract.participant_messages import PARTICIPATION_VERSION
from gslcosim.contract.record import get_pydantic_model
from gslcosim.contract.version import CONTRACT_VERSION

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_BYTES = {"type": "string", "contentEncoding": "base64"}
_LIMITS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def list_message_types() -> tuple[type[Message], ...]:
    """Return all message types of the contract, by name."""
    found = [item for item in vars(messages).values() if isinstance(item, type) and issubclass(item, Message)]
    return tuple(sorted((item for item in found if item is not Message), key=lambda item: item.__name__))


def list_participation_types() -> tuple[type[Message], ...]:
    """Return the message types between a run and users' own models, by name; no agent receives them."""
    found = [item for item in vars(participant_messages).values() if isinstance(item, type)]
    own = [item for item in found if issubclass(item, Message) and item.__module__ == participant_messages.__name__]
    return tuple(sorted((*own, ProbeSamples, SourceRate, WindShare), key=lambda item: item.__name__))


def list_published_types() -> tuple[type[Message], ...]:
    """Return all published message types, by name."""
    return tuple(sorted((*list_message_types(), *list_participation_types()), key=lambda item: item.__name__))


def build_json_schema(message_type: type[Message]) -> dict[str, Any]:
    """Return the self-contained JSON Schema of a message.

    It is open: unknown keys are allowed. Two rules that JSON Schema cannot express are left to the reader: a whole
    number written with a decimal point (`3.0`) is not an integer here, and reals are finite.
    """
    # pydantic's titles only repeat the names.
    schema = prune_schema(get_pydantic_model(message_type).model_json_schema(), ("title",))
    name = message_type.__name__
    is_agents = message_type in list_message_types()
    part = f"contract:{CONTRACT_VERSION}" if is_agents else f"participation:{PARTICIPATION_VERSION}"
    return {"$schema": DIALECT, "$id": f"urn:gslcosim:{part}:{name}", "title": name, **schema}


def prune_schema(schema: Any, dropped: tuple[str, ...]) -> Any:
    """Return a schema of pydantic without some keywords, with the standard's format of bytes, and whole limits.

    In `properties` and `$defs` a key is a name, which may well be `title`; elsewhere it is a keyword of JSON Schema.
    """
    if isinstance(schema, list):
        return [prune_schema(item, dropped) for item in cast(list[Any], schema)]
    if not isinstance(schema, dict):
        return schema
    words = cast(dict[str, Any], schema)
    if words.get("type") == "string" and words.get("format") in ("binary", "base64url"):
        return _BYTES
    changed: dict[str, Any] = {}
    for word, value in words.items():
        if word in ("properties", "$defs"):
            changed[word] = {name: prune_schema(item, dropped) for name, item in value.items()}
        elif word in _LIMITS and float(value).is_integer():
            changed[word] = int(value)
        elif word not in dropped:
            changed[word] = prune_schema(value, dropped)
    return changed
