"""What a model of a user's own and a run say to each other as one AsyncAPI 3 document, as the model sees it."""

from typing import Any

import yaml

from gslcosim.contract.messages import CONTRACT_VERSION, Ending, Message
from gslcosim.contract.participation import (
    PARTICIPATION_VERSION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantOutputs,
)
from gslcosim.contract.publish.asyncapi import gateway_servers, message_of
from gslcosim.contract.schema import participation_hash

_ABOUT = (
    "What a run and a model of one's own say to each other through the gateway. The model's program says hello, is "
    "told its briefing, answers the inputs of each step with its outputs, and exits after the ending. The inputs hold "
    f"messages of the contract {CONTRACT_VERSION}, whose schemas are beside this file."
)
_CHANNEL = "stream"
_STREAM = "The one stream between them: the frames of both sides in turn."
_MESSAGES = (ParticipantHello, ParticipantBriefing, ParticipantInputs, ParticipantOutputs, Ending)
_OPERATIONS: tuple[tuple[str, str, type[Message], str, type[Message] | None], ...] = (
    ("sayHello", "send", ParticipantHello, "Send ParticipantHello once, as the first frame.", ParticipantBriefing),
    ("receiveBriefing", "receive", ParticipantBriefing, "Receive ParticipantBriefing once.", None),
    ("step", "receive", ParticipantInputs, "Receive ParticipantInputs at each step and answer.", ParticipantOutputs),
    ("sendOutputs", "send", ParticipantOutputs, "Send ParticipantOutputs once for each inputs.", None),
    ("end", "receive", Ending, "Receive Ending once, and exit.", None),
)


def participation_document() -> dict[str, Any]:
    """Return the AsyncAPI document as a tree of plain values; message payloads refer to the schema files beside it."""
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "gslcosim participants",
            "version": PARTICIPATION_VERSION,
            "description": _ABOUT,
            "license": {"name": "Apache-2.0"},
            "x-contract-hash": participation_hash(),
        },
        "defaultContentType": "application/msgpack",
        "servers": gateway_servers(whose="the program", key="each frame from the run; optional in the program's"),
        "channels": {
            _CHANNEL: {
                "address": None,
                "description": _STREAM,
                "messages": {each.__name__: {"$ref": f"#/components/messages/{each.__name__}"} for each in _MESSAGES},
            }
        },
        "operations": {
            name: _operation(action, message, summary, answer) for name, action, message, summary, answer in _OPERATIONS
        },
        "components": {"messages": {each.__name__: message_of(each) for each in _MESSAGES}},
    }


def participation_yaml() -> str:
    """Return the AsyncAPI document as YAML."""
    return yaml.safe_dump(participation_document(), sort_keys=False, allow_unicode=True, width=110)


def _operation(action: str, message: type[Message], summary: str, answer: type[Message] | None) -> dict[str, Any]:
    channel = {"$ref": f"#/channels/{_CHANNEL}"}
    operation: dict[str, Any] = {
        "action": action,
        "channel": channel,
        "summary": summary,
        "messages": [{"$ref": f"#/channels/{_CHANNEL}/messages/{message.__name__}"}],
    }
    if answer is not None:
        operation["reply"] = {
            "channel": channel,
            "messages": [{"$ref": f"#/channels/{_CHANNEL}/messages/{answer.__name__}"}],
        }
    return operation
