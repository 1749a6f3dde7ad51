"""Watchdog of services: decides which one hangs, and whether one that has died is started again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gslcosim.base.errors import ExitCode
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.protocol import FinalReport, TickReport
from gslcosim.runtime.outcome import ServiceFault
from gslcosim.runtime.participant_status import MissingMessage, ParticipantStatus, explain_stall
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import ServiceGroup, find_service, get_process_name
from gslcosim.scenario import Scenario

STALL_TIMEOUT_S = 30.0
FINISH_TIMEOUT_S = 120.0
LOST_CONTACT_GRACE_S = 0.3


class Watchdog:
    """Watches the services of a run. It reads no clock: times [s] of a monotonic one are handed in."""

    def __init__(self, groups: Sequence[ServiceGroup], run_dir: RunDir) -> None:
        """Watch the services of a run, those of each process together."""
        self._services = tuple(name for group in groups for name in group)
        self._process_of = {name: get_process_name(group) for group in groups for name in group}
        self._run_dir = run_dir
        self._progress = dict.fromkeys(self._services, -1)
        # Of services that have finished.
        self.final_reports: dict[str, FinalReport] = {}
        self._lost_since_s: dict[str, float] = {}
        self._moved_at_s = 0.0
        self._missed_s = 0.0

    def __contains__(self, name: str) -> bool:
        return name in self._progress

    def watches_process(self, name: str) -> bool:
        """Return whether services live in a process of that name."""
        return name in self._process_of.values()

    def is_restarted(self, process: str, now_s: float, begin: Callable[[int], bool]) -> bool:
        """Let a process that has ended be started again, and return whether it is; one that is done is not missed.

        Args:
            begin: Receives the last tick that all its services have finished, and starts it where that is wanted.
        """
        services = [name for name, its in self._process_of.items() if its == process]
        if all(name in self.final_reports for name in services):
            return True
        # Before simulated time begins there is nothing to go on with.
        if not self._moved_at_s or not begin(min(self.tick_of(name) for name in services)):
            return False
        for name in services:
            self.record_contact_regained(name)
        self._moved_at_s = now_s
        return True

    @property
    def is_finished(self) -> bool:
        """True when all services have sent their final report."""
        return len(self.final_reports) == len(self._services)

    @property
    def finished_tick(self) -> int:
        """The last tick that all services have finished, at least 0."""
        return max(min(self._progress.values()), 0)

    def tick_of(self, name: str) -> int:
        """Return the last tick that a service has finished, at least 0."""
        return max(self._progress.get(name, 0), 0)

    def moved(self, now_s: float) -> None:
        """Take note that simulated time has not stalled, or waits for an agent with a deadline of its own."""
        self._moved_at_s = now_s

    def record_progress(self, name: str, note: TickReport, now_s: float) -> None:
        """Take note of a finished tick; the reports of agents' sessions do not count."""
        if note.tick > self._progress.get(name, note.tick):
            self._progress[name] = note.tick
            self._moved_at_s = now_s

    def record_final_report(self, report: FinalReport, now_s: float) -> None:
        """Take note that a service is done."""
        if report.name in self and report.name not in self.final_reports:
            self.final_reports[report.name] = report
            self._moved_at_s = now_s

    def record_contact_lost(self, name: str, now_s: float) -> None:
        """Take note that a service's token has vanished.

        The end of its process, which explains more, may come within a moment.
        """
        self._lost_since_s.setdefault(name, now_s)

    def record_contact_regained(self, name: str) -> None:
        """Take note that a service's token is there, perhaps again."""
        self._lost_since_s.pop(name, None)

    def extend_deadlines(self, missed_s: float, now_s: float) -> None:
        """Move all deadlines by the time [s] in which this process stood still, until now."""
        self._missed_s = missed_s
        self._moved_at_s = min(self._moved_at_s + missed_s, now_s)
        self._lost_since_s = {name: min(since_s + missed_s, now_s) for name, since_s in self._lost_since_s.items()}

    @property
    def pause_text(self) -> str:
        """Addition where contact was lost: empty unless this side stood still itself."""
        return f" The supervisor itself had stood still for {self._missed_s:.0f} s." if self._missed_s else ""

    def check(
        self,
        now_s: float,
        *,
        is_judged: bool,
        look: Callable[[], Sequence[ParticipantStatus]],
        overdue: Sequence[MissingMessage] = (),
    ) -> ServiceFault | None:
        """Return the fault of a service where contact is lost or nothing moves any more.

        Args:
            is_judged: True after the verdict, when services only have to finish.
            overdue: Messages of finished services that have not come.
        """
        if (fault := self.find_lost(now_s)) is not None:
            return fault
        limit_s = FINISH_TIMEOUT_S if is_judged else STALL_TIMEOUT_S
        if now_s - self._moved_at_s <= limit_s:
            return None
        for lost in overdue:
            text = f"it is done, but its {lost.port} of tick {lost.tick} is lost: it did not come in {limit_s:g} s."
            return self.fault(lost.writer, text, ExitCode.TIMEOUT)
        return self._stall(limit_s, look())

    def find_lost(self, now_s: float) -> ServiceFault | None:
        """Return the fault of a service where contact is lost, also before simulated time begins."""
        for name, since_s in self._lost_since_s.items():
            if now_s - since_s > LOST_CONTACT_GRACE_S:
                return self.fault(name, f"contact was lost: it hangs, or its link is down.{self.pause_text}")
        return None

    def fault(self, name: str, text: str, exit_code: ExitCode = ExitCode.FAULT) -> ServiceFault:
        """Return a fault of a participant, with the end of its log."""
        process = self._process_of.get(name, name)
        tail = self._run_dir.log_tail(process)
        text = f"{text}\nLast lines of its log:\n{tail}" if tail else text
        text = f"{text}\nLog: {self._run_dir.log(process)}"
        return ServiceFault(participant=name, tick=self.tick_of(name), text=text, exit_code=exit_code)

    def _stall(self, limit_s: float, participants: Sequence[ParticipantStatus]) -> ServiceFault:
        stall = explain_stall(participants)
        unreported = [name for name in self._services if name not in self.final_reports] or self._services
        culprit = min(unreported, key=lambda name: self._progress[name]) if stall is None else stall.culprit
        # Its own status is newer than its last report.
        seen = [participant.tick for participant in participants if participant.name == culprit]
        tick = max(self.tick_of(culprit), *seen, 0)
        lines = [f"nothing moved for {limit_s:g} s; it is at tick {tick + 1}."]
        lines += [f"  {line}" for line in (stall.lines if stall else ())]
        return replace(self.fault(culprit, "\n".join(lines), ExitCode.TIMEOUT), tick=tick)


