"""JSON Schemas of the contract, their hash without prose, and the check of the contract that the other side states.

`docs/contract-evolution.md` has the rules; decision 0008 explains why an agent's first command states its contract.
"""

import hashlib
import json
import re
from functools import cache
from typing import Any, cast

from gslcosim.base.errors import ContractError
from gslcosim.contract import messages, participant_messages
from gslcosim.contract.environment_messages import ProbeSamples, SourceRate, WindShare
from gslcosim.contract.messages import CONTRACT_VERSION, RECORDED_ONLY, Message
from gslcosim.contract.participant_messages import PARTICIPATION_VERSION
from gslcosim.contract.record import get_pydantic_model

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_BYTES = {"type": "string", "contentEncoding": "base64"}
_PROSE = ("title", "description")
_LIMITS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
_CONTRACT_PATTERN = re.compile(r"(?P<major>\d{1,6})\.(?P<minor>\d{1,6})(?:\+(?P<hash>[0-9a-f]{32}))?", re.ASCII)


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
    schema = _prune(get_pydantic_model(message_type).model_json_schema(), ("title",))
    name = message_type.__name__
    is_agents = message_type in list_message_types()
    part = f"contract:{CONTRACT_VERSION}" if is_agents else f"participation:{PARTICIPATION_VERSION}"
    return {"$schema": DIALECT, "$id": f"urn:gslcosim:{part}:{name}", "title": name, **schema}


@cache
def get_contract_hash() -> str:
    """Return the hash of the canonical JSON Schemas; it is equal in processes with the same contract."""
    return _hash_schemas(list_message_types())


@cache
def get_participation_hash() -> str:
    """Return the hash of the canonical JSON Schemas of all messages that a participant may receive or send."""
    return _hash_schemas(list_published_types())


def _hash_schemas(types: tuple[type[Message], ...]) -> str:
    schemas = {item.__name__: _prune(_build_hashed_schema(item), _PROSE) for item in types}
    text = json.dumps(schemas, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


# Without fields that only the recording reads: contracts that differ in them alone are compatible, and runs that do not
# use them keep their digests, which the briefing's hash is part of.
def _build_hashed_schema(item: type[Message]) -> dict[str, Any]:
    schema = get_pydantic_model(item).model_json_schema()
    fields = schema.get("properties", {})
    dropped = [name for name, field in fields.items() if field.items() >= RECORDED_ONLY.items()]
    if not dropped:
        return schema
    kept = {**schema, "properties": {name: field for name, field in fields.items() if name not in dropped}}
    definitions = kept.pop("$defs")
    needed: dict[str, Any] = {}
    while missing := {
        name for name in definitions if name not in needed and f'"#/$defs/{name}"' in json.dumps([kept, needed])
    }:
        needed |= {name: definitions[name] for name in missing}
    return {**kept, "$defs": needed}


# pydantic's format for bytes is not standard, and its versions differ in how they write limits (1 or 1.0). In
# `properties` and `$defs` a key is a name, which may well be `title`; elsewhere it is a keyword of JSON Schema.
def _prune(schema: Any, dropped: tuple[str, ...]) -> Any:
    if isinstance(schema, list):
        return [_prune(item, dropped) for item in cast(list[Any], schema)]
    if not isinstance(schema, dict):
        return schema
    words = cast(dict[str, Any], schema)
    if words.get("type") == "string" and words.get("format") in ("binary", "base64url"):
        return _BYTES
    changed: dict[str, Any] = {}
    for word, value in words.items():
        if word in ("properties", "$defs"):
            changed[word] = {name: _prune(item, dropped) for name, item in value.items()}
        elif word in _LIMITS and float(value).is_integer():
            changed[word] = int(value)
        elif word not in dropped:
            changed[word] = _prune(value, dropped)
    return changed


class ContractVersionError(ContractError):
    """An agent was made for another major version of the contract; its author has to build it again for this one."""


def format_own_contract() -> str:
    """Return the contract of this code as an agent may state it: version and hash."""
    return f"{CONTRACT_VERSION}+{get_contract_hash()}"


def check_contract(stated: str) -> None:
    """Check the contract that the other side states.

    Another minor version is compatible in both directions: later fields are ignored or have defaults.

    Args:
        stated: `MAJOR.MINOR`, or `MAJOR.MINOR+HASH`.

    Raises:
        ContractVersionError: the major version is another one; no message of the other side can be trusted.
        ContractError: not of that form, or the same version with another hash; the messages may still fit.
    """
    found = check_version(stated, CONTRACT_VERSION)
    minor = CONTRACT_VERSION.split(".")[1]
    is_same = int(found["minor"]) == int(minor)
    if is_same and found["hash"] is not None and found["hash"] != get_contract_hash():
        raise ContractError(
            f"contract: expected hash {get_contract_hash()} for version {CONTRACT_VERSION}, was {found['hash']}. "
            "The agent was made with another build of the contract; `gslcosim schema export` writes this one's."
        )


def check_version(stated: str, own: str) -> re.Match[str]:
    """Check the version that the other side states; return its parts: `major`, `minor`, `hash`.

    Args:
        stated: `MAJOR.MINOR`, or `MAJOR.MINOR+HASH`.
        own: The version of this side.

    Raises:
        ContractVersionError: the major version is another one.
        ContractError: not of that form.
    """
    found = _CONTRACT_PATTERN.fullmatch(stated)
    if found is None:
        raise ContractError(f"contract: expected MAJOR.MINOR or MAJOR.MINOR+HASH, was {stated[:60]!r}.")
    major = own.split(".")[0]
    if int(found["major"]) != int(major):
        raise ContractVersionError(
            f"contract: expected major version {major} (this run speaks {own}), was "
            f"{found['major']}.{found['minor']}. Build the agent with the contract of this gslcosim: "
            "`gslcosim schema export` writes it."
        )
    return found
