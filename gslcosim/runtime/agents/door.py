"""The door between an agent and a run: a pure state machine that turns whatever an agent sends into valid commands."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from gslcosim.contract import codec
from gslcosim.contract.commands import AGENT_KINDS
from gslcosim.contract.compatibility import OtherContractError, check_contract
from gslcosim.contract.messages import Belief, Command, Observation
from gslcosim.errors import ContractError
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.ticks import NS_PER_S

MAX_COMMAND_BYTES = 1024 * 1024
# At most one belief in so much simulated time is taken.
BELIEF_EVERY_S = 1
MAX_EARLY = 16
EARLY_TICKS = 64
MAX_FAULTS = 50
# How a process ended differs from run to run; the fault tells it, the run's digest must not depend on it.
GONE = "the agent is gone"
FAILED_BY_AGENT = f"Command: kind: expected one of {', '.join(AGENT_KINDS)}, was 'failed'."


Said = dict[str, object] | ContractError
"""What an agent has sent: a map that is not judged yet, or why it is none."""


def unpacked(payload: bytes) -> Said:
    """Return what is in an agent's bytes, which may be at most `MAX_COMMAND_BYTES`."""
    try:
        return codec.unpack_foreign("Command", payload)
    except ContractError as error:
        return error


def door_of(agent: AgentSpec, scenario: Scenario) -> "Door":
    """Return the door of an agent of a scenario."""
    return Door(
        agent.name,
        may_overlap=agent.latency_ticks > 1,
        belief_every_ticks=max(1, round(BELIEF_EVERY_S * NS_PER_S / scenario.tick_ns)),
    )


DOOR_PREFIX = "agent_"


def door_name(agent: str) -> str:
    """Return the name of the participant that stands for an agent."""
    return f"{DOOR_PREFIX}{agent}"


@dataclass(frozen=True, kw_only=True)
class AgentFault:
    """Something an agent did wrong: what was expected and what came. It is a result of the run, not an error in it."""

    agent: str
    tick: int
    text: str


