"""Run in one process and one thread: the same cores, gates and agent sessions, without a bus."""

import queue
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from typing_extensions import override

from gslcosim.base.errors import GslCosimError, RunFolderError, format_fault
from gslcosim.base.processes import Interruption
from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Message, Observation, Verdict
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.agents.loader import load_agent_types
from gslcosim.runtime.agents.session import (
    AgentSessions,
    AgentTransport,
    ObjectTransport,
    ThreadedTransport,
    WorkerThread,
    build_session,
)
from gslcosim.runtime.digest import RunDigest
from gslcosim.runtime.loop_host import POLL_PERIOD_S, LoopHost
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault
from gslcosim.runtime.participant_status import ParticipantStatus, explain_stall
from gslcosim.runtime.services import build_all_cores
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunStatus
from gslcosim.runtime.stepper import SentMessage, SnapshotPolicy, StepListener, StepLoop, Stepper, build_clock_pace

REPORT_EVERY_TICKS = 64
# Receives every message with its port, in the order in which they are delivered.
MessageObserver = Callable[[str, Message], None]
_Kind = TypeVar("_Kind")


class InProcessRun(LoopHost, StepListener):
    """Run of a scenario in this thread; the order of steps is that of the dataflow, tick by tick.

    Agents behind the gateway are processes; simulated time goes on until it needs their answer, and then waits.
    The run ends with the verdict, or after `until_tick` if that comes first.

    Attributes:
        pause_before_tick: The tick before which `iter_pauses` pauses, again and again until it is raised; None: none.
    """

    def __init__(
        self,
        setup: RunSetup,
        agents: AgentSessions,
        report: Callable[[RunStatus], None],
        watch: MessageObserver | None = None,
        until_tick: int | None = None,
    ) -> None:
        super().__init__(setup, agents, report)
        self._watch = watch
        for session in agents.values():
            session.deliver = self._deliver_command
        self._dataflow, cores = build_all_cores(setup)
        pace, policy = build_clock_pace(setup), SnapshotPolicy.of(setup)
        self._loop = StepLoop(cores, self._dataflow, self, is_whole_run=True, pace=pace, policy=policy)
        self._loop.end_at(until_tick)
        self.pause_before_tick: int | None = None
        self._reported_tick = -1

    def fly(self, is_interrupted: Callable[[], bool]) -> RunOutcome:
        """Fly until the verdict, a fault or an interruption."""
        for _ in self.iter_pauses(is_interrupted):
            pass
        return self.outcome

    def iter_pauses(self, is_interrupted: Callable[[], bool]) -> Iterator[None]:
        """Fly as `fly` does, and pause wherever simulated time has come as far as it can without an agent's answer.

        It pauses before the tick `pause_before_tick` too. A caller that commands an agent answers in the pause.
        """
        outcome, began_s = self.outcome, time.perf_counter()
        try:
            self.await_all_ready(is_interrupted)
            self._loop.start(self._setup.episode)
            self._replay_observations(is_interrupted)
            self._started_at_s = time.perf_counter()
            outcome.start_up_s = self._started_at_s - began_s
            yield from self._step_all(is_interrupted)
        except Exception as error:  # a fault of any core ends the run with its name
            # The journal of commands is the runtime's own, whatever the transport.
            culprit = "supervisor" if isinstance(error, RunFolderError) else self._loop.acting.spec.name
            text = format_fault(error, traceback.format_exc())
            outcome.fault = ServiceFault(participant=culprit, tick=self._tick, text=text)
            if self._verdict is not None and self._verdict.tick > self._tick:
                self._verdict = None
        outcome.is_cut = self._verdict is None and outcome.fault is None and self._loop.is_finished
        outcome.is_interrupted = outcome.fault is None and not self._loop.is_finished
        self._close()
        steppers = self._loop.steppers
        outcome.collect(
            self._sessions,
            verdict=self._verdict,
            reached_tick=self._tick,
            timing={stepper.spec.name: vars(stepper.timing) for stepper in steppers},
            summaries=map(self._loop.summarize, steppers),
        )
        if outcome.fault is None and self._loop.is_finished:
            outcome.digest = self.digest(outcome.ticks_flown)

    @override
    def _observe(self, agent: str, payload: bytes) -> None:
        self._sessions[agent].observe(codec.decode_observation_head(payload), payload)

    @property
    def next_tick(self) -> int:
        """The first tick that not all participants have finished."""
        return self._loop.last_tick + 1

    @property
    def is_between_ticks(self) -> bool:
        """True when no participant has begun `next_tick`."""
        return self._loop.is_between_ticks

    def find_core(self, kind: type[_Kind]) -> _Kind | None:
        """Return the first core that is of a class or supports a protocol; None where there is none."""
        return next((stepper.core for stepper in self._loop.steppers if isinstance(stepper.core, kind)), None)

    @property
    def _tick(self) -> int:
        return max(self._loop.last_tick, 0)

    def _step_all(self, is_interrupted: Callable[[], bool]) -> Iterator[None]:
        loop = self._loop
        while not loop.is_finished and not is_interrupted():
            self._handle_waiting()
            if (
                self.pause_before_tick is not None
                and self.is_between_ticks
                and self.next_tick >= self.pause_before_tick
            ):
                yield
            elif loop.step():
                self._report_if_due()
            elif self._sessions.are_pending:
                yield
                # Stepping may have taken longer than anything that counts as a pause.
                self._renew_deadlines()
                self._handle_next()
                self._check_time()
            elif (wait_s := loop.pace_wait_s) > 0:
                self._handle_next(min(wait_s, POLL_PERIOD_S))
            elif not loop.can_any_step():
                # No agent is due: a participant deviates from its declaration.
                stall = explain_stall(self._look())
                culprits = (stepper for stepper in loop.steppers if stall and stepper.spec.name == stall.culprit)
                loop.acting = next(culprits, loop.acting)
                raise GslCosimError(f"no participant can step.\n{stall.text if stall else ''}")

    def _report_if_due(self) -> None:
        tick = self._tick
        if tick == self._reported_tick or (tick % REPORT_EVERY_TICKS and not self._loop.is_paced):
            return
        self._reported_tick = tick
        self._status_reporter.report_run("flying", tick, self.wall_s)

    # On the caller's thread, while a core may be in its step.
    @override
    def _look(self) -> list[ParticipantStatus]:
        return [*(stepper.look() for stepper in self._loop.steppers), *self._sessions.look()]

    @override
    def on_outputs(self, stepper: Stepper, outputs: list[SentMessage]) -> None:
        del stepper
        for sent in outputs:
            message = sent.message
            if self._watch is not None:
                self._watch(sent.port, message)
            if isinstance(message, Observation):
                self._sessions[message.agent].observe(message, sent.payload)
                # An object has answered by now.
                self._handle_waiting()
            elif isinstance(message, Briefing):
                self._sessions[message.agent].brief(message, sent.payload)
                self._handle_waiting()
            elif isinstance(message, Verdict):
                self._verdict = message

    def _deliver_command(self, sent: SentMessage) -> None:
        if self._watch is not None:
            self._watch(sent.port, sent.message)
        self._loop.deliver(sent.port, sent.message)

    def _close(self) -> None:
        for stepper in self._loop.steppers:
            try:
                self._loop.close(stepper)
            except Exception as error:  # the others must still be closed
                text = format_fault(error, traceback.format_exc())
                fault = ServiceFault(participant=stepper.spec.name, tick=self._tick, text=text)
                self.outcome.fault = self.outcome.fault or fault
        self._end_agents()

    def digest(self, final_tick: int) -> RunDigest:
        """Return the digest of the run up to a tick that all participants have finished."""
        trails = {port: trail for s in self._loop.steppers for port, trail in s.trails.items()}
        return RunDigest.of(trails | self._sessions.trails, self._dataflow.writer_of, final_tick)


