"""Python agents behind the gateway: frames on standard input and output in place of the bus."""

import os
import sys
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.agent_kit.agent import Agent
from gslcosim.agent_kit.crew import Crew
from gslcosim.bus.port import JOIN_VARIABLE
from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Ending, Observation

# The names of the agents that a process behind the gateway flies, separated by commas.
AGENT_VARIABLE = "GSLCOSIM_AGENT"
_LENGTH_BYTES = 4
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack


def is_behind_gateway() -> bool:
    """Return whether this process was started to speak frames on its standard input and output."""
    return AGENT_VARIABLE in os.environ and JOIN_VARIABLE not in os.environ


def run_framed(agent_type: Callable[[Briefing], Agent]) -> None:
    """Fly the agents that `GSLCOSIM_AGENT` names, until the run ends or the stream does.

    What the agents print goes to the log: frames have standard output for themselves.
    """
    with os.fdopen(os.dup(1), "wb", buffering=0) as output, os.fdopen(os.dup(0), "rb") as source:
        os.dup2(2, 1)
        sys.stdout.flush()
        fly_framed(agent_type, os.environ[AGENT_VARIABLE].split(","), source, output)


def fly_framed(
    agent_type: Callable[[Briefing], Agent], names: Sequence[str], source: BinaryIO, output: BinaryIO
) -> None:
    """Answer observations that come in frames until the run ends or the frames do.

    Args:
        agent_type: Makes an agent of its briefing.
        names: The agents, in the order of the scenario.
        source: Where frames come from.
        output: Where answers go, unbuffered.

    Raises:
        Exception: what an agent raised; a stream has no other sign that one of several has gone.
    """
    failures: list[str] = []
    crew = Crew(
        agent_type,
        names,
        send=lambda name, answer: _write(output, _named(name, answer) if len(names) > 1 else answer),
        leave=failures.append,
    )
    while not failures and (fields := _read(source)) is not None:
        kind = fields.pop("message", None)
        if kind == "Ending":
            crew.end(codec.from_fields(Ending, fields).reason)
            return
        if kind == "Briefing":
            briefing = codec.from_fields(Briefing, fields)
            crew.brief(briefing.agent, briefing)
        elif kind == "Observation":
            observation = codec.from_fields(Observation, fields)
            crew.observe(observation.agent, observation)
    if failures:
        sys.exit(f"Failed before the end of the run: {', '.join(failures)}.")
    crew.end("the link to the run was lost")


def _read(source: BinaryIO) -> dict[str, Any] | None:
    head = source.read(_LENGTH_BYTES)
    if len(head) < _LENGTH_BYTES:
        return None
    body = source.read(int.from_bytes(head, "big"))
    return _msgpack.unpackb(body, use_list=False)


def _write(output: BinaryIO, payload: bytes) -> None:
    left = len(payload).to_bytes(_LENGTH_BYTES, "big") + payload
    while left:
        left = left[output.write(left) or 0 :]


def _named(name: str, answer: bytes) -> bytes:
    return _msgpack.packb({**_msgpack.unpackb(answer, use_list=False), "agent": name})
