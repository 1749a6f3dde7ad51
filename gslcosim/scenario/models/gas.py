"""Gas of a scenario: gases, sources, dispersion, and choices of models; every field with unit, default, range."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, SerializeAsAny, model_validator

from gslcosim.base import gases
from gslcosim.base.box_rules import format_point
from gslcosim.base.plugins import EntryPoints
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import KindedSpec, Name, NonNegative, OneOf, Positive, Spec

EVEN_RELEASES = ("constant", "poisson")
"""Timings of releases whose rate can be changed during a run."""

# Entry points of other packages' models; each is a class that derives from `GasSpec`.
GAS_ENTRY_POINTS = "gslcosim.gas_models"


class ReleaseSpec(KindedSpec):
    """Timing of releases.

    - `constant`: evenly spaced. `poisson`: independent of each other.
    - `variable`: a new rate between 0 and `filaments_per_s` every `interval_s`.
    - `intermittent`: `on_s` of release, then `off_s` of pause.
    - `scheduled`: rates from `schedule`, pairs of ascending time [s from the start of the warm-up] and filaments per
      second.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "interval_s": ("variable",),
        "on_s": ("intermittent",),
        "off_s": ("intermittent",),
        "schedule": ("scheduled",),
    }

    kind: Literal["constant", "poisson", "variable", "intermittent", "scheduled"] = Field(
        default="constant", description="timing of releases"
    )
    interval_s: Positive = Field(default=1.0, description="time between changes of the rate")
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
    """Shape and size of a source around its position.

    `size_m` holds the edges of a box, the vector from end to end of a line, or the edges of the box around a sphere or
    an upright cylinder. A point has none.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {"size_m": ("box", "line", "sphere", "cylinder")}

    kind: Literal["point", "box", "line", "sphere", "cylinder"] = Field(
        default="point", description="shape of the source"
    )
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
    """Source of gas. `ppm` and `sigma_m` are the centre mixing ratio and the size of a new filament."""

    position_m: Vec3 = Field(description="position in the world; random: drawn from the seed in free air")
    filaments_per_s: Positive = Field(default=10.0, description="mean rate of release")
    ppm: Positive = Field(default=10.0, description="mixing ratio at the centre of a new filament")
    sigma_m: Positive = Field(default=0.1, description="standard deviation of a new filament")
    gas: str | None = Field(default=None, description="gas of the source (absent: the gas to find)")
    shape: ShapeSpec = Field(default=ShapeSpec(), description="shape and size")
    release: ReleaseSpec = Field(default=ReleaseSpec(), description="timing of releases")


class PowerLawSpec(Spec):
    """Response of a MOX sensor to a gas: Rs/R0 = a c^b, c in ppm; `b` is negative, as resistance falls with gas."""

    sensor: str = Field(description="model of the sensor")
    a: Positive = Field(description="factor of Rs/R0 = a c^b, c in ppm")
    b: Annotated[float, Field(le=0)] = Field(description="exponent")


class GasDefinition(Spec):
    """Gas that gslcosim does not include.

    MOX sensors respond only to gases with `mox`, photo-ionisation detectors only to gases with `pid_correction`, the
    correction factor of the lamp in use.
    """

    name: Name = Field(description="name of the gas")
    specific_gravity: Positive = Field(description="density relative to air")
    mox: tuple[PowerLawSpec, ...] = Field(default=(), description="response of MOX sensors (absent: none)")
    pid_correction: Positive | None = Field(
        default=None, description="correction factor of PIDs with the lamp that is flown (absent: not ionised)"
    )


def list_gases(definitions: tuple[GasDefinition, ...]) -> dict[str, gases.Gas]:
    """Return all gases by name: those of the table, and those that a scenario defines."""
    defined = {
        gas.name: gases.Gas(
            specific_gravity=gas.specific_gravity,
            pid={} if gas.pid_correction is None else dict.fromkeys(gases.PID_LAMPS_EV, gas.pid_correction),
            mox={law.sensor: (law.a, law.b) for law in gas.mox},
        )
        for gas in definitions
    }
    return {**gases.GASES, **defined}


class TurbulenceSpec(KindedSpec):
    """Turbulence that moves and spreads filaments, and that instruments sense.

    `none`: growth and random walk without memory. `wind`: its strength follows from the k and epsilon that the wind's
    solver keeps. `given`: the same everywhere, with `intensity_frac`, the standard deviation of the velocity along each
    axis over the mean wind's speed, and the integral length `length_m`, but no more than half of the distance between
    two walls, or the height of ground under an open sky; `validate` warns of longer ones. `inner_intensity` is standard
    deviation over mean of the gas within filaments as large as the eddies; small filaments have less, and in larger
    ones it fades.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **dict.fromkeys(("intensity_frac", "length_m"), ("given",)),
        "inner_intensity": ("given", "wind"),
    }

    kind: Literal["given", "wind", "none"] = Field(default="given", description="where its strength comes from")
    intensity_frac: Annotated[float, Field(gt=0, le=2)] = Field(
        default=0.15, description="fluctuation over mean wind speed, along each axis"
    )
    length_m: Positive = Field(default=2.0, description="integral length, about that of the largest eddies")
    inner_intensity: Annotated[float, Field(ge=0, le=3)] = Field(
        default=1.0, description="standard deviation over mean of gas within large filaments, before it fades"
    )


