"""Host of a run's loop: agents' events, the wait for all to join, past observations, deadlines, and the status.

Its two ports: `InProcessRun` steps the cores in memory, `Supervisor` watches processes on a bus.
"""

import queue
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from gslcosim.contract.messages import Verdict
from gslcosim.runtime.agents.session import AgentSessions
from gslcosim.runtime.network import JOIN_TIMEOUT_S
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.participant_status import ParticipantStatus
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunStatus, StatusReporter

POLL_PERIOD_S = 0.1
# Limit between two checks of deadlines, for an agent that sends without end.
MAX_EVENTS_AT_ONCE = 256


class LoopHost(ABC):
    """Host of a run's loop, with the sessions of its agents.

    Events are put into the queue of the sessions by many threads, and handled on the one that runs the loop.

    Attributes:
        outcome: That of the run, complete at its end.
    """

    def __init__(self, setup: RunSetup, sessions: AgentSessions, report: Callable[[RunStatus], None]) -> None:
        self.outcome = RunOutcome()
        self._setup = setup
        self._sessions = sessions
        self._status_reporter = StatusReporter(report, setup.scenario.tick_ns, self._look)
        self._verdict: Verdict | None = None
        self._started_at_s: float | None = None
        self._ended_at_s: float | None = None

    @property
    def has_begun(self) -> bool:
        """True when simulated time has started."""
        return self._started_at_s is not None

    @property
    def wall_s(self) -> float:
        """Time since simulated time has started, until the end of the run [s]."""
        return 0.0 if self._started_at_s is None else (self._ended_at_s or time.perf_counter()) - self._started_at_s

    def await_all_ready(self, is_interrupted: Callable[[], bool]) -> None:
        """Wait until all participants have joined, or for an interruption; what is late by then is given up."""
        began_s = time.monotonic()
        while (lacking := self._list_awaited()) and not is_interrupted():
            began_s += self._renew_deadlines()
            waited_s = time.monotonic() - began_s
            for name in lacking if waited_s > JOIN_TIMEOUT_S else ():
                self._give_up(name)
            self._check_joining()
            self._status_reporter.report_awaited(lacking, waited_s)
            self._handle_next()

    @abstractmethod
    def _look(self) -> list[ParticipantStatus]:
        """Return the status of all participants; may be called on any thread."""

    @abstractmethod
    def _observe(self, agent: str, payload: bytes) -> None:
        """Send an agent an observation from before the snapshot."""

    def _handle(self, event: Any) -> None:
        self._sessions[event.agent].handle(event)

    def _list_awaited(self) -> list[str]:
        return self._sessions.awaited

    def _give_up(self, name: str) -> None:
        session = self._sessions[name]
        session.mark_lost(session.transport.describe_absence())

    # Called while participants join; raises where contact to one is lost.
    def _check_joining(self) -> None:
        return

    # Nothing was late while this process stood still; returns for how long it did [s].
    def _renew_deadlines(self) -> float:
        return self._sessions.renew_deadlines()

    def _check_time(self) -> None:
        self._renew_deadlines()
        self._sessions.check_deadlines()

    # Cores resume at the snapshot; agents get the observations before it, and time waits for their answers.
    def _replay_observations(self, is_interrupted: Callable[[], bool]) -> None:
        for observations in self._setup.snapshot.read_observations() if self._setup.snapshot is not None else ():
            for agent, payload in observations:
                self._observe(agent, payload)
                self._handle_waiting()
            while self._sessions.are_pending and not is_interrupted():
                self._handle_next()
                self._check_time()
            if is_interrupted():
                return

    def _handle_waiting(self) -> None:
        events = self._sessions.events
        for _ in range(MAX_EVENTS_AT_ONCE):
            if events.empty():
                return
            self._handle(events.get())

    def _handle_next(self, timeout_s: float = POLL_PERIOD_S) -> None:
        with suppress(queue.Empty):
            self._handle(self._sessions.events.get(timeout=timeout_s))
            self._handle_waiting()

    def _end_agents(self) -> None:
        self._ended_at_s = time.perf_counter()
        self.outcome.flight_wall_s = self.wall_s
        self._sessions.end(self._verdict)
