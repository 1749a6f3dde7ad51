"""Wind of a scenario: its origin and its solver.

The blocks cover Tables 9.2, 9.3 and 9.5 of the GSL-Bench thesis: `inlet_velocity_m_s` is inlet_vel, `cell_m` the cells
of the mesh, `end_time_s` its end time, `save_every_s` writeInterval, `save_from_s` timeRange, `average_from_s: null`
with `end_time_s` latestTime, `courant` maxCo, `max_step_s` maxDeltaT.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import Field, SerializeAsAny, model_validator

from gslcosim.base.gases import GASES
from gslcosim.base.plugins import EntryPoints
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import KindedSpec, NonNegative, OneOf, Positive, Spec

# Entry points of other packages' solvers; each is a class that derives from `SolverSpec`.
WIND_ENTRY_POINTS = "gslcosim.wind_solvers"
Solver = Literal["auto", "built_in", "openfoam", "uniform", "stored"]
# Solvers that compute a flow; the others take their wind from elsewhere.
SOLVING = ("auto", "built_in", "openfoam")
# Turbulence models of the built-in solver with k and epsilon.
WITH_K_EPSILON = ("k_epsilon", "rng_k_epsilon")
_OURS = ("auto", "built_in")
_FRAMES = "frames, which save_every_s keeps"
_OFFERS = EntryPoints(group=WIND_ENTRY_POINTS, what="wind solver")


class InletScheduleSpec(Spec):
    """Schedule of the wind at all inlets: its fraction at some times of the solve [s], linear in between.

    With `repeats`, it restarts after the last time, whose fraction should equal the first; otherwise it holds the last.
    """

    times_s: Annotated[tuple[NonNegative, ...], Field(min_length=2)] = Field(description="times of the factors")
    shares: Annotated[tuple[float, ...], Field(min_length=2)] = Field(
        description="fraction of `inlet_velocity_m_s` at each time"
    )
    repeats: bool = Field(default=False, description="restart after the last time")

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if len(self.shares) != len(self.times_s):
            raise broken_rule_error(
                key="shares",
                expected=f"as many shares as times, {len(self.times_s)}",
                found=str(len(self.shares)),
                remedy="Each time has its share of inlet_velocity_m_s.",
            )
        if self.times_s[0] != 0 or any(b <= a for a, b in zip(self.times_s, self.times_s[1:], strict=False)):
            raise broken_rule_error(
                key="times_s",
                expected="times from 0 on, each later than the one before",
                found=str(list(self.times_s)),
                remedy="For example times_s: [0, 10, 20].",
            )
        return self


class BuoyantReleaseSpec(Spec):
    """Release of a buoyant gas in the air of the room.

    With `opening_m2`, the area of a round opening that points upwards, gas rises as a plume narrower than cells.
    """

    position_m: Vec3 = Field(description="position in the world")
    flow_m3_s: Positive = Field(description="volume flow of the gas")
    opening_m2: Positive | None = Field(default=None, description="area of the opening (absent: spread over a cell)")


class OrificeSpec(Spec):
    """Hole to still air outside, smaller than a cell; it holds with `buoyancy.orifices` for all openings."""

    centre_m: Vec3 = Field(description="centre of the hole, in the world, in the cell behind it")
    height_m: Positive = Field(description="height of the hole")
    area_m2: Positive = Field(description="area of the hole")


class BuoyancySpec(Spec):
    """Gas that the wind carries while it is solved, and that drives it; heat is `environment.heat`.

    With `orifices`, the room has no other openings: its inlets and outlets are walls. Sensors and searches still
    concern the gas of `gas:`, which moves in this wind.
    """

    density_kg_m3: Annotated[float, Field(gt=0, lt=100)] = Field(
        default=GASES["helium"].density_kg_m3,
        description="density of the pure gas; "
        + ", ".join(f"{name} {GASES[name].density_kg_m3:g}" for name in ("helium", "hydrogen", "methane")),
    )
    diffusivity_m2_s: Positive = Field(
        default=GASES["helium"].diffusivity_m2_s, description="molecular diffusivity of the gas"
    )
    releases: Annotated[tuple[BuoyantReleaseSpec, ...], Field(min_length=1)] = Field(description="sources of it")
    orifices: tuple[OrificeSpec, ...] = Field(default=(), description="holes smaller than a cell")


class SolverSpec(KindedSpec):
    """Base of all wind solvers; the block of a solver adds the settings of that solver alone.

    A package's block derives from this class, and narrows `solver` to its name.
    """

    tag_key: ClassVar[str] = "solver"

    solver: Any = Field(description="wind model")
    inlet_velocity_m_s: Vec3 = Field(default=(1.0, 0.0, 0.0), description="wind through the inlets")
    cell_m: Positive = Field(default=0.2, description="cell size of room and wind")

    @property
    def kind_name(self) -> str:
        """The name of the solver."""
        return str(self.solver)

    @property
    def solves(self) -> bool:
        """True if a flow is computed that has to enter through the inlets and leave through the outlets."""
        return False

    @property
    def file(self) -> str | None:
        """File or folder of the wind, if it has one."""
        return None


class WindSpec(SolverSpec):
    """Wind of the room.

    - `built_in` and `openfoam` solve the flow. `uniform` is `inlet_velocity_m_s` everywhere.
    - `stored` is the wind of an imported environment. `{file: PATH}` reads wind of another program.
    - `auto` is the wind of the imported environment if it has one, otherwise `built_in`.
    - A solve starts from still air; without `end_time_s`, halls start from a flow developed on cells of twice the size.
    - Without `end_time_s`, a solve runs until the statistics settle, at most `max_time_s`; the wind is the mean of the
      settled part.
    - With `end_time_s`, the wind is the mean from `average_from_s` on, or the last instant.
    - With `save_every_s`, the wind changes in the run: its frames start at `save_from_s` and repeat with `loops`.
    - `inlet_profile: parabolic` is the profile of a channel with the mean `inlet_velocity_m_s`.
    - `period_s` is the time between frames of stored wind.
    - With `buoyancy`, a gas drives the wind of the built-in solver; with `environment.heat`, heat does. A solve without
      `end_time_s` then goes on beyond `max_time_s` where the air turns over slowly.
    """

    belongs: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **dict.fromkeys(("inlet_profile", "inlet_schedule", "turbulence", "courant", "end_time_s"), SOLVING),
        **dict.fromkeys(("average_from_s", "save_every_s"), SOLVING),
        **dict.fromkeys(("max_step_s", "max_time_s", "save_from_s", "keep_turbulence", "buoyancy"), _OURS),
        "loops": (*_OURS, "stored", "file"),
        "period_s": ("auto", "stored", "file"),
    }

    solver: Solver | dict[Literal["file"], str] = Field(default="auto", description="wind model")
    inlet_profile: Literal["uniform", "parabolic"] = Field(
        default="uniform", description="profile of the wind over an inlet"
    )
    inlet_schedule: InletScheduleSpec | None = Field(
        default=None, description="change of the wind at all inlets over time (absent: constant)"
    )
    turbulence: Literal["k_epsilon", "rng_k_epsilon", "smagorinsky", "laminar"] = Field(
        default="k_epsilon", description="turbulence model"
    )
    keep_turbulence: bool = Field(
        default=False, description="k and epsilon are kept with the wind, for gas with `turbulence: {kind: wind}`"
    )
    courant: Annotated[float, Field(gt=0, le=1)] = Field(default=0.9, description="Courant number of a step")
    max_step_s: Positive | None = Field(default=None, description="maximum step (absent: set by `courant`)")
    end_time_s: Positive | None = Field(
        default=None, description="end of the solve (absent: when the statistics have settled)"
    )
    average_from_s: NonNegative | None = Field(
        default=None, description="start of the mean (absent, with `end_time_s`: the last instant)"
    )
    max_time_s: Positive = Field(default=120.0, description="latest end of a solve without `end_time_s`")
    save_every_s: Positive | None = Field(
        default=None, description="time between frames of a wind that changes (absent: one steady wind)"
    )
    save_from_s: NonNegative = Field(default=0.0, description="time of the first frame")
    loops: bool = Field(default=True, description="restart at the first frame after the last one")
    buoyancy: BuoyancySpec | None = Field(default=None, description="gas that drives the wind (absent: none)")
    period_s: Positive | None = Field(
        default=None, description="time between stored frames (absent: from the files, else 1 s)"
    )

    @property
    def kind_name(self) -> str:
        """Name of the solver; `file` for wind from a file."""
        return self.solver if isinstance(self.solver, str) else "file"

    def useless_keys(self) -> dict[str, str]:
        """Return the keys without a meaning with this solver, or beside the other keys, each with its home."""
        useless: dict[str, str] = {}
        if self.save_every_s is None:
            useless = dict.fromkeys(
                ("save_from_s", "loops") if self.solver == "built_in" else ("save_from_s",), _FRAMES
            )
        if self.end_time_s is not None:
            useless["max_time_s"] = "a wind that goes on until it has settled, without end_time_s"
        # Dumps of a wind without buoyancy stay as they were before this key existed.
        if self.buoyancy is None:
            useless["buoyancy"] = "a wind that gas drives"
        return {**useless, **super().useless_keys()}

    @property
    def solves(self) -> bool:
        """True if a flow is computed when the environment has no wind of its own."""
        return self.solver in SOLVING

    @property
    def file(self) -> str | None:
        """File or folder of the wind, if it has one."""
        return self.solver.get("file") if isinstance(self.solver, dict) else None

    @model_validator(mode="after")
    def _check_solver(self) -> Self:
        if isinstance(self.solver, dict) and self.file is None:
            raise broken_rule_error(
                key="solver",
                expected="auto, built_in, openfoam, uniform, stored or {file: PATH}",
                found="an empty block",
                remedy="For example solver: {file: wind.csv}.",
            )
        return self

    @model_validator(mode="after")
    def _check_turbulence(self) -> Self:
        if self.keep_turbulence and self.turbulence not in WITH_K_EPSILON:
            raise broken_rule_error(
                key="keep_turbulence",
                expected="false, unless turbulence is k_epsilon or rng_k_epsilon",
                found=f"true with {self.turbulence}",
                remedy="Leave keep_turbulence out; the other models have no k and epsilon.",
            )
        return self

    @model_validator(mode="after")
    def _check_openfoam(self) -> Self:
        if self.solver == "openfoam" and (self.end_time_s is None or self.save_every_s is not None):
            raise broken_rule_error(
                key="end_time_s" if self.end_time_s is None else "save_every_s",
                expected="a time with solver: openfoam" if self.end_time_s is None else "no frames of openfoam",
                found="none" if self.end_time_s is None else f"{self.save_every_s:g}",
                remedy="Only the built-in solver waits until the statistics have settled, and keeps frames.",
            )
        return self

    @model_validator(mode="after")
    def _check_average(self) -> Self:
        if self.average_from_s is None or not self.solves:
            return self
        if self.end_time_s is None:
            raise broken_rule_error(
                key="average_from_s",
                expected="an end_time_s beside it",
                found=f"{self.average_from_s:g} alone",
                remedy="Without end_time_s the wind is the mean of the part that has settled.",
            )
        if self.average_from_s >= self.end_time_s:
            raise broken_rule_error(
                key="average_from_s",
                expected=f"less than end_time_s, {self.end_time_s:g}",
                found=f"{self.average_from_s:g}",
                remedy=f"For example {self.end_time_s / 2:g}, or leave it out for the wind at the end of the solve.",
            )
        return self

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        if self.save_every_s is None:
            return self
        if self.average_from_s is not None:
            raise broken_rule_error(
                key="save_every_s",
                expected="no average_from_s beside it",
                found="both",
                remedy="Frames show the wind as it changes; a mean does not change.",
            )
        if self.end_time_s is None or self.save_from_s + self.save_every_s > self.end_time_s:
            end = "none" if self.end_time_s is None else f"{self.end_time_s:g}"
            raise broken_rule_error(
                key="end_time_s",
                expected=f"at least save_from_s and save_every_s together, {self.save_from_s + self.save_every_s:g}",
                found=end,
                remedy="Give the time at which the solve ends.",
            )
        return self


WIND_SOLVERS: dict[str, type[SolverSpec]] = dict.fromkeys((*get_args(Solver), "file"), WindSpec)
"""Block of gslcosim's own wind solvers; they share one, since `auto` stands for one or another of them."""

WIND_KINDS = OneOf(
    tag_key="solver",
    base=SolverSpec,
    own=WIND_SOLVERS,
    offers=_OFFERS,
    default="auto",
    form=("file", "{file: PATH}"),
    descriptions={
        "auto": "The wind that an imported environment brings, otherwise built_in.",
        "built_in": "gslcosim's own flow solver.",
        "openfoam": "OpenFOAM, where it is installed.",
        "uniform": "`inlet_velocity_m_s` everywhere.",
        "stored": "The wind that an imported environment brings.",
        "file": "Wind from a file or folder of another program: `solver: {file: PATH}`.",
    },
)
# Selected by `solver`.
Wind = Annotated[SerializeAsAny[SolverSpec], WIND_KINDS]
