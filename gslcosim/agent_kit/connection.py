"""Process of Python agents: joins a run over the bus or the gateway, gets the briefings, answers observations."""

import os
import queue
import sys
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.agent_kit.agent import Agent, AgentGroup
from gslcosim.base.errors import GslCosimError
from gslcosim.bus.interface import JOIN_VARIABLE, Bus, JoinData
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending, Observation

# The names of the agents that a process behind the gateway flies, separated by commas.
AGENT_VARIABLE = "GSLCOSIM_AGENT"
_LENGTH_BYTES = 4
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack


def is_behind_gateway() -> bool:
    """Return whether this process was started to speak frames on its standard input and output."""
    return AGENT_VARIABLE in os.environ and JOIN_VARIABLE not in os.environ


def run_over_gateway(agent_type: Callable[[Briefing], Agent]) -> None:
    """Fly the agents that `GSLCOSIM_AGENT` names, until the run ends or the stream does.

    What the agents print goes to the log: frames have standard output for themselves.
    """
    with os.fdopen(os.dup(1), "wb", buffering=0) as output, os.fdopen(os.dup(0), "rb") as source:
        os.dup2(2, 1)
        sys.stdout.flush()
        answer_frames(agent_type, os.environ[AGENT_VARIABLE].split(","), source, output)


def answer_frames(
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
    group = AgentGroup(
        agent_type,
        names,
        send=lambda name, answer: _write_frame(output, _add_agent_name(name, answer) if len(names) > 1 else answer),
        leave=failures.append,
    )
    while not failures and (fields := _read_frame(source)) is not None:
        kind = fields.pop("message", None)
        if kind == "Ending":
            group.end(codec.build_message(Ending, fields).reason)
            return
        if kind == "Briefing":
            briefing = codec.build_message(Briefing, fields)
            group.brief(briefing.agent, briefing)
        elif kind == "Observation":
            observation = codec.build_message(Observation, fields)
            group.observe(observation.agent, observation)
    if failures:
        sys.exit(f"Failed before the end of the run: {', '.join(failures)}.")
    group.end("the link to the run was lost")


def _read_frame(source: BinaryIO) -> dict[str, Any] | None:
    head = source.read(_LENGTH_BYTES)
    if len(head) < _LENGTH_BYTES:
        return None
    body = source.read(int.from_bytes(head, "big"))
    return _msgpack.unpackb(body, use_list=False)


def _write_frame(output: BinaryIO, payload: bytes) -> None:
    left = len(payload).to_bytes(_LENGTH_BYTES, "big") + payload
    while left:
        left = left[output.write(left) or 0 :]


def _add_agent_name(name: str, answer: bytes) -> bytes:
    return _msgpack.packb({**_msgpack.unpackb(answer, use_list=False), "agent": name})


_Event = tuple[str, bytes]
_LINK_LOST = "lost"


def run(agent_type: Callable[[Briefing], Agent]) -> None:
    """Run the agents in the run named by the environment variable `GSLCOSIM_JOIN`, and return when the run is over.

    A process behind the gateway (`door: stdio`) flies the agents of `GSLCOSIM_AGENT` by frames instead.

    One agent is made for each that the process is to fly: mostly one, or all that name it with `process_of`.
    Exits with a message when the run cannot be joined, and with code 1 when one of several agents has failed.
    """
    if is_behind_gateway():
        run_over_gateway(agent_type)
        return
    from gslcosim.bus.zenoh_bus import ZenohBus

    try:
        join = JoinData.from_environment()
        with ZenohBus.open_member(join) as bus:
            events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
            bus.on_disconnect(lambda: events.put((_LINK_LOST, b"")))
            failed = answer_observations(agent_type, bus, join.agents or (join.name,), events)
    except GslCosimError as error:
        sys.exit(str(error))
    if failed:
        sys.exit(f"Failed before the end of the run: {', '.join(failed)}.")


def answer_observations(
    agent_type: Callable[[Briefing], Agent],
    bus: Bus,
    names: Sequence[str],
    events: "queue.SimpleQueue[_Event] | None" = None,
) -> tuple[str, ...]:
    """Connect agents to a bus and answer their observations until the run ends, the link is lost, or all have failed.

    Args:
        agent_type: Makes an agent of its briefing.
        bus: The process's connection.
        names: The agents that it flies, in the order of the scenario.
        events: Where `("lost", b"")` is put when the link is lost.

    Returns:
        The names of those that have failed, if there are several; a single one's failure is raised.
    """
    inbox: queue.SimpleQueue[_Event] = events or queue.SimpleQueue()
    group = AgentGroup(
        agent_type,
        names,
        send=lambda name, answer: _send(bus, name, answer),
        leave=lambda name: bus.withdraw_alive(_build_liveliness_key(name)),
    )
    actions: dict[str, Callable[[bytes], None]] = {}
    endings = {keys.ending(name) for name in names}
    # An agent that does not override `observe` has no use for observations that ask nothing.
    is_asked_only = getattr(agent_type, "observe", None) is Agent.observe
    key_of_observation = keys.question if is_asked_only else keys.observation
    for name in names:
        actions[keys.briefing(name)] = lambda got, name=name: group.brief(name, codec.decode_trusted(Briefing, got))
        actions[key_of_observation(name)] = lambda got, name=name: group.observe(
            name, codec.decode_trusted(Observation, got)
        )
    for key in (*actions, *endings):
        bus.subscribe(key, lambda at, payload: inbox.put((at, payload)))
    for name in names:
        bus.declare_alive(_build_liveliness_key(name))
    while len(group.failed) < len(names):
        key, payload = inbox.get()
        if key == _LINK_LOST or key in endings:
            group.end(codec.decode_trusted(Ending, payload).reason if payload else "the link to the run was lost")
            break
        actions[key](payload)
    return group.failed


def _build_liveliness_key(name: str) -> str:
    return f"agents/{name}/alive"


def _send(bus: Bus, name: str, answer: bytes) -> None:
    bus.publish(keys.raw_command(name), answer, encoding=codec.get_encoding(Command), urgent=True)
