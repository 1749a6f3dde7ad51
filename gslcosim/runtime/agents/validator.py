"""Validation of agents' commands: a pure state machine, one valid command for each observation that awaits one."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gslcosim.base.errors import ContractError, RunFolderError
from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract import codec
from gslcosim.contract.messages import AGENT_KINDS, REFUSED_PREFIX, Belief, Command, Observation
from gslcosim.contract.version import ContractVersionError, check_contract
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec

MAX_COMMAND_BYTES = 1024 * 1024
# At most one belief in so much simulated time is taken.
BELIEF_PERIOD_S = 1
MAX_EARLY_ANSWERS = 16
MAX_EARLY_TICKS = 64
MAX_FAULTS = 50
# The way a process ends differs from run to run; it is part of the fault, but the run's digest must not depend on it.
AGENT_LOST_REASON = "the agent is gone"
FAILED_KIND_FAULT = f"Command: kind: expected one of {', '.join(AGENT_KINDS)}, was 'failed'."
UnpackedAnswer = dict[str, object] | ContractError
"""Bytes of an agent, decoded: a map that is not judged yet, or the reason why there is none."""
_MAX_RADIO_TEXTS = 16


@dataclass(frozen=True, kw_only=True)
class RecordedCommands:
    """Commands that count at ticks before `until_tick`, by agent and tick, whatever the agents answer there."""

    commands: Mapping[str, Mapping[int, Command]]
    until_tick: int


def get_recorded_command(commands: Mapping[int, Command], agent: str, tick: int) -> Command:
    """Return an agent's command of the past at a tick."""
    if tick not in commands:
        raise RunFolderError(
            f"inputs.log: expected a command of {agent} for tick {tick}, at which it was asked again, found none. "
            "The run does not repeat: it was flown by other code, or its files were changed."
        )
    return commands[tick]


def unpack_answer(payload: bytes) -> UnpackedAnswer:
    """Return the decoded content of an agent's bytes, at most `MAX_COMMAND_BYTES` of them."""
    try:
        return codec.unpack_untrusted("Command", payload)
    except ContractError as error:
        return error


@dataclass(frozen=True, kw_only=True)
class AgentFault:
    """Something an agent did wrong: what was expected and what came. It is a result of the run, not an error in it."""

    agent: str
    tick: int
    text: str


