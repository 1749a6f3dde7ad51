"""Frozen models of a scenario file, every field with unit, default and range, and the events due in a tick."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from gslcosim.base.errors import VehicleError
from gslcosim.base.method_names import name_method
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import (
    AGENT_START,
    ENVIRONMENT,
    AgentStart,
    find_inputs,
    list_agent_starts,
    list_inputs,
    list_live_keys,
)
from gslcosim.contract.environment_messages import EVENTS, PROBES, EventsBeginning, build_source_port
from gslcosim.contract.messages import ParameterValue
from gslcosim.contract.participant import Inbox, Read
from gslcosim.scenario.models.base import Name, NonNegative, Positive, with_registered_keys
from gslcosim.scenario.models.base import Spec as Spec
from gslcosim.scenario.models.events import Event, EventSpec, SourceRateSpec
from gslcosim.scenario.models.gas import EVEN_RELEASES, FilamentsSpec, Gas
from gslcosim.scenario.models.gas import GasSpec as GasSpec
from gslcosim.scenario.models.gas import SourceSpec as SourceSpec
from gslcosim.scenario.models.geometry import BoxSpec as BoxSpec
from gslcosim.scenario.models.geometry import DoorSpec
from gslcosim.scenario.models.geometry import Layout as Layout
from gslcosim.scenario.models.geometry import LayoutSpec as LayoutSpec
from gslcosim.scenario.models.geometry import OpeningSpec as OpeningSpec
from gslcosim.scenario.models.participants import (
    AgentLimitsSpec,
    EnvironmentVariables,
    ParticipantProgramSpec,
    ProbeSpec,
    SandboxChoice,
    Service,
)
from gslcosim.scenario.models.sensors import CameraSensorSpec, Sensor
from gslcosim.scenario.models.sensors import SensorSpec as SensorSpec
from gslcosim.scenario.models.success import SourceSuccess, Success
from gslcosim.scenario.models.wind import WITH_K_EPSILON, Wind
from gslcosim.scenario.models.wind import SolverSpec as SolverSpec
from gslcosim.scenario.models.wind import WindSpec as WindSpec
from gslcosim.scenario.problems import did_you_mean
from gslcosim.vehicles import Vehicle, get_vehicle, is_vehicle, list_vehicle_names

SCHEMA = "gslcosim/scenario/1"
# Default height to which a vehicle in the air rises [m].
USUAL_HEIGHT_M = 2.0
Mode = Literal["on_request", "lockstep", "free"] | dict[Literal["latency"], Annotated[int, Field(ge=1, le=1000)]]
# Services that share a process; see `Scenario`.
Processes = Literal["separate", "grouped", "one"] | tuple[tuple[Name, ...], ...]


@with_registered_keys(ENVIRONMENT)
class EnvironmentSpec(Spec):
    """Environment of the run: exactly one of `layout`, `path`, `gsl_bench`, `gaden` and `geometry`.

    `doors` are boxes in the room that events open and close, see docs/events.md.
    """

    layout: Layout | None = Field(default=None, description="room to generate")
    path: str | None = Field(
        default=None, description="folder of a generated or imported environment, relative to the scenario's folder"
    )
    doors: tuple[DoorSpec, ...] = Field(default=(), description="doors: boxes that events open and close")

    @property
    def folder_key(self) -> str | None:
        """Key that names a folder, if any."""
        folders = {path.place for path in list_inputs() if path.kind == "folder"}
        keys = (key for key in type(self).model_fields if f"{ENVIRONMENT}.{key}" in folders)
        return next((key for key in keys if self._has(key)), None)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Files and folders that it names."""
        return tuple(text for _, _, text in find_inputs({ENVIRONMENT: self.model_dump(mode="json")}))

    def _has(self, key: str) -> bool:
        return getattr(self, key) is not None

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        keys = [key for key in type(self).model_fields if key not in ("doors", "heat", "air_c")]
        given = [key for key in keys if self._has(key)]
        if len(given) != 1:
            raise broken_rule_error(
                expected=f"exactly one of {', '.join(keys[:-1])} and {keys[-1]}",
                found=" and ".join(given) or "none",
                remedy="layout generates a room, path takes the folder of one made before.",
            )
        return self


