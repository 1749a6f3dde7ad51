"""Participants of one's own that take part in a run as programs, in any language."""

from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.messages import ParameterValue
from gslcosim.contract.participant_messages import VENTILATION, build_own_port
from gslcosim.scenario.models.base import Name, Positive, Spec, broken_rule_error
from gslcosim.scenario.models.sandbox import AgentLimitsSpec, EnvironmentVariables, SandboxChoice

# A service that is silent for 30 s is taken for one that hangs; the program's own limit says more.
MAX_ANSWER_S = 25.0


class ProgramStartSpec(Spec):
    """Start of a participant's program: its command, its connection to the gateway, and its format."""

    command: Annotated[tuple[str, ...], Field(min_length=1)] = Field(
        description="a program and its arguments: with a slash in the scenario's folder, else on the PATH"
    )
    door: Literal["stdio", "tcp", "unix"] = Field(
        default="stdio", description="how it speaks with the run: over its standard streams, or a connection"
    )
    format: Literal["msgpack", "json"] = Field(default="msgpack", description="how frames are written")


class PortReadSpec(Spec):
    """A port that a participant reads, truth among them; `delay` says of how many ticks before."""

    port: Annotated[str, StringConstraints(min_length=1, max_length=200)] = Field(
        description="which port, such as truth/samples; docs/messages.md has all, those of participants are "
        "participant/NAME/PORT"
    )
    delay: Annotated[int, Field(ge=0, le=1000)] = Field(
        default=0, description="ticks between a message and the step that reads it"
    )


class ParticipantProgramSpec(Spec):
    """A model of the user's own: a program that reads what it declares, each tick of its period, and answers it.

    `reads` are its inputs; it is a part of the world, so they may be truth, which no agent can read. `writes` names its
    outputs: `ventilation` changes the wind of the room, any other word is a port of its own,
    `participant/<name>/<word>`, whose numbers and truth values become curves in the recording.
    `parameters` are handed to the program as they are.
    """

    name: Name = Field(description="what the participant is called")
    start: ProgramStartSpec = Field(description="how its program is started")
    reads: tuple[PortReadSpec, ...] = Field(default=(), description="what it reads")
    writes: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        description="what it writes: ventilation, which changes the wind, or words for ports of its own"
    )
    period_s: Positive | None = Field(
        default=None, description="simulated time between its steps (absent: it steps every tick)"
    )
    answer_within_s: Annotated[float, Field(gt=0, le=MAX_ANSWER_S)] = Field(
        default=10.0, description="how long the run waits for an answer, by the clock on the wall"
    )
    parameters: dict[Name, ParameterValue] = Field(
        default={}, description="settings of the model, handed to it as they are"
    )
    sandbox: SandboxChoice = Field(
        default="auto", description="what its program is started in; auto: the strongest that the machine has"
    )
    limits: AgentLimitsSpec = Field(default=AgentLimitsSpec(), description="the bounds of what its processes use")
    may_read: tuple[str, ...] = Field(default=(), description="folders that it sees besides its own")
    may_write: tuple[str, ...] = Field(default=(), description="folders that it may change")
    environment: EnvironmentVariables | None = Field(
        default=None, description="variables of its environment by name; one without a value is passed on from ours"
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
    def own_ports(self) -> tuple[str, ...]:
        """The ports of its own, which are recorded."""
        return tuple(build_own_port(self.name, word) for word in self.writes if word != VENTILATION)

    def port_of(self, word: str) -> str:
        """Return the port that a word of `writes` stands for."""
        return WIND if word == VENTILATION else build_own_port(self.name, word)

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
