"""The link to an agent that is an object in this process and decides on a thread of its own, while time goes on."""

import queue
import threading
from collections.abc import Callable

from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Ending, Observation
from gslcosim.runtime.agents.events import CommandCame, CommandRefused
from gslcosim.runtime.agents.links import ObjectLink, Seen

# An agent that still thinks when the run is over is left to itself.
END_LIMIT_S = 2.0


class Worker:
    """A thread that does one thing after another; agents of one process share it, as they share a process elsewhere."""

    def __init__(self) -> None:
        self._tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._has_begun = False

    def do(self, task: Callable[[], None]) -> None:
        """Let the thread do something after all that it was told before."""
        if not self._has_begun:
            self._has_begun = True
            self._thread.start()
        self._tasks.put(task)

    def finish(self) -> None:
        """Wait until all is done, but not for ever."""
        if self._has_begun:
            self._tasks.put(None)
            self._thread.join(END_LIMIT_S)

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            task()


class ThreadedLink:
    """Lets the agent of another link look and decide on a worker's thread; see `AgentLink`.

    An agent that is slower than time sees every observation, but of the questions it is asked the last one alone.
    """

    may_lose = False

    def __init__(self, link: ObjectLink, worker: Worker) -> None:
        self._link = link
        self._worker = worker
        self._newest_question = -1
        self._is_over = False

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Let the agent be made; see `AgentLink`."""
        self._worker.do(lambda: self._link.brief(briefing, payload))

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Let the agent look, and decide unless there is something newer by then; see `AgentLink`."""
        if observation.awaiting_command:
            self._newest_question = observation.tick
        self._worker.do(lambda: self._look(codec.decode(Observation, payload), payload))

    def repeat(self) -> None:
        """Do nothing: no message gets lost; see `AgentLink`."""

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Do nothing: it says at most one thing to each observation; see `AgentLink`."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Tell the agent when it is done with what it does now, and wait a moment for that; see `AgentLink`."""
        self._is_over = True
        self._worker.do(lambda: self._link.end(ending, payload))
        self._worker.finish()

    def _look(self, observation: Observation, payload: bytes) -> None:
        if self._is_over:
            return
        if observation.awaiting_command and observation.tick < self._newest_question:
            observation = observation.model_copy(update={"awaiting_command": False})
        self._link.observe(observation, payload)