@with_registered_keys(AGENT_START)
class StartSpec(Spec):
    """Start of an agent: a Python agent by name or file, a command line, or an agent that attaches itself.

    - `door`: transport, `zenoh` or the gateway over `stdio`, `tcp` or `unix`. With `stdio`, a Python agent speaks
      msgpack frames and keeps its own process even if everything else runs in one.
    - `format`: encoding of the gateway's frames.
    - `observations: asked`: the gateway sends only observations that require a command.
    - `process_of`: another agent whose process, and door, also serves this agent.
    - `method`: method name in lists and tables for an agent that attaches itself.
    """

    python: str | None = Field(
        default=None, description="name of a bundled agent, or a Python file or card relative to the scenario's folder"
    )
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="program and arguments; a name with a slash is relative to the scenario's folder, others "
        "are found on the PATH",
    )
    attach: bool = Field(default=False, description="wait for an agent that the user starts and that attaches itself")
    door: Literal["zenoh", "stdio", "tcp", "unix"] = Field(
        default="zenoh", description="transport: Zenoh, or one of the gateway's"
    )
    format: Literal["msgpack", "json"] = Field(default="msgpack", description="encoding of gateway frames")
    observations: Literal["all", "asked"] = Field(
        default="all", description="observations to send through the gateway; asked: only those that require a command"
    )
    method: Name | None = Field(
        default=None, description="method name of an agent that attaches itself (absent: attached)"
    )
    process_of: Name | None = Field(default=None, description="name of the agent whose process also controls this one")

    @property
    def is_behind_gateway(self) -> bool:
        """True if the agent speaks frames with the supervisor instead of joining the bus."""
        return self.door != "zenoh"

    @property
    def registered(self) -> AgentStart[Any] | None:
        """Start of an extension in this block, if any."""
        return next((start for start in list_agent_starts() if start.get(self) is not None), None)

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        registered = [start.name for start in list_agent_starts()]
        given = [key for key in ("python", "command", *registered, "attach", "process_of") if getattr(self, key)]
        if len(given) != 1:
            raise broken_rule_error(
                expected=f"exactly one of {', '.join(['python', 'command', *registered])}, attach: true and process_of",
                found=" and ".join(given) or "none",
                remedy="For example start: {python: dung_beetle}.",
            )
        return self

    @model_validator(mode="after")
    def _check_door(self) -> Self:
        if self.process_of is not None and self.is_behind_gateway:
            raise broken_rule_error(
                key="door",
                expected=f"no door beside process_of: {self.process_of}'s is taken",
                found=self.door,
                remedy=f"Give door, format and observations with {self.process_of}.",
            )
        if self.python is not None and (self.door in ("tcp", "unix") or self.format == "json"):
            raise broken_rule_error(
                key="format" if self.door == "stdio" else "door",
                expected="msgpack for a Python agent" if self.door == "stdio" else "zenoh or stdio for a Python agent",
                found=self.format if self.door == "stdio" else self.door,
                remedy="Leave it out, or start a program that speaks the gateway's frames with command.",
            )
        if self.attach and self.door == "stdio":
            raise broken_rule_error(
                key="door",
                expected="zenoh, tcp or unix for an agent that attaches itself",
                found=self.door,
                remedy="Standard input and output belong to a program that is started here, with command.",
            )
        if (start := self.registered) is not None:
            start.check_start(self)
        return self

    @model_validator(mode="after")
    def _check_method(self) -> Self:
        if self.method is not None and not self.attach:
            raise broken_rule_error(
                key="method",
                expected="none but for an agent that attaches itself: others have the name of their program",
                found=self.method,
                remedy="Leave it out, or add attach: true.",
            )
        return self

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        for key, default in (("format", "msgpack"), ("observations", "all")):
            if getattr(self, key) != default and not self.is_behind_gateway:
                raise broken_rule_error(
                    key=key,
                    expected=f"{default} with door: zenoh",
                    found=getattr(self, key),
                    remedy="Add door: stdio, tcp or unix to speak through the gateway.",
                )
        return self


def _usual_height_m(values: dict[str, Any]) -> float:
    facts = get_vehicle(values["model"])
    return facts.body.half_height_m if facts.drives else USUAL_HEIGHT_M


