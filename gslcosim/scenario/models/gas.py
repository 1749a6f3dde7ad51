"""The gas of a scenario: sources, dispersion, and the choices of models; every field with unit, default and range."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from gslcosim.quantities import Vec3
from gslcosim.scenario.models.one_of import KindedSpec
from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Name, NonNegative, Positive, Spec, shown

# The gases that there are; the table with their figures is in gslcosim.fields.
GASES = (
    "ethanol", "methane", "hydrogen", "propanol", "chlorine", "fluorine", "acetone", "neon", "helium", "biogas",
    "butane", "carbon_dioxide", "carbon_monoxide", "smoke",
)  # fmt: skip


# Models that move filaments, and those that have a formula for the plume.
_OF_FILAMENTS = ("filament", "farrell")
_OF_PLUMES = ("gaussian_plume", "meandering_plume")


class ReleaseSpec(KindedSpec):
    """When filaments are born.

    `constant` evenly, `poisson` independently of each other; `variable` draws a rate from 0 to `filaments_per_s` anew
    every `interval_s`; `intermittent` releases for `on_s` and pauses for `off_s`; `scheduled` changes the rate as
    `schedule` says: pairs of time [s since the start of the warm-up] and filaments per second, times ascending.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "interval_s": ("variable",),
        "on_s": ("intermittent",),
        "off_s": ("intermittent",),
        "schedule": ("scheduled",),
    }

    kind: Literal["constant", "poisson", "variable", "intermittent", "scheduled"] = "constant"
    interval_s: Positive = 1.0
    on_s: Positive = 10.0
    off_s: Positive = 10.0
    schedule: tuple[tuple[NonNegative, NonNegative], ...] = ()

    @model_validator(mode="after")
    def _check_schedule(self) -> Self:
        times_s = [time_s for time_s, _ in self.schedule]
        is_ascending = all(before < after for before, after in pairwise(times_s))
        if not is_ascending or (self.kind == "scheduled") != bool(self.schedule):
            raise broken_rule(
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

    kind: Literal["point", "box", "line", "sphere", "cylinder"] = "point"
    size_m: Vec3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        is_negative = self.kind != "line" and min(self.size_m) < 0
        if self.kind != "point" and (is_negative or not any(self.size_m)):
            raise broken_rule(
                key="size_m",
                expected="a vector that is not zero" if self.kind == "line" else "three edges, none negative",
                found=shown(self.size_m),
                remedy="For example shape: {kind: box, size_m: [1, 1, 0.5]}.",
            )
        return self


class SourceSpec(Spec):
    """A source of gas. `ppm` and `sigma_m` are a filament's centre mixing ratio and size at birth.

    `gas` is this source's gas where it differs from the one that is searched for.
    """

    position_m: Vec3
    filaments_per_s: Positive = 10.0
    ppm: Positive = 10.0
    sigma_m: Positive = 0.1
    gas: str | None = None
    shape: ShapeSpec = ShapeSpec()
    release: ReleaseSpec = ReleaseSpec()


class PowerLawSpec(Spec):
    """How a MOX sensor responds to a gas: Rs/R0 = a c^b, c in ppm; `b` is negative, as resistance falls with gas."""

    sensor: str
    a: Positive
    b: Annotated[float, Field(le=0)]


class GasDefinition(Spec):
    """A gas that gslcosim does not know by itself.

    `specific_gravity` is its density relative to air; `mox` gives the response of MOX sensors, which otherwise do not
    notice it; `pid_correction` is its correction factor at 11.7 eV (absent: not ionised).
    """

    name: Name
    specific_gravity: Positive
    mox: tuple[PowerLawSpec, ...] = ()
    pid_correction: Positive | None = None


class PlumeSpec(Spec):
    """Settings of `gaussian_plume` and `meandering_plume`.

    `stability` is Pasquill's class; `wind_m_s` is the even wind (absent: the room's at the first source); `has_ground`
    mirrors the plume at z = 0. A meandering plume is `instantaneous_frac` as wide as the mean one at any moment, and
    moves about within it with the correlation time `meander_s`.
    """

    stability: Literal["A", "B", "C", "D", "E", "F"] = "D"
    wind_m_s: Vec3 | None = None
    has_ground: bool = True
    instantaneous_frac: Annotated[float, Field(gt=0, le=1)] = 0.5
    meander_s: Positive = 20.0


class FarrellSpec(Spec):
    """Settings of Farrell's open field: a horizontal wind that gusts at the corners stir, over `n_nodes` a side.

    `wind_m_s` is the mean wind (absent: the room's at the first source); gusts at the corners have the standard
    deviation `gust_std_m_s`, the period `gust_period_s` and the damping ratio `gust_damping`; `eddy_viscosity_m2_s`
    spreads them through the field.
    """

    wind_m_s: Vec3 | None = None
    gust_std_m_s: NonNegative = 0.5
    gust_period_s: Positive = 30.0
    gust_damping: Annotated[float, Field(gt=0, lt=1)] = 0.1
    eddy_viscosity_m2_s: NonNegative = 10.0
    n_nodes: Annotated[int, Field(ge=3, le=200)] = 21


class PlaybackSpec(Spec):
    """Stored gas: a `folder` of frames of GADEN, GSL-Bench or AutoGDM+, or a movie (`.npz`).

    `period_s` is the time between frames (absent: 1 s for GSL-Bench, 0.5 s for GADEN; a movie has times of its own);
    with `loop` time begins anew after the last frame, otherwise the last one stays.
    """

    folder: str
    period_s: Positive | None = None
    loop: bool = False


class GasSpec(KindedSpec):
    """The gas and its dispersion.

    `gas` is the one to search for. `model` is `filament`, or without filaments `gaussian_plume` and `meandering_plume`
    (see `plume`), or `farrell` (filaments in an open field), or `playback`.
    Growth sigma^2 = sigma0^2 + growth_m2_s * age; random walk with eddy diffusivity per axis; `step_s` is the model's
    own time step; `warm_up_s` the plume's age when the run starts. `buoyancy` lets light gases rise and heavy ones
    sink. `compatibility` repeats GADEN's noise, cut-off and buoyancy, with `gaden_noise_std_m` in place of the eddy
    diffusivity. `seed` replaces the run's for the gas alone, so that runs can share it; `tape` computes the gas once
    and keeps it for all runs that have the same. `rotor_downwash` lets rotors blow filaments away.
    """

    tag_key: ClassVar[str] = "model"
    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **dict.fromkeys(("growth_m2_s", "eddy_diffusivity_m2_s", "buoyancy", "compatibility"), _OF_FILAMENTS),
        "gaden_noise_std_m": _OF_FILAMENTS,
        "plume": _OF_PLUMES,
        "plume.instantaneous_frac": ("meandering_plume",),
        "plume.meander_s": ("meandering_plume",),
        "farrell": ("farrell",),
        "playback": ("playback",),
    }

    model: Literal["filament", "gaussian_plume", "meandering_plume", "farrell", "playback"] = "filament"
    gas: str = "ethanol"
    sources: Annotated[tuple[SourceSpec, ...], Field(min_length=1)]
    growth_m2_s: NonNegative = 0.001
    eddy_diffusivity_m2_s: NonNegative = 0.002
    step_s: Positive = 0.1
    warm_up_s: NonNegative = 150.0
    buoyancy: Literal["terminal_velocity", "none"] = "terminal_velocity"
    compatibility: Literal["none", "gaden_2", "gaden_3"] = "none"
    gaden_noise_std_m: NonNegative = 0.02
    define: tuple[GasDefinition, ...] = ()
    plume: PlumeSpec = PlumeSpec()
    farrell: FarrellSpec = FarrellSpec()
    playback: PlaybackSpec | None = None
    seed: Annotated[int, Field(ge=0, le=2**31)] | None = None
    tape: bool = False
    rotor_downwash: bool = False

    def useless_keys(self) -> dict[str, str]:
        """Return the keys that mean nothing with this model and compatibility, each with where it belongs."""
        if self.compatibility == "none":
            return {"gaden_noise_std_m": "compatibility: gaden_2, gaden_3", **super().useless_keys()}
        ours = dict.fromkeys(("eddy_diffusivity_m2_s", "buoyancy"), "compatibility: none")
        return {**ours, **super().useless_keys()}

    @model_validator(mode="after")
    def _check_sources(self) -> Self:
        for i, source in enumerate(self.sources):
            useless = {
                "shape": source.shape.kind != "point" and self.model not in _OF_FILAMENTS,
                "release": source.release.kind != "constant" and self.model == "playback",
            }
            for key in (key for key, is_useless in useless.items() if is_useless):
                raise broken_rule(
                    key=f"sources[{i}].{key}",
                    expected=f"no {key} with model: {self.model}",
                    found=getattr(source, key).kind,
                    remedy="Leave it out, or take model: filament.",
                )
        return self

    @model_validator(mode="after")
    def _check_playback(self) -> Self:
        if self.playback is None and self.model == "playback":
            raise broken_rule(
                key="playback",
                expected="a folder of frames with model: playback",
                found="none",
                remedy="For example model: playback, playback: {folder: my_frames}.",
            )
        return self

    @model_validator(mode="after")
    def _check_kept_gas(self) -> Self:
        if self.tape and (self.model != "filament" or self.rotor_downwash):
            raise broken_rule(
                key="tape",
                expected="false, unless the gas is made of filaments that no vehicle moves",
                found="true with rotor_downwash" if self.rotor_downwash else f"true with model: {self.model}",
                remedy="Leave tape out.",
            )
        if self.rotor_downwash and self.model not in ("filament", "farrell"):
            raise broken_rule(
                key="rotor_downwash",
                expected="false with a model without filaments of its own",
                found=f"true with model: {self.model}",
                remedy="Leave it out, or take model: filament.",
            )
        return self

    def gas_names(self) -> tuple[str, ...]:
        """Return the names of the gases that there are: gslcosim's and those defined here."""
        return (*GASES, *(gas.name for gas in self.define))
