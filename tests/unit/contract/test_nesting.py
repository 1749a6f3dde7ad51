"""However deep an agent nests, the fault says what was expected."""

import msgpack
import pytest

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.runtime.agents.validator import CommandValidator
from gslcosim_conformance.answers import read_answer

DEPTHS = (10, 300, 900, 1000, 1020, 1100, 200_000)


def nested(depth):
    """Return a command whose position is a list in a list in a list."""
    start = msgpack.packb({"tick": 5, "kind": "waypoint", "position_world_m": 0})[:-1]
    return start + b"\x91" * depth + b"\x00"


@pytest.mark.parametrize("depth", DEPTHS)
def test_a_nested_value_is_refused_with_a_reason(depth):
    with pytest.raises(ContractError, match="Command: "):
        codec.decode(Command, nested(depth))
    assert CommandValidator("agent").on_answer(nested(depth)) == []
    assert read_answer(nested(depth)).problem is not None
