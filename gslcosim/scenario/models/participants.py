"""Participants of the user, services of other packages, and the sandbox of an agent's processes."""

import re
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, SerializeAsAny, StringConstraints, model_validator

from gslcosim.base.plugins import EntryPoints
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import (
    PARTICIPANT,
    PARTICIPANT_READ,
    PARTICIPANT_START,
    ParticipantStart,
    list_participant_starts,
)
from gslcosim.contract.messages import ParameterValue
from gslcosim.contract.participant_messages import VENTILATION, build_own_port, find_driven_source, find_room_output
from gslcosim.scenario.models.base import Name, OneOf, Positive, Spec, with_registered_keys

# Names that a briefing can hold.
_PARAMETER_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
# Prefix of the variables that a run sets for its processes.
_OUR_PREFIX = "GSLCOSIM_"
SandboxChoice = Literal["auto", "required", "bubblewrap", "landlock", "none"]
# For a participant that an extension starts; names for programs match `_PARAMETER_NAME`.
ParameterName = Annotated[str, StringConstraints(min_length=1, max_length=200)]
# A service that is silent for 30 s counts as hanging; the program's own limit is more specific.
MAX_ANSWER_S = 25.0
# Entry points of other packages' services; each is a class that derives from `ServiceSpec`.
SERVICE_ENTRY_POINTS = "gslcosim.services"


def _without_ours(variables: "dict[str, str | None]") -> "dict[str, str | None]":
    if ours := next((name for name in variables if name.startswith(_OUR_PREFIX)), None):
        raise broken_rule_error(
            key=ours,
            expected="variables of the agent's own",
            found=f"one that begins with {_OUR_PREFIX}",
            remedy="gslcosim sets those itself. Leave it out.",
        )
    return variables


EnvironmentVariables = Annotated[
    dict[
        Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,127}$")],
        Annotated[str, Field(max_length=32_768, pattern=r"^[^\x00]*$")] | None,
    ],
    Field(max_length=100),
    AfterValidator(_without_ours),
]


class AgentLimitsSpec(Spec):
    """Resource limits for all processes of an agent together; an agent that reaches one has failed. Absent: no limit.

    `n_files` differs: it is a limit per process, and opening one more file is an error in that process.
    """

    cpu_s: Positive | None = Field(default=None, description="limit of processor time")
    memory_mb: Annotated[float, Field(ge=8)] | None = Field(
        default=None, description="limit of resident memory in MB; shared memory counts for each process"
    )
    n_files: Annotated[int, Field(ge=16, le=1_000_000)] | None = Field(
        default=None, description="limit of open files per process"
    )
    n_processes: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        default=None, description="limit of concurrent processes"
    )

    @property
    def are_given(self) -> bool:
        """True if there is any bound."""
        return any(value is not None for value in (self.cpu_s, self.memory_mb, self.n_files, self.n_processes))


@with_registered_keys(PARTICIPANT_START)
class ProgramStartSpec(Spec):
    """Start of a participant's program: command, connection to the gateway, and format; or a key of an extension."""

    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="program and arguments; a name with a slash is relative to the scenario's folder, others "
        "are found on the PATH",
    )
    door: Literal["stdio", "tcp", "unix"] = Field(
        default="stdio", description="transport: standard streams or a connection"
    )
    format: Literal["msgpack", "json"] = Field(default="msgpack", description="encoding of frames")

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        keys = ["command", *(start.name for start in list_participant_starts())]
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise broken_rule_error(
                expected=f"exactly one of {', '.join(keys[:-1])} and {keys[-1]}" if keys[1:] else "a command",
                found=" and ".join(given) or "none",
                remedy="For example start: {command: [./my_model]}.",
            )
        if (start := self.registered) is not None:
            start.check_start(self)
        return self

    @property
    def registered(self) -> ParticipantStart[Any] | None:
        """Start of an extension in this block, if any."""
        return next((start for start in list_participant_starts() if start.get(self) is not None), None)

    @property
    def words(self) -> tuple[str, ...]:
        """Program and arguments of the process."""
        start = self.registered
        return self.given_words if start is None else start.build_words(start.get(self))

    @property
    def given_words(self) -> tuple[str, ...]:
        """Words that the scenario gives: the command, or the text of an extension's key."""
        start = self.registered
        return (self.command or ()) if start is None else (str(start.get(self)),)


@with_registered_keys(PARTICIPANT_READ)
class PortReadSpec(Spec):
    """A port that a participant reads, true values included, `delay` ticks late."""

    port: Annotated[str, StringConstraints(min_length=1, max_length=200)] = Field(
        description="port, such as truth/samples (docs/messages.md) or participant/NAME/PORT"
    )
    delay: Annotated[int, Field(ge=0, le=1000)] = Field(
        default=0, description="delay in ticks between a message and the step that reads it"
    )