class VehicleSpec(Spec):
    """Vehicle: model, start position on the ground, search height, limits and hold time at each waypoint.

    - `search_height_m`: 2 m by default; ground vehicles have none.
    - `hold_rule`: `fixed` ends every waypoint and mission with `hold_s`, whatever the agent asks for.
    - `avoidance`: `none` goes straight to waypoints; `2d` plans around obstacles at the search height, or on the floor;
      `3d` also plans over and under them.
    - `separation_m`: distance that it keeps from other vehicles, centre to centre, on the way to waypoints and at a
      commanded velocity; 0 for none.
    """

    model: str = Field(default="iris", description="vehicle model, see `gslcosim list vehicles`")
    start_m: Vec3 = Field(
        description="start position in the world; random: drawn from the seed where the vehicle fits and can climb"
    )
    search_height_m: Positive = Field(
        default_factory=_usual_height_m,
        description="search height (absent: 2; none for ground vehicles)",
    )
    hold_s: NonNegative = Field(default=2.0, description="hold time at a waypoint before the agent decides")
    hold_rule: Literal["fixed"] | None = Field(
        default=None,
        description="fixed: each waypoint and mission ends with a hold of hold_s (absent: as long as the agent asks)",
    )
    max_speed_m_s: Positive = Field(default=1.0, description="maximum speed")
    max_acceleration_m_s2: Positive = Field(default=2.0, description="maximum acceleration")
    avoidance: Literal["none", "2d", "3d"] = Field(
        default="none",
        description="obstacle avoidance: none, around obstacles at its height (2d), or also over and under them (3d)",
    )
    separation_m: NonNegative = Field(
        default=0.0,
        description="minimum distance between its centre and those of other flying vehicles (0: no separation)",
    )

    @property
    def drives(self) -> bool:
        """True if the vehicle stays on the ground."""
        return self.facts.drives

    @property
    def facts(self) -> Vehicle:
        """Facts of the vehicle from the catalogue."""
        return get_vehicle(self.model)

    @field_validator("model")
    @classmethod
    def _check_model(cls, model: str) -> str:
        if not is_vehicle(model):
            names = list_vehicle_names()
            raise broken_rule_error(
                expected=f"one of {', '.join(names[:-1])} or {names[-1]}",
                found=f"'{model}'",
                remedy=did_you_mean(model, names),
            )
        try:
            get_vehicle(model)
        except VehicleError as error:
            raise broken_rule_error(
                expected="a vehicle whose folder is whole",
                found=f"'{model}'",
                remedy=str(error).replace("\n", " "),
            ) from error
        return model

    @model_validator(mode="after")
    def _check_avoidance(self) -> Self:
        if self.drives and self.avoidance == "3d":
            raise broken_rule_error(
                key="avoidance",
                expected=f"none or 2d for a {self.model}, which stays on the floor",
                found="3d",
                remedy="Take 2d.",
            )
        if self.drives and self.separation_m:
            raise broken_rule_error(
                key="separation_m",
                expected=f"0 for a {self.model}: only vehicles in the air go out of the way of others",
                found=f"{self.separation_m:g}",
                remedy="Leave it out.",
            )
        return self

    @model_validator(mode="after")
    def _check_height(self) -> Self:
        if self.drives and self.search_height_m != self.facts.body.half_height_m:
            raise broken_rule_error(
                key="search_height_m",
                expected=f"no height for a {self.model}, which stays on the floor",
                found=f"{self.search_height_m:g}",
                remedy=f"Leave it out; a {self.model}'s waypoints may have any height in the room.",
            )
        return self


class KnowledgeSpec(Spec):
    """Prior knowledge that the briefing gives to the agent; `result.json` records it.

    - `map`: occupancy of the room, at the search height (`true`, `2d`) or complete (`3d`).
    - `plume`: nominal strength, spread and wind speed.
    - `source`: positions of the sources, for upper bounds such as the oracle.
    """

    map: bool | Literal["2d", "3d"] = Field(
        default=False, description="occupancy of the room: true or 2d at the search height, 3d complete"
    )
    plume: bool = Field(default=False, description="nominal figures of the plume: strength, spread, wind speed")
    source: bool = Field(default=False, description="positions of the sources")

    @property
    def granted(self) -> tuple[str, ...]:
        """Names of the granted items."""
        return tuple(name for name in type(self).model_fields if getattr(self, name))


