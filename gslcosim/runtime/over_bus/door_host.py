"""An agent's desk as a participant on the bus: observations in, commands out, losses repaired."""

from collections.abc import Callable, Iterable

from gslcosim.bus.port import Bus
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command
from gslcosim.runtime.agents.desk import Desk
from gslcosim.runtime.agents.door import door_name
from gslcosim.runtime.agents.events import AgentEvent
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.over_bus.hosted import KEPT_TICKS, PROGRESS_EVERY_TICKS, Kept
from gslcosim.runtime.over_bus.in_order import InOrder
from gslcosim.runtime.stepper import Sent


class DoorHost:
    """Hosts one agent's desk.

    Args:
        desk: The desk.
        bus: The supervisor's connection.
        on_resent: Is told, on any thread, an observation that was asked for again.
        more_ticks: For so many ticks more commands are kept for who has missed them.
    """

    def __init__(self, desk: Desk, bus: Bus, on_resent: Callable[[bytes], None], more_ticks: int = 0) -> None:
        self.desk = desk
        self._name = door_name(desk.agent)
        self._bus = bus
        self._on_resent = on_resent
        self._in_order: InOrder[tuple[codec.ObservationHead, bytes]] = InOrder()
        self._kept = Kept(KEPT_TICKS + more_ticks)
        self._told_tick = -1

    def listen(self) -> None:
        """Answer who missed a command."""
        self._bus.answer(control.resend(self._name), self._kept.answer)
        self._bus.answer(control.finished(self._name), lambda _: [self._finished()])

    def _finished(self) -> bytes:
        return control.ReaderNote(name=self._name, tick=self.desk.last_tick).to_bytes()

    def brief(self, payload: bytes) -> None:
        """Take the agent's briefing."""
        self.desk.brief(codec.decode_trusted(Briefing, payload), payload)

    def observe(self, payload: bytes) -> None:
        """Take an observation, in any order; ask for one that seems to be lost."""
        head = codec.peek_observation(payload)
        for next_head, message in self._in_order.take(head.tick, (head, payload)):
            self._observe(next_head, message)
        if (tick := self._in_order.lost()) is not None:
            question = control.ResendRequest(port=keys.observation(self.desk.agent), tick=tick).to_bytes()
            self._bus.ask(control.resend("sensing"), question, lambda _, resent: self._on_resent(resent))

    def handle(self, event: AgentEvent) -> None:
        """Take what the agent did."""
        self._publish(self.desk.handle(event))

    def lose(self, reason: str) -> None:
        """Take note that the agent is gone."""
        self._publish(self.desk.lose(reason))

    def check_time(self) -> None:
        """Give the agent up where it has owed an answer for too long."""
        self._publish(self.desk.check_time())

    # The agent is sent the bytes as they are, so nobody has to look at the rest.
    def _observe(self, head: codec.ObservationHead, payload: bytes) -> None:
        passed = self.desk.observe(head, payload)
        if head.tick - self._told_tick >= PROGRESS_EVERY_TICKS:
            self._told_tick = head.tick
            self._bus.publish(control.progress(self._name), control.TickNote(tick=head.tick).to_bytes())
        self._publish(passed)

    def _publish(self, passed: Iterable[Sent]) -> None:
        for sent in passed:
            self._kept.keep(sent)
            self._bus.publish(sent.port, sent.payload, encoding=codec.encoding_of(Command), urgent=True)
