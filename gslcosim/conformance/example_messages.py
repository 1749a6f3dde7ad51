"""Example messages of a check: the first golden vector of each message in the published contract."""

import json
from functools import cache

from gslcosim.base.bundled import bundled_contract
from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.contract.schema import list_published_types


@cache
def load_example(name: str) -> Message:
    """Return an example of the message type of a name, such as `BodyPoses`."""
    message_type = next(item for item in list_published_types() if item.__name__ == name)
    vectors = json.loads((bundled_contract() / "vectors" / f"{name}.json").read_text(encoding="utf-8"))
    return codec.decode(message_type, bytes.fromhex(vectors["accept"][0]["msgpack"]))