class AgentSpec(Spec):
    """One agent with its vehicle and sensors.

    - `parameters`: scalars, or lists of them, passed to the agent unchanged.
    - `mode`: simulated time waits for the agent at its waypoints (`on_request`), every tick (`lockstep`), N ticks after
      each observation (`{latency: N}`), or never (`free`); free agents' commands take effect on arrival.
    - `sandbox`: `auto` takes the strongest on this machine; `required` does too, but fails if there is none or the
      agent has no process here; `bubblewrap` and `landlock` demand one; `none` starts the agent without.
    - `may_read`, `may_write`: an agent sees the code in its own folder and no run; these name more.
    - `environment`: variables beside `PATH`, `LANG`, `LC_*`, `TZ`, `HOME`, `TMPDIR` and the numbers of threads.
    """

    name: Name = Field(description="name of the agent")
    start: StartSpec = Field(description="start of the agent")
    mode: Mode = Field(
        default="on_request",
        description="when simulated time waits for the agent: at its waypoints, every tick, N ticks after "
        "each observation, or never",
    )
    vehicle: VehicleSpec = Field(description="vehicle of the agent")
    sensors: Annotated[tuple[Sensor, ...], Field(min_length=1)] = Field(description="sensors of the agent")
    answer_within_s: Positive = Field(default=30.0, description="wall-clock timeout for an answer")
    parameters: dict[Name, ParameterValue] = Field(default={}, description="parameters of the method, passed unchanged")
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = Field(
        default=None, description="seed of the agent (absent: derived from the seed of the run and the agent's name)"
    )
    knows: KnowledgeSpec = Field(default=KnowledgeSpec(), description="prior knowledge of the agent beyond its sensors")
    sandbox: SandboxChoice = Field(
        default="auto",
        description="sandbox of the process; auto: the strongest on this machine; required: the same, but an "
        "error if there is none",
    )
    limits: AgentLimitsSpec = Field(default=AgentLimitsSpec(), description="resource limits of its processes")
    may_read: tuple[str, ...] = Field(default=(), description="additional files and folders that it may read")
    may_write: tuple[str, ...] = Field(default=(), description="folders that it may write")
    environment: EnvironmentVariables | None = Field(
        default=None, description="environment variables; a variable without a value is inherited"
    )

    @model_validator(mode="after")
    def _check_start(self) -> Self:
        if (start := self.start.registered) is not None:
            start.check_agent(self)
        return self

    @model_validator(mode="after")
    def _check_hold_rule(self) -> Self:
        if self.vehicle.hold_rule == "fixed" and self.mode != "on_request":
            raise broken_rule_error(
                key="vehicle.hold_rule",
                expected="mode: on_request, in which the vehicle asks when its hold is over",
                found=f"mode: {self.mode_name}",
                remedy="Leave hold_rule out, or take mode: on_request.",
            )
        return self

    @property
    def place(self) -> str:
        """Path in a scenario, for errors."""
        return f"agents.{self.name}"

    @property
    def latency_ticks(self) -> int:
        """Ticks between an observation and the effect of its command: N for `{latency: N}`, otherwise 1."""
        return self.mode["latency"] if isinstance(self.mode, dict) else 1

    @property
    def mode_name(self) -> Literal["on_request", "lockstep", "latency", "free"]:
        """Return the mode without its number."""
        return "latency" if isinstance(self.mode, dict) else self.mode

    @property
    def is_free(self) -> bool:
        """True if time never waits for it."""
        return self.mode == "free"

    @property
    def process(self) -> str:
        """Name of the agent whose process runs this one: its own unless `process_of` names another."""
        return self.start.process_of or self.name

    @property
    def is_asked_every_tick(self) -> bool:
        """True if every observation awaits a command."""
        return self.mode_name in ("lockstep", "latency")


class ChannelSpec(Spec):
    """Radio channel on which agents send texts to each other.

    - `members`: agents that send and receive on it.
    - `range_m`: range in a straight line, through walls (absent: unlimited).
    - `loss_frac`: fraction of messages lost, drawn for each receiver separately.
    - `delay_ticks`: delay from the observation that the sender answered to the delivery. An agent with latency N sends
      N - 1 ticks after that observation.
    - `max_bytes`: maximum length of a text in UTF-8.
    """

    name: Name = Field(description="name of the channel")
    members: Literal["all"] | Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        default="all", description="agents that send and receive on it"
    )
    range_m: Positive | None = Field(default=None, description="range (absent: unlimited)")
    loss_frac: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.0, description="fraction of messages that are lost"
    )
    delay_ticks: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=1, description="delay in ticks from the observation that the sender answered to the delivery"
    )
    max_bytes: Annotated[int, Field(ge=1, le=65536)] = Field(
        default=1024, description="maximum length of a text in UTF-8"
    )