class GasSpec(KindedSpec):
    """Base of all gas models; the block of a model adds the settings of that model alone.

    A package's block derives from this class or from `FilamentsSpec`, and narrows `model` to its name. With
    `can_be_driven`, the gas follows a wind that a service changes.
    """

    tag_key: ClassVar[str] = "model"
    has_filaments: ClassVar[bool] = False
    has_releases: ClassVar[bool] = True
    can_be_taped: ClassVar[bool] = False
    can_be_driven: ClassVar[bool] = False

    model: str = Field(description="gas model")
    gas: str = Field(default="ethanol", description="gas to find")
    sources: Annotated[tuple[SourceSpec, ...], Field(min_length=1)] = Field(description="sources of gas")
    step_s: Positive = Field(default=0.1, description="time step of the model")
    warm_up_s: NonNegative = Field(default=150.0, description="age of the plume at the start of the run")
    define: tuple[GasDefinition, ...] = Field(default=(), description="additional gases")
    seed: Annotated[int, Field(ge=0, le=2**31)] | None = Field(
        default=None, description="seed of the gas alone, so that runs with different seeds can share it"
    )
    tape: bool = Field(default=False, description="compute the gas once and cache it for all runs with the same gas")
    rotor_downwash: bool = Field(default=False, description="let rotor downwash move filaments")

    @property
    def stored_folder(self) -> str | None:
        """Folder or file of the gas, if the model reads stored gas."""
        return None

    @property
    def searched(self) -> tuple[SourceSpec, ...]:
        """Sources of the gas to find; all of them where none releases it."""
        return tuple(source for source in self.sources if source.gas in (None, self.gas)) or self.sources

    @model_validator(mode="after")
    def _check_sources(self) -> Self:
        for i, source in enumerate(self.sources):
            useless = {
                "shape": source.shape.kind != "point" and not self.has_filaments,
                "release": source.release.kind != "constant" and not self.has_releases,
            }
            for key in (key for key, is_useless in useless.items() if is_useless):
                raise broken_rule_error(
                    key=f"sources[{i}].{key}",
                    expected=f"no {key} with model: {self.model}",
                    found=getattr(source, key).kind,
                    remedy="Leave it out, or take model: filament.",
                )
        return self

    @model_validator(mode="after")
    def _check_kept_gas(self) -> Self:
        if self.tape and (not self.can_be_taped or self.rotor_downwash):
            raise broken_rule_error(
                key="tape",
                expected="false, unless the gas is made of filaments that no vehicle moves",
                found="true with rotor_downwash" if self.rotor_downwash else f"true with model: {self.model}",
                remedy="Leave tape out.",
            )
        if self.rotor_downwash and not self.has_filaments:
            raise broken_rule_error(
                key="rotor_downwash",
                expected="false with a model without filaments of its own",
                found=f"true with model: {self.model}",
                remedy="Leave it out, or take model: filament.",
            )
        return self


