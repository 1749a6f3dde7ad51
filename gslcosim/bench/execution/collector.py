"""Collector of a trial's time series: true track, gas, readings, beliefs, declarations and events."""

from dataclasses import dataclass, field

from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    Belief,
    BodyPoses,
    Command,
    Declaration,
    FieldSamples,
    Message,
    Observation,
    RefereeEvent,
    Score,
)
from gslcosim.scenario import Scenario

GAS_SENSORS_REPORT = ("resistance", "mixing_ratio", "gas_detected", "hits", "estimated_mixing_ratio")
_NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class RecordedDeclaration:
    """A declaration of an agent: when it took effect [s], where [m], and how sure the agent was."""

    time_s: float
    place_m: Vec3
    confidence: float


@dataclass
class AgentSeries:
    """The series of one agent, a value for each tick, and its belief figures.

    `gas_ppm` is the strongest true mixing ratio at any of its noses, `nose_ppm` that at the first; `reading` is what
    the first gas sensor said last.
    """

    t_s: list[float] = field(default_factory=list[float])
    position_m: list[Vec3] = field(default_factory=list[Vec3])
    distance_m: list[float] = field(default_factory=list[float])
    gas_ppm: list[float] = field(default_factory=list[float])
    nose_ppm: list[float] = field(default_factory=list[float])
    reading: list[float] = field(default_factory=list[float])
    belief_distance_m: list[float] = field(default_factory=list[float])
    belief_mass_near: list[float] = field(default_factory=list[float])
    path_length_m: float = 0.0
    last_belief: Belief | None = None
    last_reading: float = _NAN
    is_over: bool = False


@dataclass
class SeriesCollector:
    """Hears every message of a run and keeps what its row and track are made of."""

    scenario: Scenario
    agents: dict[str, AgentSeries] = field(init=False)
    declared: list[RecordedDeclaration] = field(default_factory=list[RecordedDeclaration])
    _pending: list[tuple[str, Declaration]] = field(default_factory=list[tuple[str, Declaration]])
    n_refusals: int = 0
    n_collisions: int = 0

    def __post_init__(self) -> None:
        """Begin with nothing."""
        self._tick_s = self.scenario.tick_ns / NS_PER_S
        self.agents = {agent.name: AgentSeries() for agent in self.scenario.agents}
        self._agent_of_port = {keys.command(name): name for name in self.agents}
        self._bodies: BodyPoses | None = None
        self._gas_ppm: dict[str, list[float]] = {}

    def note(self, port: str, message: Message) -> None:
        """Take note of a message."""
        if isinstance(message, BodyPoses):
            self._bodies = message
        elif isinstance(message, FieldSamples):
            self._note_samples(message)
        elif isinstance(message, Score):
            self._note_score(message)
        elif isinstance(message, Observation):
            self._note_observation(message)
        elif isinstance(message, Command):
            self._note_command(self._agent_of_port[port], message)

    def _note_samples(self, samples: FieldSamples) -> None:
        gas_ppm: dict[str, list[float]] = {}
        for sample in samples.samples:
            if sample.gases:
                gas_ppm.setdefault(sample.agent, []).append(sample.gases[0].mixing_ratio_ppm)
        self._gas_ppm = gas_ppm

    def _note_observation(self, observation: Observation) -> None:
        for reading in observation.readings:
            if reading.quantity in GAS_SENSORS_REPORT and reading.values:
                self.agents[observation.agent].last_reading = reading.values[0]
                return

    def _note_command(self, agent: str, command: Command) -> None:
        watch = self.agents[agent]
        if watch.is_over:
            return
        if command.belief is not None:
            watch.last_belief = command.belief
        if command.kind == "declare_source" and command.declaration is not None:
            self._pending.append((agent, command.declaration))

    def _note_score(self, score: Score) -> None:
        assert self._bodies is not None, "the world writes before the referee"
        bodies = {body.agent: body for body in self._bodies.bodies}
        time_s = score.tick * self._tick_s
        for standing in score.agents:
            watch, body = self.agents[standing.agent], bodies[standing.agent]
            if watch.is_over:
                continue
            gas_ppm = self._gas_ppm.get(standing.agent, [0.0])
            watch.t_s.append(time_s)
            watch.position_m.append(body.position_world_m)
            watch.distance_m.append(standing.distance_to_source_m)
            watch.gas_ppm.append(max(gas_ppm))
            watch.nose_ppm.append(gas_ppm[0])
            watch.reading.append(watch.last_reading)
            watch.belief_distance_m.append(standing.belief.expected_distance_m if standing.belief else _NAN)
            watch.belief_mass_near.append(standing.belief.mass_near_frac if standing.belief else _NAN)
            watch.path_length_m = body.path_length_m
        for event in score.events:
            self._note_event(event, time_s)

    def _note_event(self, event: RefereeEvent, time_s: float) -> None:
        if event.agent is None:
            return
        self.n_refusals += event.kind == "refused"
        self.n_collisions += event.kind == "contact"
        if event.kind == "declaration":
            self._note_declaration(event.agent, time_s)
        if event.kind in _ENDS:
            self.agents[event.agent].is_over = True

    # A declaration counts when the referee says so, which with latency is later than the command.
    def _note_declaration(self, agent: str, time_s: float) -> None:
        i = next(i for i, (name, _) in enumerate(self._pending) if name == agent)
        _, declaration = self._pending.pop(i)
        self.declared.append(
            RecordedDeclaration(time_s=time_s, place_m=declaration.position_world_m, confidence=declaration.confidence)
        )


# After one of these nothing that an agent does counts.
_ENDS = ("success", "time_limit", "collision", "agent_failed", "declared", "out_of_bounds")
