"""Release of filaments: times of birth by schedule, positions in a source's shape, and the source's valve."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3

# Filament number rate * t exists at t even when the product is rounded down by its last digit.
_ROUNDING = 1e-9

ShapeKind = Literal["point", "box", "line", "sphere", "cylinder"]


class BirthSequence(Protocol):
    """A release under way, read in consecutive spans without gaps.

    The births are a list: they are few in a step, and an array would cost more.
    """

    def births_s(self, start_s: float, end_s: float) -> list[float]:
        """Return the times of birth [s] after `start_s` and up to `end_s`, ascending."""
        ...


class ReleasePlan(Protocol):
    """Plan by which a source releases filaments; time counts from the start of the plume."""

    def start(self, rng: np.random.Generator) -> BirthSequence:
        """Return the release from time 0 on; `rng` is the source's own stream."""
        ...


@dataclass(frozen=True, kw_only=True)
class ConstantRelease:
    """Filament number j = 1, 2, … is born at j / rate: exactly `rate * t` (rounded down) are born until t.

    Nothing is carried from step to step, so nothing can drift.
    """

    filaments_per_s: float

    def start(self, rng: np.random.Generator) -> BirthSequence:
        """Return itself: it draws nothing and has no state."""
        del rng
        return self

    def n_born_by(self, time_s: float) -> int:
        """Return the number of filaments born from 0 to a time [s]."""
        return int(self.filaments_per_s * time_s + _ROUNDING)

    def births_s(self, start_s: float, end_s: float) -> list[float]:
        """Return the times of birth; see `BirthSequence`."""
        numbers = range(self.n_born_by(start_s) + 1, self.n_born_by(end_s) + 1)
        return [min(j / self.filaments_per_s, end_s) for j in numbers]


@dataclass(frozen=True, kw_only=True)
class PoissonRelease:
    """Births independent of each other: the time between two is exponential with mean 1 / rate."""

    filaments_per_s: float

    def start(self, rng: np.random.Generator) -> BirthSequence:
        """Return a process that draws one waiting time for each birth."""
        return _PoissonBirths(filaments_per_s=self.filaments_per_s, rng=rng)


class PiecewiseRelease(ABC):
    """A rate that is constant for a span, one span after the other."""

    def start(self, rng: np.random.Generator) -> BirthSequence:
        """Return the release from time 0 on; see `ReleasePlan`."""
        return _PiecewiseBirths(plan=self, rng=rng)

    @abstractmethod
    def span(self, n: int, rng: np.random.Generator) -> tuple[float, float]:
        """Return the end [s] and the rate [1/s] of the n-th span, from 1; each is asked for once, in order."""


@dataclass(frozen=True, kw_only=True)
class VariableRelease(PiecewiseRelease):
    """A rate that is drawn again every `interval_s`, uniform from 0 to `filaments_per_s`: half of it in the mean.

    Source: GADEN's variable rate, which draws for each step of its own; here the interval is a parameter.
    """

    filaments_per_s: float
    interval_s: float = 1.0

    def span(self, n: int, rng: np.random.Generator) -> tuple[float, float]:
        """Draw a rate for each interval."""
        return n * self.interval_s, self.filaments_per_s * float(rng.random())


@dataclass(frozen=True, kw_only=True)
class IntermittentRelease(PiecewiseRelease):
    """Releases for `on_s` and pauses for `off_s`, over and over, beginning with a release."""

    filaments_per_s: float
    on_s: float
    off_s: float

    def span(self, n: int, rng: np.random.Generator) -> tuple[float, float]:
        """Return releases and pauses in turn."""
        i, is_pause = divmod(n - 1, 2)
        period_s = self.on_s + self.off_s
        return ((i + 1) * period_s, 0.0) if is_pause else (i * period_s + self.on_s, self.filaments_per_s)


@dataclass(frozen=True, kw_only=True)
class ScheduledRelease(PiecewiseRelease):
    """A rate that changes at given times: `schedule` holds (time_s, filaments_per_s), ascending; 0 before the first."""

    schedule: tuple[tuple[float, float], ...]

    def span(self, n: int, rng: np.random.Generator) -> tuple[float, float]:
        """Return the span before the n-th time; the last one has no end."""
        end_s = self.schedule[n - 1][0] if n <= len(self.schedule) else math.inf
        return end_s, self.schedule[n - 2][1] if n > 1 else 0.0


@dataclass(kw_only=True)
class _PoissonBirths:
    # `next_s` is the next birth; drawn one after the other, so the cutting into steps changes no draw.
    filaments_per_s: float
    rng: np.random.Generator
    next_s: float = field(init=False)

    def __post_init__(self) -> None:
        self.next_s = self._draw_gap_s()

    def births_s(self, start_s: float, end_s: float) -> list[float]:
        del start_s
        births: list[float] = []
        while self.next_s <= end_s:
            births.append(self.next_s)
            self.next_s += self._draw_gap_s()
        return births

    def _draw_gap_s(self) -> float:
        return -elementary.log1p(-self.rng.random()) / self.filaments_per_s


