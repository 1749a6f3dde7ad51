"""The door of an agent of a fork: what it answers before the fork is heard and not done."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Observation
from gslcosim.runtime.agents.door import GONE, Door, door_of
from gslcosim.runtime.agents.free_door import FreeDoor
from gslcosim.runtime.agents.past import Past, past_command
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec


@dataclass
class PastDoor(Door):
    """Lets the commands of the past through at ticks before `until_tick`, one for each answer of the agent.

    The agent is asked at each tick at which the past one was, and time waits for it as usual, so that it has seen
    everything when its own answers begin to count. An agent that is gone before fails at the first tick from
    `until_tick` on at which it owes an answer. Where the past agent failed before, nothing follows, as then.
    """

    past: Mapping[int, Command] = field(default_factory=dict[int, Command])
    until_tick: int = 0

    def observed(self, observation: Observation | codec.ObservationHead) -> list[Command]:
        """Take note of an observation on its way to the agent; return the commands that can pass now."""
        return self._as_it_was(super().observed(observation))

    def received(self, payload: bytes) -> list[Command]:
        """Take what the agent sent; return the commands that can pass now."""
        return self._as_it_was(super().received(payload))

    def refused(self, text: str) -> list[Command]:
        """Take note that what the agent sent could not even be read; return the commands that can pass now."""
        return self._as_it_was(super().refused(text))

    def lost(self, reason: str) -> list[Command]:
        """Take note that the agent is gone; return `failed` when it owes an answer that counts."""
        return self._as_it_was(super().lost(reason))

    # What it owes from before the fork is known, and does not end its part in the run.
    def _fail(self) -> list[Command]:
        known = [tick for tick in self._pending if tick < self.until_tick]
        for tick in known:
            del self._pending[tick]
        return [*(Command(tick=tick, kind="hold", reason=GONE) for tick in known), *super()._fail()]

    def _as_it_was(self, commands: Iterable[Command]) -> list[Command]:
        passed: list[Command] = []
        for command in commands:
            passed.append(self._past_command(command.tick) if command.tick < self.until_tick else command)
            if passed[-1].kind == "failed":
                self._close()
                break
        return passed

    def _past_command(self, tick: int) -> Command:
        return past_command(self.past, self.agent, tick)


def door_in(agent: AgentSpec, scenario: Scenario, past: Past | None) -> Door:
    """Return the door of an agent of a scenario, with the past of the run where it is a fork."""
    door = door_of(agent, scenario)
    known, until_tick = dict[int, Command](), 0
    if past is not None:
        known, until_tick = dict(past.commands.get(agent.name, known)), past.until_tick
    if agent.is_free:
        return FreeDoor(door.agent, belief_every_ticks=door.belief_every_ticks, past=known, until_tick=until_tick)
    if past is None:
        return door
    return PastDoor(
        door.agent,
        may_overlap=door.may_overlap,
        belief_every_ticks=door.belief_every_ticks,
        past=known,
        until_tick=until_tick,
    )
