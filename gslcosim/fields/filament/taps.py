"""What may be done to a source while a plume goes on: opened, closed, opened wider, moved."""

from dataclasses import dataclass

from gslcosim.fields.filament.release import Births
from gslcosim.quantities import Vec3


@dataclass(frozen=True, kw_only=True)
class SourceChange:
    """What is new about a source from the next step on; what is absent stays as it is.

    `share` is the rate in terms of the one that the source began with; it is for releases without a schedule.
    """

    position_world_m: Vec3 | None = None
    is_open: bool | None = None
    share: float | None = None


@dataclass
class Tap:
    """Lets the births of one source pass, at a changed rate if wanted.

    A closed tap keeps back what is born; the release goes on behind it. With a share s the release's own time runs s
    times as fast: dw/dt = s, so a Poisson process stays one, with s times the rate, and nothing is drawn twice.
    """

    is_open: bool = True
    share: float = 1.0
    own_time_s: float | None = None

    def change(self, change: SourceChange, now_s: float) -> None:
        """Obey a change from now [s since the start of the plume] on."""
        if change.is_open is not None:
            self.is_open = change.is_open
        if change.share is not None:
            self.own_time_s = now_s if self.own_time_s is None else self.own_time_s
            self.share = change.share

    def births_s(self, births: Births, start_s: float, end_s: float) -> list[float]:
        """Return the times of birth [s] of a release after `start_s` and up to `end_s`, as far as they pass."""
        if self.own_time_s is None:
            born_s = births.births_s(start_s, end_s)
        else:
            own_start_s = self.own_time_s
            self.own_time_s = own_start_s + self.share * (end_s - start_s)
            own_s = births.births_s(own_start_s, self.own_time_s)
            born_s = [min(start_s + (each_s - own_start_s) / self.share, end_s) for each_s in own_s]
        return born_s if self.is_open else []
