"""The contract's identity: a hash over the JSON Schemas of all messages."""

import hashlib
import json
from functools import cache

from gslcosim.contract import messages
from gslcosim.contract.messages import Message


def message_types() -> tuple[type[Message], ...]:
    """Return all message types of the contract, by name."""
    found = [item for item in vars(messages).values() if isinstance(item, type) and issubclass(item, Message)]
    return tuple(sorted((item for item in found if item is not Message), key=lambda item: item.__name__))


@cache
def contract_hash() -> str:
    """Return the hash of the canonical JSON Schemas; two processes that speak the same contract have the same."""
    schemas = {item.__name__: item.model_json_schema() for item in message_types()}
    return hashlib.blake2b(json.dumps(schemas, sort_keys=True).encode(), digest_size=16).hexdigest()
