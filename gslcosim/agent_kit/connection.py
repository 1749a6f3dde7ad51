"""The life of a process that flies Python agents: join, get the briefings, answer, leave."""

import queue
import sys
from collections.abc import Callable, Sequence

from gslcosim.agent_kit import framed
from gslcosim.agent_kit.agent import Agent
from gslcosim.agent_kit.crew import Crew
from gslcosim.bus.port import Bus, Join
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending, Observation
from gslcosim.errors import GslCosimError

_Event = tuple[str, bytes]
_LOST = "lost"


def run(agent_type: Callable[[Briefing], Agent]) -> None:
    """Fly in the run named by the environment variable `GSLCOSIM_JOIN`, and return when the run is over.

    A process behind the gateway (`door: stdio`) flies the agents of `GSLCOSIM_AGENT` by frames instead.

    One agent is made for each that the process is to fly: mostly one, or all that name it with `process_of`.
    Exits with a message when the run cannot be joined, and with code 1 when one of several agents has failed.
    """
    if framed.is_behind_gateway():
        framed.run_framed(agent_type)
        return
    from gslcosim.bus.zenoh_bus import ZenohBus

    try:
        join = Join.from_environment()
        with ZenohBus.open_member(join) as bus:
            events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
            bus.on_disconnect(lambda: events.put((_LOST, b"")))
            failed = fly(agent_type, bus, join.agents or (join.name,), events)
    except GslCosimError as error:
        sys.exit(str(error))
    if failed:
        sys.exit(f"Failed before the end of the run: {', '.join(failed)}.")


def fly(
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
    crew = Crew(
        agent_type,
        names,
        send=lambda name, answer: _send(bus, name, answer),
        leave=lambda name: bus.withdraw_alive(_alive(name)),
    )
    actions: dict[str, Callable[[bytes], None]] = {}
    endings = {keys.ending(name) for name in names}
    # An agent that does not override `observe` has no use for observations that ask nothing.
    is_asked_only = getattr(agent_type, "observe", None) is Agent.observe
    key_of_observation = keys.question if is_asked_only else keys.observation
    for name in names:
        actions[keys.briefing(name)] = lambda got, name=name: crew.brief(name, codec.decode_trusted(Briefing, got))
        actions[key_of_observation(name)] = lambda got, name=name: crew.observe(
            name, codec.decode_trusted(Observation, got)
        )
    for key in (*actions, *endings):
        bus.subscribe(key, lambda at, payload: inbox.put((at, payload)))
    for name in names:
        bus.declare_alive(_alive(name))
    while len(crew.failed) < len(names):
        key, payload = inbox.get()
        if key == _LOST or key in endings:
            crew.end(codec.decode_trusted(Ending, payload).reason if payload else "the link to the run was lost")
            break
        actions[key](payload)
    return crew.failed


def _alive(name: str) -> str:
    return f"agents/{name}/alive"


def _send(bus: Bus, name: str, answer: bytes) -> None:
    bus.publish(keys.raw_command(name), answer, encoding=codec.encoding_of(Command), urgent=True)
