"""Hash of the messages of the contract: `make contract` writes that of the agents' messages to `contract/version.py`."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from gslcosim.contract import version
from gslcosim.contract.messages import RECORDED_ONLY, Message
from gslcosim.contract.record import get_pydantic_model
from gslcosim_conformance.message_schemas import list_message_types, prune_schema

_PROSE = ("title", "description")


def hash_schemas(types: tuple[type[Message], ...]) -> str:
    """Return the hash of the canonical JSON Schemas of messages, without their prose."""
    schemas = {item.__name__: prune_schema(build_hashed_schema(item), _PROSE) for item in types}
    text = json.dumps(schemas, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


# Without fields that only the recording reads: contracts that differ in them alone are compatible, and runs that do not
# use them keep their digests, which the briefing's hash is part of.
def build_hashed_schema(item: type[Message]) -> dict[str, Any]:
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


if __name__ == "__main__":
    path = Path(version.__file__)
    line = f'CONTRACT_HASH = "{hash_schemas(list_message_types())}"'
    path.write_text(re.sub(r"^CONTRACT_HASH = .*$", line, path.read_text(), flags=re.MULTILINE), encoding="utf-8")
