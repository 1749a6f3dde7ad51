"""The contract as one AsyncAPI 3 document, as an agent sees it: what it receives, what it sends, and both doors."""

from typing import Any, cast

import yaml

from gslcosim.contract import codec
from gslcosim.contract.channels import AGENT, CHANNELS, Channel
from gslcosim.contract.messages import CONTRACT_VERSION
from gslcosim.contract.schema import contract_hash, message_types

_ABOUT = (
    "The messages between gslcosim and its agents. "
    "An operation is what an agent does: it receives its briefing, observations and the ending, and sends commands. "
    "Channels without an operation are between services; agents can neither read nor write them."
)
_ZENOH = (
    "Door one. A client session of Zenoh 1.x joins the router of the run. Everything it needs is in the environment "
    "variable GSLCOSIM_JOIN, a JSON object with name, endpoint, namespace, user and password, or the path of a file "
    "that holds it. docs/zenoh-door.md tells the life of such a session."
)
_GATEWAY = "Door two, without Zenoh: {where}. docs/gateway.md tells it byte by byte."
_PLACES = {
    "stdio": "{whose}'s standard input and output",
    "tcp": "a TCP connection to the address in GSLCOSIM_GATEWAY",
    "unix": "a connection to the unix socket in GSLCOSIM_GATEWAY",
}
_FRAMING = {
    "msgpack": "4 bytes: length, unsigned, big-endian; then that many bytes: one msgpack map",
    "json": "one JSON object in UTF-8 on one line, ended by a line feed",
    "maxFrameBytes": 1024 * 1024,
}
_KEY_OF_AGENTS = "each frame from the gateway, Briefing, Observation or Ending; optional in a Command"
_FIRST_FRAME = "{token: <the value of GSLCOSIM_TOKEN>}"


def asyncapi_document() -> dict[str, Any]:
    """Return the AsyncAPI document as a tree of plain values; message payloads refer to the schema files beside it."""
    used = {channel.message for channel in CHANNELS}
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "gslcosim",
            "version": CONTRACT_VERSION,
            "description": _ABOUT,
            "license": {"name": "Apache-2.0"},
            "x-contract-hash": contract_hash(),
        },
        "defaultContentType": "application/msgpack",
        "servers": _servers(),
        "channels": {_channel_id(channel): _channel(channel) for channel in CHANNELS},
        "operations": {_operation_id(channel): _operation(channel) for channel in CHANNELS if channel.direction},
        "components": {
            "messages": {item.__name__: message_of(item) for item in message_types() if item.__name__ in used},
            "parameters": {"agent": {"description": "An agent's name, as in the scenario: a-z, 0-9 and _."}},
            "securitySchemes": {
                "account": {"type": "userPassword", "description": "`user` and `password` of GSLCOSIM_JOIN."}
            },
        },
    }


def asyncapi_yaml() -> str:
    """Return the AsyncAPI document as YAML."""
    return yaml.safe_dump(asyncapi_document(), sort_keys=False, allow_unicode=True, width=110)


def _servers() -> dict[str, Any]:
    servers: dict[str, Any] = {
        "zenoh": {
            "host": "{endpoint}",
            "protocol": "zenoh",
            "protocolVersion": "1",
            "description": _ZENOH,
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
                "liveliness": f"agents/{AGENT}/alive, declared last",
            },
        }
    }
    return {**servers, **gateway_servers()}


def gateway_servers(whose: str = "the agent", key: str = _KEY_OF_AGENTS) -> dict[str, Any]:
    """Return the three ways through the gateway as servers.

    Args:
        whose: Who speaks there.
        key: In which frames the key `message` is.
    """
    servers: dict[str, Any] = {}
    for place, text in _PLACES.items():
        where = text.format(whose=whose)
        framing = {**_FRAMING, "messageKey": f"message: the message's name in {key}"}
        if place != "stdio":
            framing |= {"firstFrame": _FIRST_FRAME}
        servers[f"gateway_{place}"] = {
            "host": "{address}",
            "protocol": place,
            "description": _GATEWAY.format(where=where),
            "variables": {"address": {"description": where[:1].upper() + where[1:]}},
            "x-framing": framing,
        }
    return servers


def _channel(channel: Channel) -> dict[str, Any]:
    name = channel.message
    fields: dict[str, Any] = {
        "address": channel.key.replace(AGENT, "{agent}"),
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
    if AGENT in channel.key:
        fields["parameters"] = {"agent": {"$ref": "#/components/parameters/agent"}}
    return fields


def _operation(channel: Channel) -> dict[str, Any]:
    channel_id = _channel_id(channel)
    sends = channel.direction == "from agent"
    operation: dict[str, Any] = {
        "action": "send" if sends else "receive",
        "channel": {"$ref": f"#/channels/{channel_id}"},
        "summary": f"{'Send' if sends else 'Receive'} {channel.message} {channel.when}.",
        "messages": [{"$ref": f"#/channels/{channel_id}/messages/{channel.message}"}],
    }
    if channel.message == "Observation":
        answer = next(other for other in CHANNELS if other.direction == "from agent")
        operation["reply"] = {
            "channel": {"$ref": f"#/channels/{_channel_id(answer)}"},
            "messages": [{"$ref": f"#/channels/{_channel_id(answer)}/messages/{answer.message}"}],
        }
    return operation


def message_of(message_type: Any) -> dict[str, Any]:
    """Return what the document says of a message."""
    name = cast(str, message_type.__name__)
    return {
        "name": name,
        "title": name,
        "contentType": "application/msgpack",
        "description": (message_type.__doc__ or "").strip().splitlines()[0],
        "x-encoding": codec.encoding_of(message_type),
        "payload": {
            "schemaFormat": "application/schema+json;version=draft-2020-12",
            "schema": {"$ref": f"schemas/{name}.json"},
        },
    }


def _channel_id(channel: Channel) -> str:
    return channel.key.replace(f"{AGENT}", "agent").replace("/", "_")


def _operation_id(channel: Channel) -> str:
    return ("send" if channel.direction == "from agent" else "receive") + channel.message
