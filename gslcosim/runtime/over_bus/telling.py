"""Telling how a run over the bus goes on: not too often, but each state at once."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from gslcosim.runtime.status import FlightStatus, ParticipantStatus
from gslcosim.ticks import seconds_from_ticks

STATUS_EVERY_S = 0.1
# Who has not joined by then is named in a log, too: before it is sure that one that is stopped will not come.
LATE_AFTER_S = 4.0


class Teller:
    """Reports the status of a flight.

    Args:
        report: Is told the status.
        tick_ns: How long a tick is.
        participants: Looks at the participants, for whoever is told the status.
    """

    def __init__(
        self,
        report: Callable[[FlightStatus], None],
        tick_ns: int,
        participants: Callable[[], list[ParticipantStatus]],
    ) -> None:
        self._report = report
        self._tick_ns = tick_ns
        self._participants = participants
        self._told_at_s, self._told_state = 0.0, ""

    def tell_awaited(self, names: Sequence[str], waited_s: float) -> None:
        """Tell who has not joined yet, and after a while for how long."""
        text = f"waiting for {', '.join(names)}"
        if waited_s <= LATE_AFTER_S:
            self._tell(FlightStatus(state="starting", text=text))
        else:
            self._tell(FlightStatus(state="starting", text=f"{text}, not here after {waited_s:.0f} s", is_late=True))

    def tell_flight(self, state: str, tick: int, wall_s: float, text: str = "") -> None:
        """Tell how far the flight has come, and what else there is to tell."""
        sim_time_s = seconds_from_ticks(tick, self._tick_ns)
        factor = sim_time_s / wall_s if wall_s > 0 else 0.0
        self._tell(FlightStatus(state=state, text=text, sim_time_s=sim_time_s, real_time_factor=factor))

    def _tell(self, status: FlightStatus) -> None:
        now_s = time.monotonic()
        if status.state != self._told_state or now_s - self._told_at_s >= STATUS_EVERY_S:
            self._told_at_s, self._told_state = now_s, status.state
            self._report(replace(status, participants=self._participants))