@dataclass
class Door:
    """Checks one agent's answers and lets one command through for each observation that awaits it.

    An answer that is not valid lets a `hold` through instead and leaves a fault that says what was expected. An agent
    that is gone lets `failed` through at the first tick it owes an answer; nothing follows it. Answers nobody asked
    for are counted and dropped without being read.

    Observations and answers may arrive in either order: a few early answers are kept until their observation comes.
    `may_overlap` says that a later observation can await an answer while an earlier one still does (latency mode).
    Of the beliefs only one in `belief_every_ticks` passes; a command that brings one sooner passes without it.
    """

    agent: str
    may_overlap: bool = False
    belief_every_ticks: int = 1
    faults: list[AgentFault] = field(default_factory=list[AgentFault])
    n_faults: int = 0
    latest_tick: int = -1
    is_closed: bool = False
    _pending: dict[int, None] = field(default_factory=dict[int, None])
    _early: list[tuple[int, bytes]] = field(default_factory=list[tuple[int, bytes]])
    _gone: str | None = None
    _refused_early: tuple[int, str] | None = None
    _told_contract: str | None = None
    _belief_tick: int | None = None

    @property
    def pending(self) -> tuple[int, ...]:
        """The ticks of the observations that await an answer, oldest first."""
        return tuple(self._pending)

    def observed(self, observation: Observation | codec.ObservationHead) -> list[Command]:
        """Take note of an observation on its way to the agent; return the commands that can pass now."""
        if not self._is_new(observation.tick):
            return []
        if observation.awaiting_command:
            self._pending[observation.tick] = None
        if self._gone is not None:
            return self._fail()
        if observation.awaiting_command and (refused := self._take_refused_early(observation.tick)):
            return refused
        early, self._early = self._early, []
        return [command for tick, payload in early for command in self._judge_early(tick, payload)]

    def received(self, payload: bytes) -> list[Command]:
        """Take what the agent sent; return the commands that can pass now."""
        if self.is_closed or self._gone is not None:
            return []
        if len(payload) > MAX_COMMAND_BYTES:
            return self._refuse(f"expected at most {MAX_COMMAND_BYTES} bytes, was {len(payload)}.")
        said = unpacked(payload)
        tick = _tick_in(said)
        if tick is not None and tick > self.latest_tick:
            return self._keep_early(tick, payload)
        return self._judge(tick, said)

    def refused(self, text: str) -> list[Command]:
        """Take note that what the agent sent could not even be read; return the commands that can pass now."""
        return [] if self.is_closed or self._gone is not None else self._refuse(text)

    def lost(self, reason: str) -> list[Command]:
        """Take note that the agent is gone; return `failed` when it owes an answer."""
        if self.is_closed or self._gone is not None:
            return []
        self._gone = reason
        self._note(reason)
        return self._fail()

    def _is_new(self, tick: int) -> bool:
        if tick <= self.latest_tick or self.is_closed:
            return False
        self.latest_tick = tick
        return True

    def _judge_early(self, tick: int, payload: bytes) -> list[Command]:
        return self._keep_early(tick, payload) if tick > self.latest_tick else self._judge(tick, unpacked(payload))

    def _judge(self, tick: int | None, said: Said) -> list[Command]:
        if not self._pending:
            if tick is None:
                return self._refuse(_unreadable_text(said))
            if not self._is_repeat(tick):
                self._note("expected no command now (no observation awaits one), one came.")
            return []
        try:
            command = self._read(said)
        except OtherContractError as error:
            return self.lost(str(error))
        except ContractError as error:
            return self._refuse(str(error))
        if command.tick not in self._pending:
            if self._is_repeat(command.tick):
                return []
            return self._refuse(f"Command: tick: expected {self._oldest()}, was {command.tick}.")
        if command.kind == "failed":
            return self._refuse(FAILED_BY_AGENT)
        del self._pending[command.tick]
        # Who answers the same must leave the same trail, whether it says what it speaks or not.
        return [command.model_copy(update={"contract": None, "belief": self._timely_belief(command)})]

    # Its contract before the rest: what is wrong with the rest may well be that it is of another contract.
    def _read(self, said: Said) -> Command:
        if isinstance(said, ContractError):
            raise said
        told = said.get("contract")
        if isinstance(told, str):
            self._check_contract(told)
        return codec.from_fields(Command, said)

    # By ticks and not by a clock, so that the same commands always leave the same trail.
    def _timely_belief(self, command: Command) -> Belief | None:
        if command.belief is None:
            return None
        if self._belief_tick is not None and command.tick - self._belief_tick < self.belief_every_ticks:
            self._note(
                f"Command: belief: expected at most one in {self.belief_every_ticks} ticks (a second of simulated "
                f"time), was the next after {command.tick - self._belief_tick}. The command counts without it."
            )
            return None
        self._belief_tick = command.tick
        return command.belief

    # An answer that cannot be read may have overtaken its observation too; the question must not wait for another.
    def _take_refused_early(self, tick: int) -> list[Command]:
        refused, self._refused_early = self._refused_early, None
        if refused is None or tick - refused[0] > EARLY_TICKS or tick not in self._pending:
            return []
        del self._pending[tick]
        return [Command(tick=tick, kind="hold", reason=f"refused: {refused[1]}"[:500])]

    def _check_contract(self, told: str) -> None:
        if told == self._told_contract:
            return
        self._told_contract = told
        try:
            check_contract(told)
        except OtherContractError:
            raise
        except ContractError as error:
            self._note(str(error))

    # An answer for a tick that was already answered is a repetition, harmless and expected after a lost message.
    def _is_repeat(self, tick: int) -> bool:
        return tick < self._oldest() if self._pending else tick <= self.latest_tick

    # An early answer waits for its observation. Where no later observation can exist before the pending one is
    # answered, the agent has the tick wrong, and waiting would be for ever.
    def _keep_early(self, tick: int, payload: bytes) -> list[Command]:
        if self._pending and not self.may_overlap:
            return self._refuse(f"Command: tick: expected {self._oldest()}, was {tick}.")
        if len(self._early) < MAX_EARLY:
            self._early.append((tick, payload))
        else:
            self._note(f"Command: tick: expected at most {self.latest_tick}, was {tick}.")
        return []

    def _refuse(self, text: str) -> list[Command]:
        self._note(text)
        if not self._pending:
            self._refused_early = (self.latest_tick, text)
            return []
        tick = self._oldest()
        del self._pending[tick]
        return [Command(tick=tick, kind="hold", reason=f"refused: {text}"[:500])]

    def _fail(self) -> list[Command]:
        if not self._pending:
            return []
        tick = self._oldest()
        self._close()
        return [Command(tick=tick, kind="failed", reason=GONE)]

    def _close(self) -> None:
        self._pending.clear()
        self.is_closed = True

    def _oldest(self) -> int:
        return next(iter(self._pending))

    def _note(self, text: str) -> None:
        self.n_faults += 1
        if len(self.faults) < MAX_FAULTS:
            self.faults.append(AgentFault(agent=self.agent, tick=max(self.latest_tick, 0), text=text))


# Only the tick, so that an answer can be put in its place before it is judged.
def _tick_in(said: Said) -> int | None:
    tick = None if isinstance(said, ContractError) else said.get("tick")
    return tick if type(tick) is int else None


def _unreadable_text(said: Said) -> str:
    if isinstance(said, ContractError):
        return str(said)
    try:
        codec.from_fields(Command, said)
    except ContractError as error:
        return str(error)
    return "expected no command now (no observation awaits one), one came."


def faults_of(doors: Iterable[Door]) -> list[AgentFault]:
    """Return all recorded faults, by tick."""
    return sorted((fault for door in doors for fault in door.faults), key=lambda fault: fault.tick)
