"""Decides that a process hangs: who has come how far, who waits for whom, and who has been silent for too long."""

from collections.abc import Callable, Sequence

from gslcosim.errors import ExitCode
from gslcosim.runtime.grouping import Group, process_name
from gslcosim.runtime.outcome import ServiceFault
from gslcosim.runtime.over_bus.control import Bye, TickNote, WaitingNote
from gslcosim.runtime.run_dir import RunDir

STALL_LIMIT_S = 30.0
GOODBYE_LIMIT_S = 120.0
LOST_CONTACT_GRACE_S = 0.3


class Watchdog:
    """Watches the services of a run. It reads no clock: times [s] of a monotonic one are handed in."""

    def __init__(self, groups: Sequence[Group], run_dir: RunDir) -> None:
        """Watch the services of a run, those of each process together."""
        self._services = tuple(name for group in groups for name in group)
        self._process_of = {name: process_name(group) for group in groups for name in group}
        self._run_dir = run_dir
        self._progress = dict.fromkeys(self._services, -1)
        self._waiting: dict[str, WaitingNote] = {}
        self._byes: dict[str, Bye] = {}
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
            process: Its name.
            now_s: The time.
            begin: Is told the last tick that all its services have finished, and starts it where that is wanted.
        """
        services = [name for name, its in self._process_of.items() if its == process]
        if all(name in self._byes for name in services):
            return True
        # Before simulated time begins there is nothing to go on with.
        if not self._moved_at_s or not begin(min(self.tick_of(name) for name in services)):
            return False
        for name in services:
            self.regained_contact(name)
            self._waiting.pop(name, None)
        self._moved_at_s = now_s
        return True

    @property
    def byes(self) -> dict[str, Bye]:
        """The goodbyes of services that are done."""
        return self._byes

    @property
    def are_done(self) -> bool:
        """Whether all services have said goodbye."""
        return len(self._byes) == len(self._services)

    @property
    def finished_tick(self) -> int:
        """The last tick that all services have finished, at least 0."""
        return max(min(self._progress.values()), 0)

    def tick_of(self, name: str) -> int:
        """Return the last tick that a service has finished, at least 0."""
        return max(self._progress.get(name, 0), 0)

    def moved(self, now_s: float) -> None:
        """Take note that simulated time has not stalled, or waits for somebody with a deadline of its own."""
        self._moved_at_s = now_s

    def progressed(self, name: str, note: TickNote, now_s: float) -> None:
        """Take note of a finished tick; doors of agents tell theirs too, which says nothing of services."""
        if note.tick > self._progress.get(name, note.tick):
            self._progress[name] = note.tick
            self._moved_at_s = now_s
            self._waiting.pop(name, None)

    def waits(self, name: str, note: WaitingNote) -> None:
        """Take note of what a service waits for."""
        self._waiting[name] = note

    def said_goodbye(self, bye: Bye, now_s: float) -> None:
        """Take note that a service is done."""
        if bye.name not in self._byes:
            self._byes[bye.name] = bye
            self._moved_at_s = now_s

    def lost_contact(self, name: str, now_s: float) -> None:
        """Take note that a service's token has vanished.

        Its process may have ended too; that says more, and comes within a moment.
        """
        self._lost_since_s.setdefault(name, now_s)

    def regained_contact(self, name: str) -> None:
        """Take note that a service's token is there, perhaps again."""
        self._lost_since_s.pop(name, None)

    def postpone(self, missed_s: float, now_s: float) -> None:
        """Move all deadlines by time [s] in which nobody looked, until now."""
        self._missed_s = missed_s
        self._moved_at_s = min(self._moved_at_s + missed_s, now_s)
        self._lost_since_s = {name: min(since_s + missed_s, now_s) for name, since_s in self._lost_since_s.items()}

    @property
    def pause_text(self) -> str:
        """What to add where contact was lost: empty unless this side stood still itself."""
        return f" The supervisor itself had stood still for {self._missed_s:.0f} s." if self._missed_s else ""

    def check(self, now_s: float, *, is_judged: bool) -> ServiceFault | None:
        """Return who is at fault where contact is lost or nothing moves any more.

        Args:
            now_s: The time.
            is_judged: Whether the verdict is there, so that services only have to finish.
        """
        for name, since_s in self._lost_since_s.items():
            if now_s - since_s > LOST_CONTACT_GRACE_S:
                return self.fault(name, f"contact was lost: it hangs, or its link is down.{self.pause_text}")
        limit_s = GOODBYE_LIMIT_S if is_judged else STALL_LIMIT_S
        return self._stall(limit_s) if now_s - self._moved_at_s > limit_s else None

    def fault(self, name: str, text: str, exit_code: ExitCode = ExitCode.FAULT) -> ServiceFault:
        """Return a fault of a participant, with the end of its log."""
        process = self._process_of.get(name, name)
        tail = self._run_dir.last_words(process)
        text = f"{text}\nLast lines of its log:\n{tail}" if tail else text
        text = f"{text}\nLog: {self._run_dir.log(process)}"
        return ServiceFault(participant=name, tick=self.tick_of(name), text=text, exit_code=exit_code)

    def _stall(self, limit_s: float) -> ServiceFault:
        silent = [name for name in self._services if name not in self._waiting and name not in self._byes]
        culprit = silent[0] if silent else min(self._progress, key=lambda name: self._progress[name])
        lines = [f"nothing moved for {limit_s:g} s; it is at tick {self._progress[culprit] + 1}."]
        for name, note in self._waiting.items():
            needs = [f"{port} at tick {tick}" for port, tick in note.missing]
            needs += [f"{reader} to catch up" for reader in note.lacking_credit]
            lines.append(f"  {name} waits at tick {note.tick} for {', '.join(needs)}")
        return self.fault(culprit, "\n".join(lines), ExitCode.TIMEOUT)
