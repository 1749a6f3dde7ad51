"""Files of the published contract, AsyncAPI 3 documents among them: `make contract` writes them to agents/contract."""

import json
import sys
from pathlib import Path
from typing import Any, cast

import yaml
from contract_hash import hash_schemas
from contract_vectors import build_vectors

from gslcosim.contract import codec
from gslcosim.contract.codec import MAX_NESTING
from gslcosim_conformance.key_table import AGENT_PLACEHOLDER, KEY_TABLE, KeyEntry
from gslcosim.contract.messages import Ending, Message
from gslcosim.contract.participant_messages import (
    PARTICIPATION_VERSION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantOutputs,
)
from gslcosim_conformance.message_schemas import (
    build_json_schema,
    list_message_types,
    list_participation_types,
    list_published_types,
)
from gslcosim.contract.version import CONTRACT_HASH, CONTRACT_VERSION

_AGENT_DESCRIPTION = (
    "The messages between gslcosim and its agents. "
    "An operation is what an agent does: it receives its briefing, observations and the ending, and sends commands. "
    "Channels without an operation are between services; agents can neither read nor write them."
)
_ZENOH_DESCRIPTION = (
    "Door one. A client session of Zenoh 1.x joins the router of the run. Everything it needs is in the environment "
    "variable GSLCOSIM_JOIN, a JSON object with name, endpoint, namespace, user and password, or the path of a file "
    "that holds it. docs/zenoh-door.md tells the life of such a session."
)
_GATEWAY_DESCRIPTION = "Door two, without Zenoh: {where}. docs/gateway.md tells it byte by byte."
_GATEWAY_LOCATIONS = {
    "stdio": "{whose}'s standard input and output",
    "tcp": "a TCP connection to the address in GSLCOSIM_GATEWAY",
    "unix": "a connection to the unix socket in GSLCOSIM_GATEWAY",
}
_FRAMING = {
    "msgpack": "4 bytes: length, unsigned, big-endian; then that many bytes: one msgpack map",
    "json": "one JSON object in UTF-8 on one line, ended by a line feed",
    "maxFrameBytes": 1024 * 1024,
}
_MESSAGE_KEY_DESCRIPTION = "each frame from the gateway, Briefing, Observation or Ending; optional in a Command"
_FIRST_FRAME = "{token: <the value of GSLCOSIM_TOKEN>}"


def build_agent_document() -> dict[str, Any]:
    """Return the AsyncAPI document as a tree of plain values; message payloads refer to the schema files beside it."""
    used = {channel.message for channel in KEY_TABLE}
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "gslcosim",
            "version": CONTRACT_VERSION,
            "description": _AGENT_DESCRIPTION,
            "license": {"name": "Apache-2.0"},
            "x-contract-hash": CONTRACT_HASH,
        },
        "defaultContentType": "application/msgpack",
        "servers": _build_servers(),
        "channels": {_get_channel_id(channel): _build_channel(channel) for channel in KEY_TABLE},
        "operations": {
            _get_operation_id(channel): _build_operation(channel) for channel in KEY_TABLE if channel.direction
        },
        "components": {
            "messages": {
                item.__name__: describe_message(item) for item in list_message_types() if item.__name__ in used
            },
            "parameters": {"agent": {"description": "An agent's name, as in the scenario: a-z, 0-9 and _."}},
            "securitySchemes": {
                "account": {"type": "userPassword", "description": "`user` and `password` of GSLCOSIM_JOIN."}
            },
        },
    }


def build_agent_yaml() -> str:
    """Return the AsyncAPI document as YAML."""
    return yaml.safe_dump(build_agent_document(), sort_keys=False, allow_unicode=True, width=110)