@dataclass
class CommandValidator:
    """Validator of one agent's answers, which passes one command for each observation that awaits it.

    In place of an invalid answer a `hold` passes, and a fault is recorded with the expected answer. For a lost agent
    `failed` passes at the first tick at which it owes an answer, and nothing after it. Unsolicited answers are counted
    and discarded unread.

    Observations and answers may arrive in either order: a few early answers are kept until their observation comes.
    With `may_overlap`, a later observation can await an answer while an earlier one still does (latency mode).
    Only one belief per `belief_every_ticks` passes; a command with an earlier belief passes without it.
    """

    agent: str
    may_overlap: bool = False
    belief_every_ticks: int = 1
    faults: list[AgentFault] = field(default_factory=list[AgentFault])
    n_faults: int = 0
    latest_tick: int = -1
    is_closed: bool = False
    _pending: dict[int, None] = field(default_factory=dict[int, None])
    _early: list[bytes] = field(default_factory=list[bytes])
    _gone: str | None = None
    _refused_early: tuple[int, str] | None = None
    _checked_contract: str | None = None
    _belief_tick: int | None = None

    @property
    def pending(self) -> tuple[int, ...]:
        """The ticks of the observations that await an answer, oldest first."""
        return tuple(self._pending)

    def on_observation(self, observation: Observation | codec.ObservationHead) -> list[Command]:
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
        return [command for payload in early for command in self._place(payload)]

    def on_answer(self, payload: bytes) -> list[Command]:
        """Take what the agent sent; return the commands that can pass now."""
        if self.is_closed or self._gone is not None:
            return []
        if len(payload) > MAX_COMMAND_BYTES:
            return self._refuse(f"expected at most {MAX_COMMAND_BYTES} bytes, was {len(payload)}.")
        return self._place(payload)

    def on_refusal(self, text: str) -> list[Command]:
        """Take note that what the agent sent could not even be read; return the commands that can pass now."""
        return [] if self.is_closed or self._gone is not None else self._refuse(text)

    def on_lost(self, reason: str) -> list[Command]:
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

    # Ordered by the tick alone, so that an answer is in its place before it is checked.
    def _place(self, payload: bytes) -> list[Command]:
        said = unpack_answer(payload)
        tick = None if isinstance(said, ContractError) else said.get("tick")
        if type(tick) is not int:
            return self._judge(None, said)
        return self._keep_early(tick, payload) if tick > self.latest_tick else self._judge(tick, said)

    def _judge(self, tick: int | None, said: UnpackedAnswer) -> list[Command]:
        if not self._pending:
            if tick is None:
                return self._refuse(_describe_unreadable(said))
            if not self._is_repeat(tick):
                self._note("expected no command now (no observation awaits one), one came.")
            return []
        try:
            command = self._read(said)
        except ContractVersionError as error:
            return self.on_lost(str(error))
        except ContractError as error:
            return self._refuse(str(error))
        if command.tick not in self._pending:
            if self._is_repeat(command.tick):
                return []
            return self._refuse(f"Command: tick: expected {self._oldest()}, was {command.tick}.")
        if command.kind == "failed":
            return self._refuse(FAILED_KIND_FAULT)
        del self._pending[command.tick]
        # Equal answers must leave the same trail, whether or not they state their contract.
        return [command.model_copy(update={"contract": None, "belief": self._timely_belief(command)})]

    # The contract is checked first, because another contract may well be the cause of all other errors.
    def _read(self, said: UnpackedAnswer) -> Command:
        if isinstance(said, ContractError):
            raise said
        contract = said.get("contract")
        if isinstance(contract, str):
            self._check_contract(contract)
        return codec.build_message(Command, said)

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
        if refused is None or tick - refused[0] > MAX_EARLY_TICKS or tick not in self._pending:
            return []
        del self._pending[tick]
        return [Command(tick=tick, kind="hold", reason=f"{REFUSED_PREFIX}{refused[1]}"[:500])]

    def _check_contract(self, contract: str) -> None:
        if contract == self._checked_contract:
            return
        self._checked_contract = contract
        try:
            check_contract(contract)
        except ContractVersionError:
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
        if len(self._early) < MAX_EARLY_ANSWERS:
            self._early.append(payload)
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
        return [Command(tick=tick, kind="hold", reason=f"{REFUSED_PREFIX}{text}"[:500])]

    def _fail(self) -> list[Command]:
        if not self._pending:
            return []
        tick = self._oldest()
        self._close()
        return [Command(tick=tick, kind="failed", reason=AGENT_LOST_REASON)]

    def _close(self) -> None:
        self._pending.clear()
        self.is_closed = True

    def _oldest(self) -> int:
        return next(iter(self._pending))

    def _note(self, text: str) -> None:
        self.n_faults += 1
        if len(self.faults) < MAX_FAULTS:
            self.faults.append(AgentFault(agent=self.agent, tick=max(self.latest_tick, 0), text=text))


def _describe_unreadable(said: UnpackedAnswer) -> str:
    if isinstance(said, ContractError):
        return str(said)
    try:
        codec.build_message(Command, said)
    except ContractError as error:
        return str(error)
    return "expected no command now (no observation awaits one), one came."


