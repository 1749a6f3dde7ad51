"""The frozen models of a scenario file: every field with unit, default and range."""

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gslcosim.scenario.layout_models import BoxSpec as BoxSpec
from gslcosim.scenario.layout_models import Layout as Layout
from gslcosim.scenario.layout_models import LayoutSpec as LayoutSpec
from gslcosim.scenario.layout_models import OpeningSpec as OpeningSpec
from gslcosim.scenario.rules import broken_rule
from gslcosim.scenario.spec import Name, NonNegative, Positive, Vec3
from gslcosim.scenario.spec import Spec as Spec
from gslcosim.scenario.spec import shown as _shown

SCHEMA = "gslcosim/scenario/1"

# The gases and sensors that there are; the tables with their figures are in gslcosim.fields and gslcosim.sensing.
Gas = Literal[
    "ethanol", "methane", "hydrogen", "propanol", "chlorine", "fluorine", "acetone", "neon", "helium", "biogas",
    "butane", "carbon_dioxide", "carbon_monoxide", "smoke",
]  # fmt: skip
SensorModel = Literal[
    "tgs2600", "tgs2610", "tgs2611", "tgs2612", "tgs2620", "pid", "threshold", "binary", "hit_counter", "averaging",
    "second_order", "anemometer", "anemometer_3d",
]  # fmt: skip


class EnvironmentSpec(Spec):
    """Where the run takes place: a layout to generate, or the folder of an environment made before."""

    layout: Layout | None = None
    path: str | None = None

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        if (self.layout is None) == (self.path is None):
            raise broken_rule(
                expected="exactly one of layout and path",
                found="neither" if self.layout is None else "both",
                remedy="layout generates a room, path takes the folder of one made before.",
            )
        return self


class WindSpec(Spec):
    """The air's motion. `uniform` is `inlet_velocity_m_s` everywhere; `built_in` solves the flow.

    The solve runs from still air to `end_time_s`; with `average_from_s` the time mean from there on is the steady
    wind, otherwise the last instant is.
    """

    solver: Literal["built_in", "uniform"] = "built_in"
    inlet_velocity_m_s: Vec3 = (1.0, 0.0, 0.0)
    cell_m: Positive = 0.2
    end_time_s: Positive = 60.0
    average_from_s: NonNegative | None = 30.0

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.solver == "built_in" and self.average_from_s is not None and self.average_from_s >= self.end_time_s:
            is_default = "average_from_s" not in self.model_fields_set
            raise broken_rule(
                key="average_from_s",
                expected=f"less than end_time_s, {self.end_time_s:g}",
                found=f"{self.average_from_s:g}{' (the default)' if is_default else ''}",
                remedy=f"For example {self.end_time_s / 2:g}, or null for the wind at the end of the solve.",
            )
        return self


class ReleaseSpec(Spec):
    """When filaments are born.

    `constant` evenly, `poisson` independently of each other; `variable` draws a rate from 0 to `filaments_per_s` anew
    every `interval_s`; `intermittent` releases for `on_s` and pauses for `off_s`; `scheduled` changes the rate as
    `schedule` says: pairs of time [s since the start of the warm-up] and filaments per second, times ascending.
    """

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
                expected="pairs of time and rate with ascending times, with kind: scheduled and only then",
                found=f"times {', '.join(f'{time_s:g}' for time_s in times_s) or 'none'} with kind: {self.kind}",
                remedy="For example release: {kind: scheduled, schedule: [[0, 10], [60, 0]]}.",
            )
        return self


