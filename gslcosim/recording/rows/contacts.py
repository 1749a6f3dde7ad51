"""What vehicles touch: lines of a log, from when until when, and points where it began."""

from collections.abc import Iterable

from gslcosim.contract.messages import BodyState
from gslcosim.recording import colors
from gslcosim.recording.rows.columns import MarkerRows, TextRows
from gslcosim.ticks import seconds_from_ticks


class ContactNotes:
    """The contacts of one vehicle.

    The log has every one. Points are where the vehicle was when it came against something else than a floor, the first
    one of each thing with its name.
    """

    def __init__(self, agent: str, markers: MarkerRows, log: TextRows, *, tick_ns: int, floors: Iterable[str]) -> None:
        self._agent = agent
        self._markers = markers
        self._log = log
        self._tick_ns = tick_ns
        self._floors = frozenset(floors)
        self._since: dict[str, int] = {}
        self._named: set[str] = set()

    def add(self, tick: int, body: BodyState) -> None:
        """Take note of what a vehicle touches at the end of a tick."""
        if not body.contacts and not self._since:
            return
        for thing in body.contacts:
            if thing not in self._since:
                self._begin(tick, body, thing)
        for thing in [thing for thing in self._since if thing not in body.contacts]:
            lasted_s = seconds_from_ticks(tick - self._since.pop(thing), self._tick_ns)
            self._log.add(tick, f"{self._agent} is off {thing} after {lasted_s:g} s", "INFO")

    def _begin(self, tick: int, body: BodyState, thing: str) -> None:
        self._since[thing] = tick
        is_floor = thing in self._floors
        self._log.add(tick, f"{self._agent} touches {thing}", "INFO" if is_floor else "WARN")
        if not is_floor:
            label = "" if thing in self._named else f"touches {thing}"
            self._named.add(thing)
            self._markers.add(tick, body.position_world_m, label, colors.CONTACT)
