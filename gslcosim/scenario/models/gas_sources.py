"""Sources of a scenario's gas, and gases that gslcosim does not know by itself."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import Name, NonNegative, Positive, Spec, broken_rule_error, format_point
from gslcosim.scenario.models.one_of import KindedSpec


class ReleaseSpec(KindedSpec):
    """Times at which filaments are born.

    `constant` evenly, `poisson` independently of each other; `variable` draws a rate from 0 to `filaments_per_s` again
    every `interval_s`; `intermittent` releases for `on_s` and pauses for `off_s`; `scheduled` changes the rate as
    `schedule` says: pairs of time [s since the start of the warm-up] and filaments per second, times ascending.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "interval_s": ("variable",),
        "on_s": ("intermittent",),
        "off_s": ("intermittent",),
        "schedule": ("scheduled",),
    }

    kind: Literal["constant", "poisson", "variable", "intermittent", "scheduled"] = Field(
        default="constant", description="when filaments are born"
    )
    interval_s: Positive = Field(default=1.0, description="time between new rates")
    on_s: Positive = Field(default=10.0, description="time of release")
    off_s: Positive = Field(default=10.0, description="pause between releases")
    schedule: tuple[tuple[NonNegative, NonNegative], ...] = Field(
        default=(), description="pairs of time since the start of the warm-up and filaments per second"
    )

    @model_validator(mode="after")
    def _check_schedule(self) -> Self:
        times_s = [time_s for time_s, _ in self.schedule]
        is_ascending = all(before < after for before, after in pairwise(times_s))
        if not is_ascending or (self.kind == "scheduled") != bool(self.schedule):
            raise broken_rule_error(
                key="schedule",
                expected="pairs of time and rate with ascending times",
                found=f"times {', '.join(f'{time_s:g}' for time_s in times_s) or 'none'}",
                remedy="For example release: {kind: scheduled, schedule: [[0, 10], [60, 0]]}.",
            )
        return self


class ShapeSpec(KindedSpec):
    """The extent of a source about its position.

    `size_m` is a box's edges, a line's vector from end to end, or the edges of the box around a sphere or an upright
    cylinder; a point has none.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {"size_m": ("box", "line", "sphere", "cylinder")}

    kind: Literal["point", "box", "line", "sphere", "cylinder"] = Field(default="point", description="its form")
    size_m: Vec3 = Field(default=(0.0, 0.0, 0.0), description="edges, or a line's vector from end to end")

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        is_negative = self.kind != "line" and min(self.size_m) < 0
        if self.kind != "point" and (is_negative or not any(self.size_m)):
            raise broken_rule_error(
                key="size_m",
                expected="a vector that is not zero" if self.kind == "line" else "three edges, none negative",
                found=format_point(self.size_m),
                remedy="For example shape: {kind: box, size_m: [1, 1, 0.5]}.",
            )
        return self


class SourceSpec(Spec):
    """A source of gas. `ppm` and `sigma_m` are a filament's centre mixing ratio and size at birth.

    `gas` is this source's gas where it differs from the one that is searched for.
    """

    position_m: Vec3 = Field(description="its place in the world; random: drawn by the seed in free air")
    filaments_per_s: Positive = Field(default=10.0, description="mean rate of release")
    ppm: Positive = Field(default=10.0, description="mixing ratio at the centre of a filament at birth")
    sigma_m: Positive = Field(default=0.1, description="size of a filament at birth")
    gas: str | None = Field(default=None, description="its gas (absent: the one that is searched for)")
    shape: ShapeSpec = Field(default=ShapeSpec(), description="its extent")
    release: ReleaseSpec = Field(default=ReleaseSpec(), description="when filaments are born")


class PowerLawSpec(Spec):
    """Response of a MOX sensor to a gas: Rs/R0 = a c^b, c in ppm; `b` is negative, as resistance falls with gas."""

    sensor: str = Field(description="the model of the sensor")
    a: Positive = Field(description="factor of Rs/R0 = a c^b, c in ppm")
    b: Annotated[float, Field(le=0)] = Field(description="exponent")


class GasDefinition(Spec):
    """A gas that gslcosim does not know by itself.

    `specific_gravity` is its density relative to air; `mox` gives the response of MOX sensors, which otherwise do not
    notice it; `pid_correction` is its correction factor at 11.7 eV (absent: not ionised).
    """

    name: Name = Field(description="what the gas is called")
    specific_gravity: Positive = Field(description="density relative to air")
    mox: tuple[PowerLawSpec, ...] = Field(default=(), description="response of MOX sensors (absent: none)")
    pid_correction: Positive | None = Field(
        default=None, description="correction factor at 11.7 eV (absent: not ionised)"
    )