@with_registered_keys(PARTICIPANT)
class ParticipantProgramSpec(Spec):
    """Your own model: a program that reads its inputs once per period and answers.

    - `reads`: its inputs. A participant is part of the world, so it may read true values, which agents cannot.
    - `writes`: its outputs. `ventilation` changes the wind of the room, `source_0` the rate of the first source and so
      on; any other name is a port of its own, `participant/<name>/<output>`, whose numbers become curves in the
      recording.
    - `parameters`: passed to the program unchanged; of a unit, by variable.
    """

    name: Name = Field(description="name of the participant")
    start: ProgramStartSpec = Field(description="command that starts the program")
    reads: tuple[PortReadSpec, ...] = Field(default=(), description="ports that it reads")
    writes: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        description="ports that it writes: ventilation, which changes the wind, source_0, which sets the rate of the "
        "first source, or names of its own ports"
    )
    period_s: Positive | None = Field(default=None, description="simulated time between steps (absent: one tick)")
    answer_within_s: Annotated[float, Field(gt=0, le=MAX_ANSWER_S)] = Field(
        default=10.0, description="wall-clock timeout for an answer"
    )
    parameters: dict[ParameterName, ParameterValue] = Field(
        default={}, description="settings of the model, passed unchanged; for a unit: by variable"
    )
    sandbox: SandboxChoice = Field(
        default="auto", description="sandbox of the program; auto: the strongest on this machine"
    )
    limits: AgentLimitsSpec = Field(default=AgentLimitsSpec(), description="resource limits of its processes")
    may_read: tuple[str, ...] = Field(default=(), description="additional files and folders that it may read")
    may_write: tuple[str, ...] = Field(default=(), description="folders that it may write")
    environment: EnvironmentVariables | None = Field(
        default=None, description="environment variables; a variable without a value is inherited"
    )

    @property
    def place(self) -> str:
        """Path in a scenario, for errors."""
        return f"participants.{self.name}"

    @property
    def drives_wind(self) -> bool:
        """True if it changes the wind of the room."""
        return VENTILATION in self.writes

    @property
    def driven_sources(self) -> tuple[int, ...]:
        """Indices in `gas.sources` of the sources whose rates it sets."""
        found = (find_driven_source(word) for word in self.writes)
        return tuple(i for i in found if i is not None)

    @property
    def own_ports(self) -> tuple[str, ...]:
        """Ports of its own, which are recorded."""
        return tuple(build_own_port(self.name, word) for word in self.writes if find_room_output(word) is None)

    def port_of(self, word: str) -> str:
        """Return the port of a word in `writes`."""
        room = find_room_output(word)
        return build_own_port(self.name, word) if room is None else room.port

    @model_validator(mode="after")
    def _check_ports(self) -> Self:
        for key, words in (("reads", [read.port for read in self.reads]), ("writes", list(self.writes))):
            twice = next((word for word in words if words.count(word) > 1), None)
            if twice is not None:
                raise broken_rule_error(
                    key=key,
                    expected="each port once",
                    found=f"'{twice}' {words.count(twice)} times",
                    remedy="Leave one.",
                )
        return self

    @model_validator(mode="after")
    def _check_variables(self) -> Self:
        for start in list_participant_starts():
            start.check_participant(self)
        if self.start.registered is not None:
            return self
        wrong = next((name for name in self.parameters if _PARAMETER_NAME.fullmatch(name) is None), None)
        if wrong is not None:
            expected = "names of at most 40 lower-case letters, digits and _, for a program"
            raise broken_rule_error(key="parameters", expected=expected, found=f"'{wrong}'")
        return self


class ServiceSpec(Spec):
    """A service of another package: `name` is that of the participant, the entry point and the process.

    The package derives from this class, narrows `name`, adds its settings, and registers how its core is built with
    `gslcosim.runtime.services.get_block_service`.

    With `drives_wind`, it writes `truth/wind`, which scales the wind of the room. Numbers and truth values of the
    messages on `recorded_ports` are recorded as curves; each port is one that it writes every tick.
    """

    drives_wind: ClassVar[bool] = False
    recorded_ports: ClassVar[tuple[str, ...]] = ()

    name: Name = Field(description="name of the service")


Service = Annotated[
    SerializeAsAny[ServiceSpec],
    OneOf(
        tag_key="name",
        base=ServiceSpec,
        own={},
        offers=EntryPoints(group=SERVICE_ENTRY_POINTS, what="service"),
        unknown="the name of a service that an installed package offers",
    ),
]


class ProbeSpec(Spec):
    """A point of the room at which participants can read true gas and wind, on the port `truth/probes`.

    Probes change nothing else in a run, and no agent can read them.
    """

    name: Name = Field(description="name of the probe")
    position_m: Vec3 = Field(description="position in the world, in the room's air")
