"""The door of an agent in free mode: time does not wait for it, and what it says takes effect when it comes."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from gslcosim.contract import codec
from gslcosim.contract.compatibility import OtherContractError
from gslcosim.contract.messages import Command, Observation
from gslcosim.errors import ContractError
from gslcosim.runtime.agents.door import FAILED_BY_AGENT, GONE, MAX_COMMAND_BYTES, Door, unpacked
from gslcosim.runtime.agents.past import past_command

_MAX_TEXTS = 16


@dataclass
class FreeDoor(Door):
    """Lets one command through at each observation, at once: the last one that has come, or `noop`.

    The agent may be asked, or speak unasked; what it says twice, byte for byte, is a repetition. What passes when
    depends on the clock: it gets the tick at which it passes, and is an input of the run.

    A later command takes the place of one that has not passed yet, but a `noop` replaces nothing, a declaration of the
    source is always made, and texts and a belief of what is replaced go with what replaces it. A command that is not
    valid becomes a `hold`, and leaves a fault. An agent that is gone lets `failed` through.

    Before `until_tick` the commands of `past` pass, whatever comes.
    """

    past: Mapping[int, Command] = field(default_factory=dict[int, Command])
    until_tick: int = 0
    _waiting: list[Command] = field(default_factory=list[Command])
    _last_payload: bytes = b""

    def observed(self, observation: Observation | codec.ObservationHead) -> list[Command]:
        """Take note of an observation on its way to the agent; return the command that passes now."""
        tick = observation.tick
        if not self._is_new(tick):
            return []
        if tick < self.until_tick:
            self._waiting.clear()
            command = past_command(self.past, self.agent, tick)
        elif self._gone is not None:
            command = Command(tick=tick, kind="failed", reason=GONE)
        else:
            command = self._next(tick)
        if command.kind == "failed":
            self._close()
        return [command]

    def received(self, payload: bytes) -> list[Command]:
        """Take what the agent sent; it passes with the next observation."""
        if self.is_closed or self._gone is not None or payload == self._last_payload:
            return []
        self._last_payload = payload
        if len(payload) > MAX_COMMAND_BYTES:
            return self.refused(f"expected at most {MAX_COMMAND_BYTES} bytes, was {len(payload)}.")
        try:
            command = self._read(unpacked(payload))
        except OtherContractError as error:
            return self.lost(str(error))
        except ContractError as error:
            return self.refused(str(error))
        if command.kind == "failed":
            return self.refused(FAILED_BY_AGENT)
        self._keep(command.model_copy(update={"contract": None}))
        return []

    def refused(self, text: str) -> list[Command]:
        """Take note that what the agent sent could not even be read; it holds from the next observation on."""
        if not (self.is_closed or self._gone is not None):
            self._note(text)
            self._keep(Command(tick=0, kind="hold", reason=f"refused: {text}"[:500]))
        return []

    def _keep(self, command: Command) -> None:
        if not self._waiting:
            self._waiting.append(command)
            return
        last = self._waiting[-1]
        if command.kind == "noop" or last.kind != "declare_source" or command.kind == "declare_source":
            stays = last if command.kind == "noop" else command
            self._waiting[-1] = stays.model_copy(
                update={
                    "outgoing": (*last.outgoing, *command.outgoing)[-_MAX_TEXTS:],
                    "belief": command.belief or last.belief,
                }
            )
        else:
            self._waiting.append(command)

    def _next(self, tick: int) -> Command:
        if not self._waiting:
            return Command(tick=tick, kind="noop")
        command = self._waiting.pop(0).model_copy(update={"tick": tick})
        return command.model_copy(update={"belief": self._timely_belief(command)})