@dataclass
class FreeRunningValidator(CommandValidator):
    """Validator in free mode, which passes one command at each observation at once: the last to come, or `noop`.

    The agent may send commands with or without a request; a command equal to the last one, byte for byte, is a
    repetition. The tick at which a command passes depends on the clock: the command gets that tick, and is an input of
    the run.

    A later command replaces one that has not passed yet, but a `noop` replaces nothing, a declaration of the source is
    always kept, and texts, a belief and a note of the replaced command move to its replacement. An invalid command
    becomes a `hold`, and a fault is recorded. For a lost agent `failed` passes.

    Before `until_tick` the commands of `past` pass, whatever arrives.
    """

    past: Mapping[int, Command] = field(default_factory=dict[int, Command])
    until_tick: int = 0
    _waiting: list[Command] = field(default_factory=list[Command])
    _last_payload: bytes = b""

    def on_observation(self, observation: Observation | codec.ObservationHead) -> list[Command]:
        """Take note of an observation on its way to the agent; return the command that passes now."""
        tick = observation.tick
        if not self._is_new(tick):
            return []
        if tick < self.until_tick:
            self._waiting.clear()
            command = get_recorded_command(self.past, self.agent, tick)
        elif self._gone is not None:
            command = Command(tick=tick, kind="failed", reason=AGENT_LOST_REASON)
        else:
            command = self._next(tick)
        if command.kind == "failed":
            self._close()
        return [command]

    def on_answer(self, payload: bytes) -> list[Command]:
        """Take what the agent sent; it passes with the next observation."""
        if self.is_closed or self._gone is not None or payload == self._last_payload:
            return []
        self._last_payload = payload
        if len(payload) > MAX_COMMAND_BYTES:
            return self.on_refusal(f"expected at most {MAX_COMMAND_BYTES} bytes, was {len(payload)}.")
        try:
            command = self._read(unpack_answer(payload))
        except ContractVersionError as error:
            return self.on_lost(str(error))
        except ContractError as error:
            return self.on_refusal(str(error))
        if command.kind == "failed":
            return self.on_refusal(FAILED_KIND_FAULT)
        self._keep(command.model_copy(update={"contract": None}))
        return []

    def on_refusal(self, text: str) -> list[Command]:
        """Take note that what the agent sent could not even be read; it holds from the next observation on."""
        if not (self.is_closed or self._gone is not None):
            self._note(text)
            self._keep(Command(tick=0, kind="hold", reason=f"{REFUSED_PREFIX}{text}"[:500]))
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
                    "outgoing": (*last.outgoing, *command.outgoing)[-_MAX_RADIO_TEXTS:],
                    "belief": command.belief or last.belief,
                    "note": command.note or last.note,
                }
            )
        else:
            self._waiting.append(command)

    def _next(self, tick: int) -> Command:
        if not self._waiting:
            return Command(tick=tick, kind="noop")
        command = self._waiting.pop(0).model_copy(update={"tick": tick})
        return command.model_copy(update={"belief": self._timely_belief(command)})


@dataclass
class ReplayValidator(CommandValidator):
    """Validator of a fork, which passes a recorded command for each answer of the agent before `until_tick`.

    The agent is asked at each tick at which the past one was, and time waits for it as usual, so that it has seen
    everything when its own answers begin to count. An agent that is gone before fails at the first tick from
    `until_tick` on at which it owes an answer. Where the past agent failed before, nothing follows, as then.
    """

    past: Mapping[int, Command] = field(default_factory=dict[int, Command])
    until_tick: int = 0

    def on_observation(self, observation: Observation | codec.ObservationHead) -> list[Command]:
        """Take note of an observation on its way to the agent; return the commands that can pass now."""
        return self._as_it_was(super().on_observation(observation))

    def on_answer(self, payload: bytes) -> list[Command]:
        """Take what the agent sent; return the commands that can pass now."""
        return self._as_it_was(super().on_answer(payload))

    def on_refusal(self, text: str) -> list[Command]:
        """Take note that what the agent sent could not even be read; return the commands that can pass now."""
        return self._as_it_was(super().on_refusal(text))

    def on_lost(self, reason: str) -> list[Command]:
        """Take note that the agent is gone; return `failed` when it owes an answer that counts."""
        return self._as_it_was(super().on_lost(reason))

    # Answers owed from before the fork are known, so a lack of them does not end the agent's part in the run.
    def _fail(self) -> list[Command]:
        known = [tick for tick in self._pending if tick < self.until_tick]
        for tick in known:
            del self._pending[tick]
        return [*(Command(tick=tick, kind="hold", reason=AGENT_LOST_REASON) for tick in known), *super()._fail()]

    def _as_it_was(self, commands: Iterable[Command]) -> list[Command]:
        passed: list[Command] = []
        for command in commands:
            is_past = command.tick < self.until_tick
            passed.append(get_recorded_command(self.past, self.agent, command.tick) if is_past else command)
            if passed[-1].kind == "failed":
                self._close()
                break
        return passed


def build_validator(agent: AgentSpec, scenario: Scenario, past: RecordedCommands | None) -> CommandValidator:
    """Return the validator of an agent of a scenario, with recorded commands where the run is a fork."""
    may_overlap = agent.latency_ticks > 1
    belief_every_ticks = max(1, round(BELIEF_PERIOD_S * NS_PER_S / scenario.tick_ns))
    if past is None and not agent.is_free:
        return CommandValidator(agent.name, may_overlap, belief_every_ticks)
    known = dict(past.commands.get(agent.name, {})) if past is not None else {}
    kind = FreeRunningValidator if agent.is_free else ReplayValidator
    until_tick = past.until_tick if past is not None else 0
    return kind(agent.name, may_overlap, belief_every_ticks, past=known, until_tick=until_tick)