@dataclass
class RestartPolicy:
    """Decides whether a process that has died is started again. It waits for nothing and reads no clock.

    A process is started again as long as the run has come further since it last died, and otherwise `restart.tries`
    times: a death at the same tick again and again is a fault. One that only reads, such as the recorder, is not:
    its past inputs are nowhere else.
    """

    scenario: Scenario
    groups: Sequence[ServiceGroup]
    start: Callable[[ServiceGroup, str], object]
    restarts: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    # How often a process has died without progress, and at which tick.
    _deaths: dict[str, tuple[int, int]] = field(default_factory=dict[str, tuple[int, int]])
    _faults: dict[str, protocol.FaultReport] = field(default_factory=dict[str, protocol.FaultReport])
    _awaited: set[str] = field(default_factory=set[str])

    def covers(self, process: str) -> bool:
        """Return whether a process would be started again; then one that is stopped counts once it is killed."""
        return self.scenario.restart is not None and all(
            find_service(name, self.scenario).build_spec(self.scenario).writes for name in self._group(process)
        )

    def absorbs_fault(self, note: protocol.FaultReport) -> bool:
        """Take a service's report of its failure; return whether its end is waited for, to start it again."""
        process = next((get_process_name(group) for group in self.groups if note.participant in group), "")
        if not process or not self.covers(process):
            return False
        self._faults[process] = note
        return True

    def begin(self, process: str, how: str, tick: int) -> bool:
        """Start a process that has ended again, or return false where that is of no use, or not wanted.

        Args:
            tick: The last tick that its services are known to have finished.
        """
        spec = self.scenario.restart
        if spec is None or not self.covers(process):
            return False
        # An error comes with its tick; otherwise the last reported one counts.
        fault = self._faults.get(process)
        if fault is not None:
            tick = max(tick, fault.tick)
        n_deaths, last_tick = self._deaths.get(process, (0, -1))
        n_deaths = 1 if tick > last_tick else n_deaths + 1
        self._deaths[process] = (n_deaths, max(tick, last_tick))
        if n_deaths > spec.tries:
            return False
        self._faults.pop(process, None)
        self._awaited |= set(self._group(process))
        reason = how if fault is None else fault.text.strip()
        self.restarts.append({"process": process, "tick": tick, "how": reason.splitlines()[-1]})
        self.start(self._group(process), how)
        return True

    def is_under_way(self, service: str) -> bool:
        """Return whether a service is being started again."""
        return service in self._awaited

    def mark_reconnected(self, service: str) -> bool:
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
    def summary(self) -> dict[str, Any]:
        """Entry of restarts in `result.json`."""
        return {"restarts": self.restarts} if self.restarts else {}

    @property
    def text(self) -> str:
        """Text for the status line."""
        if not self.restarts:
            return ""
        return f"{self.restarts[-1]['process']} was started again, restart {len(self.restarts)}"

    def _group(self, process: str) -> ServiceGroup:
        return next((group for group in self.groups if get_process_name(group) == process), ())