def _build_servers() -> dict[str, Any]:
    servers: dict[str, Any] = {
        "zenoh": {
            "host": "{endpoint}",
            "protocol": "zenoh",
            "protocolVersion": "1",
            "description": _ZENOH_DESCRIPTION,
            "variables": {
                "endpoint": {
                    "description": "A Zenoh endpoint; on the same host a unix socket, on others TCP or TLS.",
                    "examples": ["unixsock-stream//tmp/gslcosim-x/router.sock", "tcp/192.0.2.7:7447"],
                }
            },
            "security": [{"$ref": "#/components/securitySchemes/account"}],
            "x-zenoh": {
                "mode": "client",
                "scouting": False,
                "namespace": "gsl/{run}",
                "liveliness": f"agents/{AGENT_PLACEHOLDER}/alive, declared last",
            },
        }
    }
    return {**servers, **build_gateway_servers()}


def build_gateway_servers(whose: str = "the agent", key: str = _MESSAGE_KEY_DESCRIPTION) -> dict[str, Any]:
    """Return the three ways through the gateway as servers.

    Args:
        whose: Who speaks there.
        key: In which frames the key `message` is.
    """
    servers: dict[str, Any] = {}
    for place, text in _GATEWAY_LOCATIONS.items():
        where = text.format(whose=whose)
        framing = {**_FRAMING, "messageKey": f"message: the message's name in {key}"}
        if place != "stdio":
            framing |= {"firstFrame": _FIRST_FRAME}
        servers[f"gateway_{place}"] = {
            "host": "{address}",
            "protocol": place,
            "description": _GATEWAY_DESCRIPTION.format(where=where),
            "variables": {"address": {"description": where[:1].upper() + where[1:]}},
            "x-framing": framing,
        }
    return servers


def _build_channel(channel: KeyEntry) -> dict[str, Any]:
    name = channel.message
    fields: dict[str, Any] = {
        "address": channel.key.replace(AGENT_PLACEHOLDER, "{agent}"),
        "description": f"Written by {channel.writer} {channel.when}; read by {channel.readers}.",
        "messages": {name: {"$ref": f"#/components/messages/{name}"}},
        "x-zenoh": {
            "priority": "data",
            "congestionControl": "block",
            "reliability": "reliable",
            "express": {"always": True, "never": False, "asked": "where awaiting_command is true"}[channel.express],
            "travels": channel.travels,
        },
    }
    if channel.direction is None:
        fields["servers"] = [{"$ref": "#/servers/zenoh"}]
    else:
        fields["x-direction"] = channel.direction
    if AGENT_PLACEHOLDER in channel.key:
        fields["parameters"] = {"agent": {"$ref": "#/components/parameters/agent"}}
    return fields


def _build_operation(channel: KeyEntry) -> dict[str, Any]:
    channel_id = _get_channel_id(channel)
    sends = channel.direction == "from agent"
    operation: dict[str, Any] = {
        "action": "send" if sends else "receive",
        "channel": {"$ref": f"#/channels/{channel_id}"},
        "summary": f"{'Send' if sends else 'Receive'} {channel.message} {channel.when}.",
        "messages": [{"$ref": f"#/channels/{channel_id}/messages/{channel.message}"}],
    }
    if channel.message == "Observation":
        answer = next(other for other in KEY_TABLE if other.direction == "from agent")
        operation["reply"] = {
            "channel": {"$ref": f"#/channels/{_get_channel_id(answer)}"},
            "messages": [{"$ref": f"#/channels/{_get_channel_id(answer)}/messages/{answer.message}"}],
        }
    return operation


def describe_message(message_type: Any) -> dict[str, Any]:
    """Return what the document says of a message."""
    name = cast(str, message_type.__name__)
    return {
        "name": name,
        "title": name,
        "contentType": "application/msgpack",
        "description": (message_type.__doc__ or "").strip().splitlines()[0],
        "x-encoding": codec.get_encoding(message_type),
        "payload": {
            "schemaFormat": "application/schema+json;version=draft-2020-12",
            "schema": {"$ref": f"schemas/{name}.json"},
        },
    }