@contextmanager
def host_agents(
    setup: RunSetup,
    directory: Path,
    network: Network,
    *,
    commanded: Mapping[str, AgentTransport] = MappingProxyType({}),
) -> Generator[AgentSessions]:
    """Start the agents of a run: Python agents as objects in this process, agents behind the gateway as processes.

    Leaving the context ends the processes.

    Args:
        directory: The scenario's folder, where relative paths of agents start.
        network: Where agents that attach themselves find their join data.
        commanded: Transports of the agents that the caller commands; no program of theirs is started.
    """
    agents = AgentSessions(queue.SimpleQueue())
    own = [agent for agent in setup.scenario.agents if agent.process == agent.name and agent.name not in commanded]
    gateway = None
    if any(agent.start.is_behind_gateway for agent in own):
        gateway = GatewayAgents(setup, directory, network, agents.events.put, without=commanded)
    guests = {} if gateway is None else {name: gateway.get_transport(name) for name in gateway}
    agent_types = load_agent_types(setup.scenario, directory, [*guests, *commanded])
    workers: dict[str, WorkerThread] = {}
    for agent in setup.scenario.agents:
        link = commanded.get(agent.name) or guests.get(agent.name)
        if link is None:
            link = ObjectTransport(agent.name, agent_types[agent.process], agents.events.put)
            if agent.is_free:
                # Time does not wait for an agent in free mode, so it decides on a thread of its own.
                link = ThreadedTransport(link, workers.setdefault(agent.process, WorkerThread()))
        agents[agent.name] = build_session(agent, setup, link)
        agents[agent.name].is_ready = agent.name not in guests
    if gateway is None:
        yield agents
        return
    with gateway.open():
        yield agents


def run_in_process(
    setup: RunSetup,
    directory: Path,
    network: Network,
    report: Callable[[RunStatus], None],
    watch: MessageObserver | None = None,
) -> RunOutcome:
    """Run a scenario in this process, with its agents; see `host_agents`. The watcher of messages must change none."""
    with Interruption() as interruption, host_agents(setup, directory, network) as agents:
        return InProcessRun(setup, agents, report, watch).fly(interruption.is_set)
