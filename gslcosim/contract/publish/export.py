"""Files of the published contract, made from the messages; `gslcosim schema export` writes them."""

import json
from pathlib import Path
from typing import Any

from gslcosim.contract.codec import MAX_NESTING
from gslcosim.contract.messages import CONTRACT_VERSION
from gslcosim.contract.participant_messages import PARTICIPATION_VERSION
from gslcosim.contract.publish.asyncapi import build_agent_yaml, build_participant_yaml
from gslcosim.contract.publish.vectors import build_vectors
from gslcosim.contract.schema import (
    build_json_schema,
    get_contract_hash,
    get_participation_hash,
    list_message_types,
    list_participation_types,
    list_published_types,
)

_GENERATED_NOTE = "# Made by `make contract` from gslcosim/contract; do not edit.\n"
_README = f"""# The contract, version {CONTRACT_VERSION}

<!-- Made by `make contract` from gslcosim/contract; do not edit. -->

The messages between gslcosim and its agents, for every language.

| file | what |
|---|---|
| `contract.json` | version and hash of this contract, and its messages |
| `asyncapi.yaml` | keys, directions and both doors, as AsyncAPI 3 |
| `participation.yaml` | what a model of one's own says and hears, as AsyncAPI 3 |
| `schemas/<Message>.json` | a message as JSON Schema 2020-12 |
| `vectors/<Message>.json` | bytes that every reader accepts, and those it must reject, with the reason |

In a vectors file `msgpack` is hexadecimal and `json` is text; both say what `fields` says.
Where `canonical` is true they are exactly what gslcosim writes; the others are what a reader has to accept as well.
`schema_refuses` tells whether the JSON Schema already finds what is wrong.
In `fields` and in JSON, bytes are base64 text.

In what an agent writes each key is there once, and lists and maps are at most {MAX_NESTING} deep.

An agent meets four messages: `Briefing`, `Observation`, `Command` and `Ending`; the others are between services.

A model of one's own meets `ParticipantHello`, `ParticipantBriefing`, `ParticipantInputs`, `ParticipantOutputs` and
`Ending`, and within the inputs what it declares to read. These are a contract beside that of agents, version
{PARTICIPATION_VERSION}; its hash in `contract.json` is one over all schemas.
"""


def build_contract_files() -> dict[str, str]:
    """Return the text of each file of the published contract by its path, relative to the folder."""
    files = {
        "README.md": _README,
        "contract.json": _json(
            {
                "version": CONTRACT_VERSION,
                "hash": get_contract_hash(),
                "messages": [item.__name__ for item in list_message_types()],
                "participation": {
                    "version": PARTICIPATION_VERSION,
                    "hash": get_participation_hash(),
                    "messages": [item.__name__ for item in list_participation_types()],
                },
            }
        ),
        "asyncapi.yaml": f"{_GENERATED_NOTE}{build_agent_yaml()}",
        "participation.yaml": f"{_GENERATED_NOTE}{build_participant_yaml()}",
    }
    for item in list_published_types():
        files[f"schemas/{item.__name__}.json"] = _json(build_json_schema(item))
        files[f"vectors/{item.__name__}.json"] = _json(build_vectors(item))
    return files


def write_contract(folder: Path) -> list[Path]:
    """Write all files of the contract below a folder, which is made where it is missing; return them."""
    written: list[Path] = []
    for name, text in build_contract_files().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return written


def _json(content: Any) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"