class StopSpec(Spec):
    """Conditions that end a run besides success: simulated time [s], or a collision."""

    time_limit_s: Positive = Field(default=300.0, description="simulated time after which the run ends")
    on_collision: bool = Field(default=True, description="a collision ends the run")


class RefereeSpec(Spec):
    """Scoring of the run."""

    success: Success = Field(default=SourceSuccess(), description="success criterion")
    stop: StopSpec = Field(default=StopSpec(), description="conditions that end the run besides success")


class RecordingSpec(Spec):
    """Content, rate, start and end of the recording [s of simulated time]; without `to_s` it ends with the run."""

    enabled: bool = Field(default=True, description="record the run")
    gas_every_s: Positive = Field(default=1.0, description="simulated time between gas images")
    slice_cell_m: Positive = Field(default=0.25, description="cell size of the gas slice")
    from_s: NonNegative = Field(default=0.0, description="simulated time at which the recording starts")
    to_s: Positive | None = Field(
        default=None, description="simulated time at which the recording ends (absent: end of the run)"
    )

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise broken_rule_error(
                key="to_s",
                expected=f"a time after from_s, {self.from_s:g} s",
                found=f"{self.to_s:g} s",
                remedy="Leave to_s out to record up to the end.",
            )
        return self


class SnapshotsSpec(Spec):
    """Snapshots of the state of a run, kept in its folder; forks and replays can start from them."""

    every_s: Positive = Field(default=60.0, description="simulated time between snapshots")


class RestartSpec(Spec):
    """Restart of services that die, from their last snapshot, with the same digest; never of the recorder."""

    tries: Annotated[int, Field(ge=1, le=100)] = Field(
        default=3, description="restarts of a service without progress before the run fails"
    )


