"""Looking at the participants of a run over the bus while it goes on, for a person."""

import queue
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress

from gslcosim.bus.port import Bus
from gslcosim.runtime.agents.desk import Desk, agent_statuses
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.over_bus.watchdog import Watchdog
from gslcosim.runtime.status import ParticipantState, ParticipantStatus

# Who has not answered by then is silent: it is stopped, or its process has too much to do.
ANSWER_WITHIN_S = 0.5


class Inspector:
    """Asks the services of a run how they go, only when somebody looks.

    Args:
        bus: The supervisor's connection.
        services: Those of the run.
        watchdog: Knows who has said goodbye.
        desks: Of the agents.
    """

    def __init__(self, bus: Bus, services: Sequence[str], watchdog: Watchdog, desks: Mapping[str, Desk]) -> None:
        self._bus = bus
        self._services = services
        self._watchdog = watchdog
        self._desks = desks

    def look(self) -> list[ParticipantStatus]:
        """Return one moment of all participants; may be called on any thread."""
        answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        asked = [name for name in self._services if name not in self._watchdog.byes]
        for name in asked:
            self._bus.ask(control.inspect(name), b"", lambda _, payload: answers.put(payload))
        came = _collected(answers, len(asked))
        return [self._service(name, came.get(name)) for name in self._services] + agent_statuses(self._desks)

    def _service(self, name: str, told: control.Inspection | None) -> ParticipantStatus:
        if told is None:
            state: ParticipantState = "done" if name in self._watchdog.byes else "silent"
            return ParticipantStatus(name=name, state=state, tick=self._watchdog.tick_of(name))
        return ParticipantStatus(
            name=name,
            state="done" if told.is_finished else "waiting" if told.waits_for else "working",
            tick=told.tick,
            waits_for=tuple(told.waits_for),
            queued_ticks=told.queued_ticks,
            pid=told.pid,
            cpu_s=told.cpu_s,
            memory_bytes=told.memory_bytes,
            n_resends=told.n_resends,
        )


def _collected(answers: "queue.SimpleQueue[bytes]", n_asked: int) -> dict[str, control.Inspection]:
    came: dict[str, control.Inspection] = {}
    deadline_s = time.monotonic() + ANSWER_WITHIN_S
    with suppress(queue.Empty):
        while len(came) < n_asked:
            told: control.Inspection = control.Inspection.from_bytes(
                answers.get(timeout=max(0.0, deadline_s - time.monotonic()))
            )
            came[told.name] = told
    return came
