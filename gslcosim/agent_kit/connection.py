"""The life of a Python agent as a process of its own: join, get the briefing, answer, leave."""

import queue
import sys
from collections.abc import Callable
from typing import Any

from gslcosim.agent_kit.agent import Agent
from gslcosim.bus.port import Bus, Join
from gslcosim.contract import codec, keys
from gslcosim.contract.compatibility import check_contract, spoken_contract
from gslcosim.contract.messages import Briefing, Command, Ending, Observation
from gslcosim.errors import GslCosimError

_Event = tuple[str, bytes]
_LOST = "lost"


def run(agent_type: Callable[[Briefing], Agent]) -> None:
    """Fly an agent in the run named by the environment variable `GSLCOSIM_JOIN`, and return when the run is over.

    Exits with a message when the run cannot be joined.
    """
    from gslcosim.bus.zenoh_bus import ZenohBus

    try:
        join = Join.from_environment()
        with ZenohBus.open_member(join) as bus:
            events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
            bus.on_disconnect(lambda: events.put((_LOST, b"")))
            fly(agent_type, bus, join.name, events)
    except GslCosimError as error:
        sys.exit(str(error))


def fly(
    agent_type: Callable[[Briefing], Agent], bus: Bus, name: str, events: "queue.SimpleQueue[_Event] | None" = None
) -> None:
    """Connect an agent to a bus and answer its observations until the run ends or the link is lost.

    Observations may arrive twice: the answer is then repeated, not decided anew.
    """
    inbox: queue.SimpleQueue[_Event] = events or queue.SimpleQueue()
    for key in (keys.briefing(name), keys.observation(name), keys.ending(name)):
        bus.subscribe(key, lambda at, payload: inbox.put((at, payload)))
    bus.declare_alive(f"agents/{name}/alive")
    agent: Agent | None = None
    seen: dict[str, Any] = {"tick": -1, "answer": None, "has_answered": False}
    while True:
        key, payload = inbox.get()
        if key == keys.observation(name) and agent is not None:
            _answer(agent, codec.decode(Observation, payload), bus, name, seen)
        elif key == keys.briefing(name) and agent is None:
            briefing = codec.decode(Briefing, payload)
            check_contract(briefing.contract_version)
            agent = agent_type(briefing)
        elif key in (keys.ending(name), _LOST):
            if agent is not None:
                agent.end(codec.decode(Ending, payload).reason if payload else "the link to the run was lost")
            return


def _answer(agent: Agent, observation: Observation, bus: Bus, name: str, seen: dict[str, Any]) -> None:
    if observation.tick > seen["tick"]:
        seen["tick"], seen["answer"] = observation.tick, None
        agent.observe(observation)
        if observation.awaiting_command:
            answered = agent.decide(observation)
            if not seen["has_answered"]:
                answered = answered.model_copy(update={"contract": spoken_contract()})
            seen["answer"], seen["has_answered"] = codec.encode(answered), True
    answer: bytes | None = seen["answer"] if observation.tick == seen["tick"] else None
    if answer is not None:
        bus.publish(keys.raw_command(name), answer, encoding=codec.encoding_of(Command), urgent=True)
