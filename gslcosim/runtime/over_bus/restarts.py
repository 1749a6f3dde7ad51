"""Services that are started again where they die: which, how often, and what is told of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from gslcosim.runtime.grouping import Group, process_name
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.participants import service_kind
from gslcosim.scenario import Scenario


@dataclass
class _Deaths:
    """How often a process has died without progress, and where it was then."""

    tick: int = -1
    n: int = 0


@dataclass
class Restarts:
    """Decides whether a process that has died is started again. It waits for nothing and reads no clock.

    A process is started again as long as the run has come further since it last died, and otherwise `restart.tries`
    times: what dies at the same tick again and again is a fault. One that only reads, such as the recorder, is not:
    what it has seen is nowhere else.

    Args:
        scenario: Says whether services are started again.
        groups: The services of each process.
        start: Starts the process of a group, and is told how it ended.
    """

    scenario: Scenario
    groups: Sequence[Group]
    start: Callable[[Group, str], object]
    told: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    _deaths: dict[str, _Deaths] = field(default_factory=dict[str, _Deaths])
    _faults: dict[str, control.FaultNote] = field(default_factory=dict[str, control.FaultNote])
    _awaited: set[str] = field(default_factory=set[str])

    def covers(self, process: str) -> bool:
        """Whether a process would be started again at all; then one that is stopped counts when it has been killed."""
        return self.scenario.restart is not None and all(self._has_state(name) for name in self._group(process))

    def takes_fault(self, note: control.FaultNote) -> bool:
        """Take what a service says of its own failure; return whether its end is waited for, to start it again."""
        process = next((process_name(group) for group in self.groups if note.participant in group), "")
        if not process or not self.covers(process):
            return False
        self._faults[process] = note
        return True

    def begin(self, process: str, how: str, tick: int) -> bool:
        """Start a process that has ended again, or return false where that is of no use, or not wanted.

        Args:
            process: Its name.
            how: How it ended.
            tick: The last tick that its services are known to have finished.
        """
        spec = self.scenario.restart
        if spec is None or not self.covers(process):
            return False
        # Who tells of an error knows its tick; of others the last that they have told is known.
        fault = self._faults.get(process)
        if fault is not None:
            tick = max(tick, fault.tick)
        deaths = self._deaths.setdefault(process, _Deaths())
        deaths.n = 1 if tick > deaths.tick else deaths.n + 1
        deaths.tick = max(tick, deaths.tick)
        if deaths.n > spec.tries:
            return False
        self._faults.pop(process, None)
        self._awaited |= set(self._group(process))
        told = how if fault is None else fault.text.strip()
        self.told.append({"process": process, "tick": tick, "how": told.splitlines()[-1]})
        self.start(self._group(process), how)
        return True

    def is_under_way(self, service: str) -> bool:
        """Whether a service is being started again."""
        return service in self._awaited

    def has_come(self, service: str) -> bool:
        """Take note that a service is there; return whether it had been started again."""
        if service not in self._awaited:
            return False
        self._awaited.discard(service)
        return True

    def reason(self, process: str, how: str) -> str:
        """Return why the end of a process ends the run."""
        fault = self._faults.get(process)
        text = f"{how}; the run is not valid without it." if fault is None else fault.text.strip()
        if self.scenario.restart is None:
            return text
        if not self.covers(process):
            return f"{text} It is not started again: what it has seen is in its file, which is not whole."
        return f"{text} It was started again {self.scenario.restart.tries} times, and has come no further."

    @property
    def account(self) -> dict[str, Any]:
        """What `result.json` has of it."""
        return {"restarts": self.told} if self.told else {}

    @property
    def text(self) -> str:
        """What the status line says."""
        if not self.told:
            return ""
        return f"{self.told[-1]['process']} was started again, restart {len(self.told)}"

    def _group(self, process: str) -> Group:
        return next((group for group in self.groups if process_name(group) == process), ())

    def _has_state(self, service: str) -> bool:
        return bool(service_kind(service, self.scenario).spec_of(self.scenario).writes)