def _get_channel_id(channel: KeyEntry) -> str:
    return channel.key.replace(f"{AGENT_PLACEHOLDER}", "agent").replace("/", "_")


def _get_operation_id(channel: KeyEntry) -> str:
    return ("send" if channel.direction == "from agent" else "receive") + channel.message


_PARTICIPANT_DESCRIPTION = (
    "What a run and a model of one's own say to each other through the gateway. The model's program says hello, is "
    "told its briefing, answers the inputs of each step with its outputs, and exits after the ending. The inputs hold "
    f"messages of the contract {CONTRACT_VERSION}, whose schemas are beside this file."
)
_PARTICIPANT_CHANNEL = "stream"
_PARTICIPANT_STREAM = "The one stream between them: the frames of both sides in turn."
_PARTICIPANT_MESSAGES = (ParticipantHello, ParticipantBriefing, ParticipantInputs, ParticipantOutputs, Ending)
_PARTICIPANT_OPERATIONS: tuple[tuple[str, str, type[Message], str, type[Message] | None], ...] = (
    ("sayHello", "send", ParticipantHello, "Send ParticipantHello once, as the first frame.", ParticipantBriefing),
    ("receiveBriefing", "receive", ParticipantBriefing, "Receive ParticipantBriefing once.", None),
    ("step", "receive", ParticipantInputs, "Receive ParticipantInputs at each step and answer.", ParticipantOutputs),
    ("sendOutputs", "send", ParticipantOutputs, "Send ParticipantOutputs once for each inputs.", None),
    ("end", "receive", Ending, "Receive Ending once, and exit.", None),
)


def build_participant_document() -> dict[str, Any]:
    """Return the AsyncAPI document as a tree of plain values; message payloads refer to the schema files beside it."""
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "gslcosim participants",
            "version": PARTICIPATION_VERSION,
            "description": _PARTICIPANT_DESCRIPTION,
            "license": {"name": "Apache-2.0"},
            "x-contract-hash": hash_schemas(list_published_types()),
        },
        "defaultContentType": "application/msgpack",
        "servers": build_gateway_servers(whose="the program", key="each frame from the run; optional in the program's"),
        "channels": {
            _PARTICIPANT_CHANNEL: {
                "address": None,
                "description": _PARTICIPANT_STREAM,
                "messages": {
                    each.__name__: {"$ref": f"#/components/messages/{each.__name__}"} for each in _PARTICIPANT_MESSAGES
                },
            }
        },
        "operations": {
            name: _build_participant_operation(action, message, summary, answer)
            for name, action, message, summary, answer in _PARTICIPANT_OPERATIONS
        },
        "components": {"messages": {each.__name__: describe_message(each) for each in _PARTICIPANT_MESSAGES}},
    }


def build_participant_yaml() -> str:
    """Return the AsyncAPI document as YAML."""
    return yaml.safe_dump(build_participant_document(), sort_keys=False, allow_unicode=True, width=110)


def _build_participant_operation(
    action: str, message: type[Message], summary: str, answer: type[Message] | None
) -> dict[str, Any]:
    channel = {"$ref": f"#/channels/{_PARTICIPANT_CHANNEL}"}
    operation: dict[str, Any] = {
        "action": action,
        "channel": channel,
        "summary": summary,
        "messages": [{"$ref": f"#/channels/{_PARTICIPANT_CHANNEL}/messages/{message.__name__}"}],
    }
    if answer is not None:
        operation["reply"] = {
            "channel": channel,
            "messages": [{"$ref": f"#/channels/{_PARTICIPANT_CHANNEL}/messages/{answer.__name__}"}],
        }
    return operation


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
                "hash": CONTRACT_HASH,
                "messages": [item.__name__ for item in list_message_types()],
                "participation": {
                    "version": PARTICIPATION_VERSION,
                    "hash": hash_schemas(list_published_types()),
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


def _json(content: Any) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name, text in build_contract_files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
