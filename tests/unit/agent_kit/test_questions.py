"""Which observations an agent is sent: all of them, or only those that ask, for an agent that looks at no others."""

import queue
import threading

import pytest
from deadlines import EVENT_S
from in_memory_bus import InMemoryHub

from gslcosim.agent_kit import Agent, Command
from gslcosim.agent_kit.agent import answer_observations
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Ending
from gslcosim_conformance.scripted_world import AGENT, ScriptedWorld, build_briefing


class Asked(Agent):
    def __init__(self, briefing):
        self.seen = []
        Asked.last = self

    def decide(self, observation):
        self.seen.append(observation.tick)
        return Command(tick=observation.tick, kind="hold")


class Watchful(Asked):
    def observe(self, observation):
        self.seen.append(observation.tick)


@pytest.mark.parametrize(
    ("agent_type", "seen"),
    [(Asked, [0, 3]), (Watchful, [0, 0, 1, 2, 3, 3])],
    ids=["asked", "watchful"],
)
def test_an_agent_without_observe_reads_questions_only(agent_type, seen):
    hub = InMemoryHub()
    ours, answers, is_there = hub.open(), queue.SimpleQueue(), threading.Event()
    ours.subscribe(keys.raw_command(AGENT), lambda _, payload: answers.put(codec.decode(Command, payload)))
    ours.watch_alive("agents/*/alive", lambda _, is_alive: is_alive and is_there.set())
    thread = threading.Thread(target=answer_observations, args=(agent_type, hub.open(), [AGENT]), daemon=True)
    thread.start()
    assert is_there.wait(EVENT_S)
    world = ScriptedWorld(7)
    ours.publish(keys.briefing(AGENT), codec.encode(build_briefing(7)))
    for tick in range(4):
        payload = codec.encode(world.observe(tick, is_asked=tick % 3 == 0))
        ours.publish(keys.observation(AGENT), payload)
        if tick % 3 == 0:
            ours.publish(keys.question(AGENT), payload)
    assert [answers.get(timeout=EVENT_S).tick for _ in range(2)] == [0, 3]
    ours.publish(keys.ending(AGENT), codec.encode(Ending(tick=3, reason="done")))
    thread.join(10)
    assert not thread.is_alive()
    assert Asked.last.seen == seen
    assert answers.empty()


def test_an_agent_among_several_is_shown_its_question_once_the_others_have_come_as_far():
    hub = InMemoryHub()
    ours, answers, are_there = hub.open(), queue.SimpleQueue(), threading.Semaphore(0)
    names = (AGENT, "other")
    for name in names:
        ours.subscribe(keys.raw_command(name), lambda key, payload: answers.put((key, codec.decode(Command, payload))))
    ours.watch_alive("agents/*/alive", lambda _, is_alive: are_there.release())
    thread = threading.Thread(target=answer_observations, args=(Asked, hub.open(), names), daemon=True)
    thread.start()
    assert all(are_there.acquire(timeout=EVENT_S) for _ in names)
    world = ScriptedWorld(7)
    for name in names:
        briefing = build_briefing(7).model_copy(update={"agent": name})
        ours.publish(keys.briefing(name), codec.encode(briefing))
    for asked in names:
        observation = world.observe(names.index(asked), is_asked=True)
        for name in names:
            changes = {"agent": name, "awaiting_command": name == asked}
            payload = codec.encode(observation.model_copy(update=changes))
            ours.publish(keys.observation(name), payload)
            if name == asked:
                ours.publish(keys.question(name), payload)
        key, command = answers.get(timeout=EVENT_S)
        assert (key, command.tick) == (keys.raw_command(asked), observation.tick)
    ours.publish(keys.ending(AGENT), codec.encode(Ending(tick=1, reason="done")))
    thread.join(10)
    assert not thread.is_alive()