@with_registered_keys("")
class Scenario(Spec):
    """A scenario file. `tick_ms` is the exchange step; the world takes physics sub-steps within it.

    `processes` spreads a run over processes and never changes results. Suites ignore it: they use worker processes.

    - `separate`: each service and each agent has its own process.
    - `grouped`: all services share a process; each agent has its own.
    - `one`: everything runs in one process.
    - Lists of names: the services of a list share a process.

    `pace` ties simulated time to the wall clock. It changes results only for agents of mode `free`.
    """

    schema_: Literal["gslcosim/scenario/1"] = Field(alias="schema", description="file format and version")
    name: Name = Field(description="name of the scenario")
    seed: Annotated[int, Field(ge=0, le=2**31)] = Field(default=0, description="seed of all random draws")
    tick_ms: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=100, description="tick: time between message exchanges, a multiple of 4"
    )
    environment: EnvironmentSpec = Field(description="environment of the run")
    wind: Wind = Field(default=WindSpec(), description="motion of the air")
    gas: Gas = Field(description="gas, its sources and its dispersion")
    agents: Annotated[tuple[AgentSpec, ...], Field(min_length=1)] = Field(description="agents that search")
    referee: RefereeSpec = Field(default=RefereeSpec(), description="rules by which the referee judges")
    recording: RecordingSpec = Field(default=RecordingSpec(), description="recording settings")
    channels: tuple[ChannelSpec, ...] = Field(default=(), description="radio channels between agents")
    services: tuple[Service, ...] = Field(default=(), description="services of other packages")
    participants: tuple[ParticipantProgramSpec, ...] = Field(
        default=(), description="your own models, as programs in any language"
    )
    probes: Annotated[tuple[ProbeSpec, ...], Field(min_length=1, max_length=1000)] | None = Field(
        default=None, description="points at which participants can read the truth (absent: none)"
    )
    events: tuple[Event, ...] = Field(default=(), description="events during the run")
    pace: Annotated[float, Field(ge=0.05, le=1000)] | None = Field(
        default=None,
        description="simulated seconds per wall-clock second (absent: as fast as possible)",
    )
    snapshots: SnapshotsSpec | None = Field(
        default=None, description="snapshots of the state (absent: none), without influence on results"
    )
    restart: RestartSpec | None = Field(
        default=None,
        description="restart of services that die (absent: the run fails); needs snapshots",
    )
    processes: Processes = Field(
        default="separate", description="services that share a process, without influence on results"
    )

    @property
    def uses_built_in_solver(self) -> bool:
        """True if the built-in solver makes the room's wind."""
        is_built_in = self.wind.solver == "built_in" or (
            self.wind.solver == "auto" and self.environment.folder_key is None
        )
        return self.environment.path is None and is_built_in

    # The scenario cannot be assigned to, but the choice belongs to what is read, and is recorded with it.
    @model_validator(mode="after")
    def _choose_turbulence(self) -> Self:
        gas, wind = self.gas, self.wind
        if not isinstance(gas, FilamentsSpec):
            return self
        has_k = self.uses_built_in_solver and isinstance(wind, WindSpec) and wind.turbulence in WITH_K_EPSILON
        is_uniform = self.environment.path is None and wind.solver == "uniform"
        blows = any(wind.inlet_velocity_m_s)
        gas = gas.with_turbulence("wind" if has_k else "given" if is_uniform and blows else None)
        object.__setattr__(self, "gas", gas)
        kind = "none" if gas.eddies is None else gas.eddies.kind
        lacks_k = self.environment.path is None and (
            self.uses_built_in_solver or wind.solver in ("uniform", "openfoam") or wind.file is not None
        )
        if kind == "wind" and has_k:
            object.__setattr__(self, "wind", wind.model_copy(update={"keep_turbulence": True}))
        elif kind == "wind" and lacks_k:
            raise broken_rule_error(
                key="gas.turbulence.kind",
                expected="given or none, as this wind has no k and epsilon",
                found="wind",
                remedy="Solve it with wind: {solver: built_in, turbulence: k_epsilon}, or leave gas.turbulence out.",
            )
        elif kind == "given" and is_uniform and not blows and not gas.is_in_open_air:
            raise broken_rule_error(
                key="gas.turbulence.kind",
                expected="a wind that blows with kind: given",
                found="still air",
                remedy="Give wind.inlet_velocity_m_s, or leave gas.turbulence out.",
            )
        return self

    @model_validator(mode="after")
    def _check_restart(self) -> Self:
        if self.restart is not None and self.snapshots is None:
            raise broken_rule_error(
                key="restart",
                expected="snapshots with it, at which a service goes on",
                found="none",
                remedy="Write snapshots: {every_s: 60}.",
            )
        return self

    @model_validator(mode="after")
    def _check_driven_wind(self) -> Self:
        drivers = [each.name for each in (*self.services, *self.participants) if each.drives_wind]
        key = "participants" if any(each.drives_wind for each in self.participants) else "services"
        if len(drivers) > 1:
            raise broken_rule_error(
                key=key,
                expected="at most one that changes the wind",
                found=" and ".join(drivers),
                remedy="Leave all but one of them out.",
            )
        if drivers and (self.gas.tape or not self.gas.can_be_driven):
            raise broken_rule_error(
                key=key,
                expected=f"none that changes the wind, as {drivers[0]} does, with gas that does not follow it",
                found="gas.tape: true" if self.gas.tape else f"gas.model: {self.gas.model}",
                remedy="Take gas.model: filament without a tape.",
            )
        return self

    @model_validator(mode="after")
    def _check_driven_sources(self) -> Self:
        for i, participant in enumerate(self.participants):
            for i_source in participant.driven_sources:
                self._check_driven_source(i_source, f"participants[{i}].writes")
        return self

    def _check_driven_source(self, i_source: int, key: str) -> None:
        sources = self.gas.sources
        if i_source >= len(sources):
            last = f" to source_{len(sources) - 1}" if len(sources) > 1 else " alone"
            raise broken_rule_error(
                key=key,
                expected=f"a source in gas.sources, source_0{last}",
                found=f"source_{i_source}",
                remedy="Places count from 0.",
            )
        if self.gas.model != "filament" or self.gas.tape:
            raise broken_rule_error(
                key=key,
                expected="no rate of a source with gas that cannot follow it",
                found=f"source_{i_source} with gas.{'tape: true' if self.gas.tape else f'model: {self.gas.model}'}",
                remedy="Take gas.model: filament without a tape.",
            )
        kind = sources[i_source].release.kind
        if kind not in EVEN_RELEASES:
            raise broken_rule_error(
                key=key,
                expected=f"a source whose release is {' or '.join(EVEN_RELEASES)}",
                found=f"source_{i_source}, whose release is {kind}",
                remedy="The participant sets its rate at all times.",
            )
        for i, event in enumerate(self.events):
            if isinstance(event, SourceRateSpec) and event.source == i_source:
                raise broken_rule_error(
                    key=f"events[{i}].what",
                    expected=f"no source_rate of source {i_source}, whose rate a participant sets in each tick",
                    found="one",
                    remedy="Leave it out, or source_starts and source_stops in its place.",
                )

    def without_live_keys(self) -> "Scenario":
        """Return the scenario without the keys that show a run in progress."""
        return self.model_copy(update={key.name: key.default for key in list_live_keys()})

    @property
    def tick_ns(self) -> int:
        """Length of a tick [ns]."""
        return self.tick_ms * 1_000_000

    @property
    def substances(self) -> tuple[str, ...]:
        """Names of the gases that its sources release, each once."""
        return tuple(dict.fromkeys(source.gas or self.gas.gas for source in self.gas.sources))

    @property
    def has_wind_that_changes(self) -> bool:
        """True if a service scales the wind during the run, or an event changes it."""
        return self.has_driven_wind or any(event.drives_wind for event in self.events)

    @property
    def has_driven_wind(self) -> bool:
        """True if a service or participant scales the wind during the run."""
        return any(each.drives_wind for each in (*self.services, *self.participants))

    @property
    def driven_sources(self) -> tuple[int, ...]:
        """Indices in `gas.sources` of the sources whose rates participants set."""
        return tuple(i for participant in self.participants for i in participant.driven_sources)

    @property
    def curve_ports(self) -> tuple[str, ...]:
        """Ports of services of other packages, of participants and of probes that are recorded as curves."""
        of_services = tuple(port for service in self.services for port in service.recorded_ports)
        of_sources = tuple(build_source_port(i) for i in self.driven_sources)
        own = tuple(port for participant in self.participants for port in participant.own_ports)
        return (*of_services, *of_sources, *own, *((PROBES,) if self.probes else ()))

    @property
    def cameras(self) -> tuple[tuple[AgentSpec, CameraSensorSpec], ...]:
        """All cameras, each with its agent."""
        sensors = ((agent, sensor) for agent in self.agents for sensor in agent.sensors)
        return tuple((agent, sensor) for agent, sensor in sensors if isinstance(sensor, CameraSensorSpec))

    def members_of(self, channel: ChannelSpec) -> tuple[str, ...]:
        """Return the names of the agents that send and receive on a channel, sorted."""
        return tuple(sorted({agent.name for agent in self.agents} if channel.members == "all" else {*channel.members}))

    def agents_by_process(self) -> dict[str, tuple[str, ...]]:
        """Return the agents of each process, in the scenario's order; a process has the name of an agent."""
        members: dict[str, tuple[str, ...]] = {agent.process: () for agent in self.agents}
        for agent in self.agents:
            members[agent.process] += (agent.name,)
        return members

    @property
    def methods(self) -> dict[str, str]:
        """Name of each agent's method, in the scenario's order; see `name_method`."""
        starts = {agent.name: agent.start for agent in self.agents}
        names = {
            name: name_method(
                python=start.python,
                command=start.command or (),
                method=start.method if start.registered is None else start.registered.name,
            )
            for name, start in starts.items()
        }
        return {agent.name: names[agent.process] for agent in self.agents}

    @property
    def slice_height_m(self) -> float:
        """Height of the recorded slice [m]: the agents' search height, or the first source's where they differ."""
        heights_m = {agent.vehicle.search_height_m for agent in self.agents}
        return heights_m.pop() if len(heights_m) == 1 else self.gas.sources[0].position_m[2]


def list_event_reads(scenario: Scenario, *kinds: type[EventSpec]) -> tuple[Read, ...]:
    """Return the reads of a participant that obeys some kinds of events: none if the scenario has no such event."""
    has_any = any(isinstance(event, kinds) for event in scenario.events)
    return (Read(port=EVENTS, delay_ticks=1),) if has_any else ()


def find_due_events(scenario: Scenario, inbox: Inbox) -> Iterator[tuple[int, EventSpec]]:
    """Yield the events that take effect in a tick, with their indices in the list, in the scenario's order.

    Args:
        scenario: Scenario with the events.
        inbox: Inbox in that tick of a participant with the reads of `list_event_reads`.
    """
    note = inbox.get(EVENTS)
    if isinstance(note, EventsBeginning):
        for i in note.beginning:
            yield i, scenario.events[i]