@dataclass(kw_only=True)
class _PiecewiseBirths:
    # Births where the integral of a piecewise constant rate passes 1, 2, …; `begin_s` and `expected` are time and
    # integral at the begin of the current span, the `n_spans`-th. No generator, so that a snapshot can hold it.
    plan: PiecewiseRelease
    rng: np.random.Generator
    n_spans: int = 0
    begin_s: float = 0.0
    expected: float = 0.0
    n_born: int = 0
    end_s: float = 0.0
    rate: float = 0.0

    def births_s(self, start_s: float, end_s: float) -> list[float]:
        del start_s
        births: list[float] = []
        while True:
            until_s = min(end_s, self.end_s)
            n_due = int(self.expected + self.rate * (until_s - self.begin_s) + _ROUNDING)
            numbers = range(self.n_born + 1, n_due + 1)
            births += [min(self.begin_s + max(j - self.expected, 0.0) / self.rate, until_s) for j in numbers]
            self.n_born = max(self.n_born, n_due)
            if self.end_s >= end_s:
                return births
            self.expected += self.rate * (self.end_s - self.begin_s)
            self.begin_s = self.end_s
            self.n_spans += 1
            self.end_s, self.rate = self.plan.span(self.n_spans, self.rng)


@dataclass(frozen=True, kw_only=True)
class SourceShape:
    """The extent of a source about its position.

    `size_m` is the edges of the box, the vector from one end of the line to the other, or the edges of the box
    around the sphere or the upright cylinder, which may be an ellipsoid or have an elliptic base. A point has none.
    """

    kind: ShapeKind = "point"
    size_m: Vec3 = (0.0, 0.0, 0.0)

    def offsets_m(self, uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n, 3) offsets from the source's position [m], world axes.

        Args:
            uniforms: (n, 3) numbers from 0 to 1, three for each filament.
        """
        return _UNIT_OFFSETS[self.kind](uniforms) * np.array(self.size_m)


POINT = SourceShape()


def _in_point(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros_like(uniforms)


def _in_box(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    return uniforms - 0.5


def _on_line(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.repeat(uniforms[:, :1] - 0.5, 3, axis=1)


# Of diameter 1: the radius grows as the cube root of the enclosed volume.
def _in_sphere(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    radius = 0.5 * elementary.cbrt_each(uniforms[:, 0])
    height = 2.0 * uniforms[:, 1] - 1.0
    across = np.sqrt(np.maximum(0.0, 1.0 - height * height))
    angle = 2.0 * np.pi * uniforms[:, 2]
    return radius[:, None] * np.stack(
        [across * elementary.cos_each(angle), across * elementary.sin_each(angle), height], axis=1
    )


# Of diameter and height 1: the radius grows as the square root of the enclosed area.
def _in_cylinder(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    radius = 0.5 * np.sqrt(uniforms[:, 0])
    angle = 2.0 * np.pi * uniforms[:, 1]
    return np.stack(
        [radius * elementary.cos_each(angle), radius * elementary.sin_each(angle), uniforms[:, 2] - 0.5], axis=1
    )


_UNIT_OFFSETS = {
    "point": _in_point,
    "box": _in_box,
    "line": _on_line,
    "sphere": _in_sphere,
    "cylinder": _in_cylinder,
}


@dataclass(frozen=True, kw_only=True)
class SourceChange:
    """Change of a source from the next step on; absent fields stay as they are.

    `share` is the rate as a fraction of the initial one; it is for releases without a schedule.
    """

    position_world_m: Vec3 | None = None
    is_open: bool | None = None
    share: float | None = None


@dataclass
class SourceValve:
    """Valve of one source: lets its births pass, at a changed rate if wanted.

    A closed valve drops the births; the release goes on behind it. With a share s the release's own time runs s times
    as fast: dw/dt = s, so a Poisson process stays one, with s times the rate, and nothing is drawn twice.
    """

    is_open: bool = True
    share: float = 1.0
    own_time_s: float | None = None

    def change(self, change: SourceChange, now_s: float) -> None:
        """Apply a change from now [s since the start of the plume] on."""
        if change.is_open is not None:
            self.is_open = change.is_open
        if change.share is not None:
            self.own_time_s = now_s if self.own_time_s is None else self.own_time_s
            self.share = change.share

    def births_s(self, births: BirthSequence, start_s: float, end_s: float) -> list[float]:
        """Return the times of birth [s] of a release after `start_s` and up to `end_s`, as far as they pass."""
        if self.own_time_s is None:
            born_s = births.births_s(start_s, end_s)
        else:
            own_start_s = self.own_time_s
            self.own_time_s = own_start_s + self.share * (end_s - start_s)
            own_s = births.births_s(own_start_s, self.own_time_s)
            born_s = [min(start_s + (each_s - own_start_s) / self.share, end_s) for each_s in own_s]
        return born_s if self.is_open else []