class ShapeSpec(Spec):
    """The extent of a source about its position.

    `size_m` is a box's edges, a line's vector from end to end, or the edges of the box around a sphere or an upright
    cylinder; a point has none.
    """

    kind: Literal["point", "box", "line", "sphere", "cylinder"] = "point"
    size_m: Vec3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        is_fitting = {
            "point": not any(self.size_m),
            "line": any(self.size_m),
        }.get(self.kind, min(self.size_m) >= 0 and any(self.size_m))
        if not is_fitting:
            raise broken_rule(
                key="size_m",
                expected={"point": "no size", "line": "a vector that is not zero"}.get(
                    self.kind, "three edges, none negative"
                ),
                found=_shown(self.size_m),
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
    gas: Gas | None = None
    shape: ShapeSpec = ShapeSpec()
    release: ReleaseSpec = ReleaseSpec()


class GasSpec(Spec):
    """The gas and its dispersion.

    `gas` is the one to search for. Growth sigma^2 = sigma0^2 + growth_m2_s * age; random walk with eddy diffusivity per
    axis; `step_s` is the filament model's own time step; `warm_up_s` the plume's age when the run starts.
    `buoyancy` lets light gases rise and heavy ones sink. `compatibility` repeats GADEN's noise, cut-off and buoyancy,
    with `gaden_noise_std_m` in place of the eddy diffusivity.
    """

    model: Literal["filament"] = "filament"
    gas: Gas = "ethanol"
    sources: Annotated[tuple[SourceSpec, ...], Field(min_length=1)]
    growth_m2_s: NonNegative = 0.001
    eddy_diffusivity_m2_s: NonNegative = 0.002
    step_s: Positive = 0.1
    warm_up_s: NonNegative = 150.0
    buoyancy: Literal["terminal_velocity", "none"] = "terminal_velocity"
    compatibility: Literal["none", "gaden_2", "gaden_3"] = "none"
    gaden_noise_std_m: NonNegative = 0.02


class StartSpec(Spec):
    """How an agent comes to life: a Python agent by name or file, a command line, or one that attaches itself.

    `door` is the way it joins: `zenoh`, or the gateway over `stdio`, `tcp` or `unix` in a `format` of frames.
    `observations: asked` sends through the gateway only those that await a command. A Python agent joins over zenoh.
    `process_of` names another agent whose process flies this one too, through that agent's door.
    """

    python: str | None = None
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    attach: bool = False
    door: Literal["zenoh", "stdio", "tcp", "unix"] = "zenoh"
    format: Literal["msgpack", "json"] = "msgpack"
    observations: Literal["all", "asked"] = "all"
    process_of: Name | None = None

    @property
    def is_behind_gateway(self) -> bool:
        """Whether the agent speaks frames with the supervisor instead of joining the bus."""
        return self.door != "zenoh"

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        given = [key for key in ("python", "command", "attach", "process_of") if getattr(self, key)]
        if len(given) != 1:
            raise broken_rule(
                expected="exactly one of python, command, attach: true and process_of",
                found=" and ".join(given) or "none",
                remedy="For example start: {python: dung_beetle}.",
            )
        return self

    @model_validator(mode="after")
    def _check_door(self) -> Self:
        if self.process_of is not None and self.is_behind_gateway:
            raise broken_rule(
                key="door",
                expected=f"no door beside process_of: {self.process_of}'s is taken",
                found=self.door,
                remedy=f"Give door, format and observations with {self.process_of}.",
            )
        if self.python is not None and self.is_behind_gateway:
            raise broken_rule(
                key="door",
                expected="zenoh, the door of Python agents",
                found=self.door,
                remedy="Leave out door, or start a program that speaks the gateway's frames with command.",
            )
        if self.attach and self.door == "stdio":
            raise broken_rule(
                key="door",
                expected="zenoh, tcp or unix for an agent that attaches itself",
                found=self.door,
                remedy="Standard input and output belong to a program that is started here, with command.",
            )
        return self

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        for key, default in (("format", "msgpack"), ("observations", "all")):
            if getattr(self, key) != default and not self.is_behind_gateway:
                raise broken_rule(
                    key=key,
                    expected=f"{default} with door: zenoh",
                    found=getattr(self, key),
                    remedy="Add door: stdio, tcp or unix to speak through the gateway.",
                )
        return self


class VehicleSpec(Spec):
    """The robot: model, start (on the ground), cruising height, limits and hold time at each waypoint."""

    model: Literal["iris", "crazyflie", "holonomic"] = "iris"
    start_m: Vec3
    search_height_m: Positive = 2.0
    hold_s: NonNegative = 2.0
    max_speed_m_s: Positive = 1.0
    max_acceleration_m_s2: Positive = 2.0


class SensorSpec(Spec):
    """A sensor on the vehicle; `mount_m` is its place in the body frame [m].

    Any sensor, in the unit of its readings: `period_s` between readings (absent: every tick), `delay_s`, `noise_std`,
    `bias`, `drift_per_s` added to the bias, `max_value` at which it saturates.
    Some only: `speed_noise_std_m_s`, `direction_noise_std_rad` of anemometers; `threshold_ppm` of threshold, binary;
    `hits_per_s_per_ppm` of hit_counter; `averaging_s` of averaging; the two time constants each of `response_s` and
    `recovery_s` of second_order.
    """

    model: SensorModel
    name: Name
    mount_m: Vec3 = (0.0, 0.0, 0.0)
    speed_noise_std_m_s: NonNegative = 0.01
    direction_noise_std_rad: NonNegative = 0.1
    period_s: Positive | None = None
    delay_s: NonNegative = 0.0
    noise_std: NonNegative = 0.0
    bias: float = 0.0
    drift_per_s: float = 0.0
    max_value: Positive | None = None
    threshold_ppm: NonNegative = 0.1
    hits_per_s_per_ppm: Positive = 1.0
    averaging_s: Positive = 1.0
    response_s: tuple[Positive, Positive] = (1.0, 2.0)
    recovery_s: tuple[Positive, Positive] = (2.0, 10.0)


class AgentSpec(Spec):
    """One agent with its vehicle and sensors.

    `mode` says when simulated time waits for it: `on_request` at its waypoints, `lockstep` every tick,
    `{latency: N}` N ticks after each observation.
    """

    name: Name
    start: StartSpec
    mode: Literal["on_request", "lockstep"] | dict[Literal["latency"], Annotated[int, Field(ge=1, le=1000)]] = (
        "on_request"
    )
    vehicle: VehicleSpec
    sensors: Annotated[tuple[SensorSpec, ...], Field(min_length=1)]
    answer_within_s: Positive = 30.0

    @property
    def latency_ticks(self) -> int:
        """Ticks between an observation and the effect of its command: N for `{latency: N}`, otherwise 1."""
        return self.mode["latency"] if isinstance(self.mode, dict) else 1

    @property
    def mode_name(self) -> Literal["on_request", "lockstep", "latency"]:
        """Return the mode without its number."""
        return "latency" if isinstance(self.mode, dict) else self.mode

    @property
    def process(self) -> str:
        """Return the name of the agent whose process flies this one: its own unless `process_of` names another."""
        return self.start.process_of or self.name

    @property
    def is_asked_every_tick(self) -> bool:
        """Whether every observation awaits a command."""
        return self.mode_name != "on_request"


class ChannelSpec(Spec):
    """A channel on which agents send each other texts.

    `members` are the agents that send and hear on it; `range_m` is how far it reaches, in a straight line whatever is
    between (absent: everywhere); `loss_frac` of the messages are lost, each for each receiver by itself; a message is
    heard `delay_ticks` after the observation that the sender answered with it (an agent with latency N sends N - 1
    ticks later); `max_bytes` bounds a text in UTF-8.
    """

    name: Name
    members: Literal["all"] | Annotated[tuple[Name, ...], Field(min_length=1)] = "all"
    range_m: Positive | None = None
    loss_frac: Annotated[float, Field(ge=0, le=1)] = 0.0
    delay_ticks: Annotated[int, Field(ge=1, le=1000)] = 1
    max_bytes: Annotated[int, Field(ge=1, le=65536)] = 1024


class SuccessSpec(Spec):
    """Success: the vehicle, or the agent's declaration, is within this distance of a source [m]."""

    within_m: Positive = 1.0
    of: Literal["source", "declaration"] = "source"


class StopSpec(Spec):
    """What ends a run besides success: simulated time [s], or a collision."""

    time_limit_s: Positive = 300.0
    on_collision: bool = True


class RefereeSpec(Spec):
    """How the run is judged."""

    success: SuccessSpec = SuccessSpec()
    stop: StopSpec = StopSpec()


class RecordingSpec(Spec):
    """What is recorded, and how often [s of simulated time]."""

    enabled: bool = True
    gas_every_s: Positive = 1.0
    slice_cell_m: Positive = 0.25


class Scenario(Spec):
    """A whole scenario file. `tick_ms` is the exchange step; physics sub-steps are inside the world."""

    schema_: Literal["gslcosim/scenario/1"] = Field(alias="schema")
    name: Name
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    tick_ms: Annotated[int, Field(ge=1, le=1000)] = 100
    environment: EnvironmentSpec
    wind: WindSpec = WindSpec()
    gas: GasSpec
    agents: Annotated[tuple[AgentSpec, ...], Field(min_length=1)]
    referee: RefereeSpec = RefereeSpec()
    recording: RecordingSpec = RecordingSpec()
    channels: tuple[ChannelSpec, ...] = ()

    @property
    def tick_ns(self) -> int:
        """Length of a tick [ns]."""
        return self.tick_ms * 1_000_000

    def members_of(self, channel: ChannelSpec) -> tuple[str, ...]:
        """Return the names of the agents that send and hear on a channel, by name."""
        return tuple(sorted({agent.name for agent in self.agents} if channel.members == "all" else {*channel.members}))

    def agents_by_process(self) -> dict[str, tuple[str, ...]]:
        """Return which agents each process flies, in the scenario's order; a process has the name of an agent."""
        flown: dict[str, tuple[str, ...]] = {agent.process: () for agent in self.agents}
        for agent in self.agents:
            flown[agent.process] += (agent.name,)
        return flown

    @property
    def slice_height_m(self) -> float:
        """Height of the recorded slice [m]: the agents' search height, or the first source's where they differ."""
        heights_m = {agent.vehicle.search_height_m for agent in self.agents}
        return heights_m.pop() if len(heights_m) == 1 else self.gas.sources[0].position_m[2]