class FilamentsSpec(GasSpec):
    """Base of gas models that move filaments.

    Growth sigma^2 = sigma0^2 + growth_m2_s * age; random walk with eddy diffusivity per axis. `turbulence` replaces
    both by eddies that all filaments share and that anemometers feel. `compatibility` repeats GADEN's noise, cut-off
    and buoyancy, with `gaden_noise_std_m` in place of the eddy diffusivity.
    """

    has_filaments: ClassVar[bool] = True
    is_in_open_air: ClassVar[bool] = False
    """Whether the air goes on beyond the room's sides and top, in a wind of the gas's own."""

    growth_m2_s: NonNegative = Field(default=0.001, description="growth of the variance of a filament")
    eddy_diffusivity_m2_s: NonNegative = Field(default=0.002, description="diffusivity of the random walk, per axis")
    buoyancy: Literal["terminal_velocity", "none"] = Field(
        default="terminal_velocity", description="buoyancy of light and heavy gases"
    )
    compatibility: Literal["none", "gaden_2", "gaden_3"] = Field(
        default="none", description="GADEN version whose noise, cut-off and buoyancy to reproduce"
    )
    gaden_noise_std_m: NonNegative = Field(
        default=0.02, description="noise per step, with `compatibility` in place of the eddy diffusivity"
    )
    wall_images: bool | None = Field(
        default=None,
        description="readings find gas that walls cut off filaments in the room (false: it is lost; absent: "
        "with turbulence)",
    )
    turbulence: TurbulenceSpec | None = Field(
        default=None,
        description="turbulence in place of growth and eddy diffusivity (absent: `wind` where the built-in solver "
        "solves with k and epsilon, `given` where a uniform wind blows; `none` elsewhere, with `compatibility`, and "
        "with settings of the random walk)",
    )

    @property
    def eddies(self) -> TurbulenceSpec | None:
        """Turbulence, if the gas has any."""
        return None if self.turbulence is None or self.turbulence.kind == "none" else self.turbulence

    def with_turbulence(self, kind: Literal["given", "wind"] | None) -> Self:
        """Return this gas with turbulence and images at walls chosen where they are absent.

        Args:
            kind: That of turbulence in the room's wind; absent: none.
        """
        walks = {"growth_m2_s", "eddy_diffusivity_m2_s"} & self.model_fields_set
        is_walk = self.compatibility != "none" or self.is_in_open_air or bool(walks)
        spec = self.turbulence or TurbulenceSpec(kind="none" if is_walk or kind is None else kind)
        images = spec.kind != "none" and not self.is_in_open_air if self.wall_images is None else self.wall_images
        return self.model_copy(update={"turbulence": spec, "wall_images": images})

    def useless_keys(self) -> dict[str, str]:
        """Return the keys without a meaning with this compatibility or turbulence, each with its home."""
        useless = dict(super().useless_keys())
        if self.compatibility == "none":
            useless["gaden_noise_std_m"] = "compatibility: gaden_2, gaden_3"
        else:
            useless |= dict.fromkeys(("eddy_diffusivity_m2_s", "buoyancy", "wall_images"), "compatibility: none")
            useless |= {"turbulence": "compatibility: none"} if self.eddies else {}
        if self.eddies is not None:
            useless |= dict.fromkeys(("eddy_diffusivity_m2_s", "growth_m2_s"), "gas without turbulence")
        return useless


class FilamentGasSpec(FilamentsSpec):
    """Filaments that the room's wind carries and its walls stop."""

    can_be_taped: ClassVar[bool] = True
    can_be_driven: ClassVar[bool] = True

    model: Literal["filament"] = Field(default="filament", description="gas model")  # pyright: ignore


GAS_MODELS: dict[str, type[GasSpec]] = {"filament": FilamentGasSpec}
"""The block of each of gslcosim's own gas models."""

GAS_KINDS = OneOf(
    tag_key="model",
    base=GasSpec,
    own=GAS_MODELS,
    offers=EntryPoints(group=GAS_ENTRY_POINTS, what="gas model"),
    default="filament",
)
# Selected by `model`; filaments by default.
Gas = Annotated[SerializeAsAny[GasSpec], GAS_KINDS]
