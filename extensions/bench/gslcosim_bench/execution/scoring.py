"""Scoring of a trial: from its messages to time series, its row and its track."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gslcosim.base.quantities import GAS_QUANTITIES, Vec3
from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    AgentResult,
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
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.scenario import Scenario
from gslcosim.validity.conduct import GAS_CONTACT_PPM
from gslcosim.validity.findings import Validity
from gslcosim_bench.cases.models import Trial
from gslcosim_bench.metrics.beliefs import score_belief
from gslcosim_bench.metrics.gas import first_contact_s, tracking_ratio
from gslcosim_bench.metrics.path_metrics import (
    directness,
    find_leading_agent,
    score_declarations,
    spl,
    times_within_s,
    tracking_phase,
    travel_overhead,
)
from gslcosim_bench.metrics.series import select_samples
from gslcosim_bench.store import TRIAL_COLUMNS, Tracks

_NAN = float("nan")
# After one of these nothing that an agent does counts.
_ENDS = ("success", "time_limit", "collision", "agent_failed", "declared", "out_of_bounds")
Row = dict[str, Any]
"""A value for each column of `trials.parquet`; None where it is absent."""
COMPLETED = "flown"


def counted_time_s(*, success: bool, time_to_source_s: float | None, limit_s: float) -> float:
    """Return the time of a run: min(time to source, T) with success, T for every failure, collisions too [s].

    Args:
        success: Whether the source was found.
        time_to_source_s: When [s]; absent without success.
        limit_s: Time limit T [s].
    """
    return min(time_to_source_s, limit_s) if success and time_to_source_s is not None else limit_s


def score(
    *, success: bool, time_s: float, limit_s: float, n_false_declarations: int = 0, n_collisions: int = 0
) -> float:
    """Return the score of a run.

    q = S (1 - t / (2 T)) / 2^f, and 0 after a collision        dimensionless; 0 without success, else up to 1

    Without false declarations a success has 1/2 to 1: no success is worth less than half, so that a slow one is
    better than none.

    Args:
        success: S, 1 with success, else 0.
        time_s: Time to source t [s], 0 to T.
        limit_s: Time limit T [s], > 0.
        n_false_declarations: Declarations of wrong places, f.
        n_collisions: Collisions of all agents.

    Source:
        Chosen; a success counts more than any time, and a false alarm costs half.
    Held by:
        extensions/bench/tests/unit/execution/test_scoring.py
    """
    if not 0.0 <= time_s <= limit_s or limit_s <= 0.0:
        raise ValueError(
            f"score: expected a time from 0 to the limit of {limit_s:g} s, found {time_s:g} s. "
            "Count a failure with the limit."
        )
    if not success or n_collisions:
        return 0.0
    return (1.0 - 0.5 * time_s / limit_s) * 0.5**n_false_declarations


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
            if reading.quantity in GAS_QUANTITIES and reading.values:
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


def row_without_result(trial: Trial, environment_hash: str, *, status: str, fault: str) -> Row:
    """Return the row of a trial that brought no result, and why.

    Args:
        status: `crashed`, `hung`, `out_of_memory` or `fault`.
        fault: What is known of it, with the end of its log.
    """
    row: Row = dict.fromkeys((column.name for column in TRIAL_COLUMNS), None)
    scenario = trial.resolved
    first, (source, *_) = scenario.agents[0], scenario.gas.sources
    limit_s = scenario.referee.stop.time_limit_s
    success = scenario.referee.success
    return row | {
        **{key: getattr(trial, key) for key in ("case", "scenario", "family", "varied", "repetition", "entry")},
        "trial": trial.id,
        "is_control": trial.is_control,
        "seed": scenario.seed,
        "gas_seed": scenario.gas.seed,
        "knows": "+".join(first.knows.granted),
        "sensors": "+".join(sensor.model for sensor in first.sensors),
        "n_robots": len(scenario.agents),
        "environment_hash": environment_hash,
        "time_limit_s": limit_s,
        "within_m": success.within_m,
        "success_of": success.of,
        **dict(zip(("start_x_m", "start_y_m", "start_z_m"), first.vehicle.start_m, strict=True)),
        **dict(zip(("source_x_m", "source_y_m", "source_z_m"), source.position_m, strict=True)),
        "status": status,
        "fault": fault,
        "agent_faults": "",
        "sandbox": "",
        "digest": "",
        "outcome": "",
        "success": False,
        "time_s": limit_s,
        "score": 0.0,
        "share_arrived": 0.0,
        "spl": 0.0,
        "declared": False,
        "declared_confidence": 0.0,
        "n_false_declarations": 0,
    }


def build_row(trial: Trial, environment_hash: str, outcome: RunOutcome, watch: SeriesCollector) -> Row:
    """Return the row of a run; one that ended with a fault of the simulation has no result."""
    sandbox = "; ".join(sorted(set(outcome.sandboxes.values())))
    faults = "\n".join(f"{fault.agent}: {fault.text}" for fault in outcome.agent_faults)
    if outcome.fault is not None or outcome.verdict is None or outcome.digest is None:
        text = f"{outcome.fault.participant}: {outcome.fault.text}" if outcome.fault else "the flight was interrupted"
        row = row_without_result(trial, environment_hash, status="fault", fault=text)
        return row | {"agent_faults": faults, "sandbox": sandbox}
    row = row_without_result(trial, environment_hash, status=COMPLETED, fault="")
    results = {result.name: result for result in outcome.verdict.agents}
    names = list(results)
    best = names[
        find_leading_agent(
            [results[name].time_to_source_s for name in names], [min(watch.agents[name].distance_m) for name in names]
        )
    ]
    success = any(result.success for result in results.values())
    time_s = counted_time_s(
        success=success, time_to_source_s=results[best].time_to_source_s, limit_s=row["time_limit_s"]
    )
    row |= {
        "agent_faults": faults,
        "sandbox": sandbox,
        "digest": outcome.digest.hex,
        "outcome": outcome.verdict.end_reason,
        "success": success,
        "time_to_source_s": results[best].time_to_source_s,
        "time_s": time_s,
        "end_s": outcome.ticks_flown * trial.resolved.tick_ms / 1000,
        "share_arrived": sum(result.success for result in results.values()) / len(results),
        "n_collisions": watch.n_collisions,
        "n_refusals": watch.n_refusals,
        "total_path_length_m": math.fsum(result.path_length_m for result in results.values()),
        **_build_path_figures(trial, results[best], watch.agents[best]),
        **_nearness(watch),
        **_declarations(trial, watch),
        **_belief(trial, watch, best),
    }
    row["score"] = score(
        success=success,
        time_s=time_s,
        limit_s=row["time_limit_s"],
        n_false_declarations=row["n_false_declarations"],
        # Where a scenario lets vehicles go on after a collision, it is no offence either.
        n_collisions=row["n_collisions"] if trial.resolved.referee.stop.on_collision else 0,
    )
    return row


def build_validity_figures(validity: Validity) -> Row:
    """Return the columns of a row that say whether its figures are valid."""
    found = validity.as_fields()
    agents = found.get("commands", {}).get("agents", {}).values()
    uses = [use for sensors in found.get("sensors", {}).get("agents", {}).values() for use in sensors.values()]
    return {
        "validity": validity.verdict,
        "warnings": "\n".join(f"{warning.about}: {warning.text}" for warning in validity.warnings),
        "wind_settled": found["wind"]["settled"],
        "wind_uncertainty_frac": found["wind"]["uncertainty_frac"],
        "share_refused": max((each["refused"] / max(each["commands"], 1) for each in agents), default=None),
        "share_saturated": max((use["saturated_frac"] for use in uses), default=None),
        "share_warming_up": max((use["warming_up_frac"] for use in uses), default=None),
    }


def _build_path_figures(trial: Trial, result: AgentResult, watch: AgentSeries) -> Row:
    sources_m = [source.position_m for source in trial.resolved.gas.sources]
    is_horizontal = trial.resolved.referee.success.is_horizontal
    contact_s = first_contact_s(watch.t_s, watch.gas_ppm, GAS_CONTACT_PPM)
    phase = tracking_phase(watch.t_s, watch.position_m, contact_s)
    direct = directness(phase, sources_m, is_horizontal=is_horizontal) if phase is not None else None
    return {
        "steps": result.steps,
        "path_length_m": result.path_length_m,
        "shortest_path_m": result.shortest_path_m,
        "travel_overhead": travel_overhead(result.path_length_m, result.shortest_path_m, success=result.success),
        "spl": spl(result.path_length_m, result.shortest_path_m, success=result.success),
        "directness": direct.towards if direct else None,
        "tracking_ratio": tracking_ratio(watch.t_s, watch.gas_ppm, GAS_CONTACT_PPM),
    }


def _nearness(watch: SeriesCollector) -> Row:
    times = [times_within_s(agent.t_s, agent.distance_m) for agent in watch.agents.values()]
    firsts = [min((t for t in at if t is not None), default=None) for at in zip(*times, strict=True)]
    contacts = [first_contact_s(agent.t_s, agent.gas_ppm, GAS_CONTACT_PPM) for agent in watch.agents.values()]
    names = ("time_within_5_m_s", "time_within_2_m_s", "time_within_1_m_s", "time_within_05_m_s")
    return {
        "nearest_m": min(min(agent.distance_m) for agent in watch.agents.values()),
        "first_contact_s": min((t for t in contacts if t is not None), default=None),
        **dict(zip(names, firsts, strict=True)),
    }


def _declarations(trial: Trial, watch: SeriesCollector) -> Row:
    rules = trial.resolved.referee.success
    figures = score_declarations(
        [declared.time_s for declared in watch.declared],
        [declared.place_m for declared in watch.declared],
        [declared.confidence for declared in watch.declared],
        [source.position_m for source in trial.resolved.gas.sources],
        within_m=rules.within_m,
        is_control=trial.is_control,
        is_horizontal=rules.is_horizontal,
    )
    return {
        "declared": bool(watch.declared),
        "first_declared_s": figures.first_declared_s,
        "declared_confidence": figures.confidence,
        "declared_error_m": figures.error_m,
        "declared_error_in_plane_m": figures.error_in_plane_m,
        "n_false_declarations": figures.n_false,
    }


# Of the agent that stands for the team, or of the first that has one.
def _belief(trial: Trial, watch: SeriesCollector, best: str) -> Row:
    beliefs = (watch.agents[name].last_belief for name in (best, *watch.agents))
    belief = next((belief for belief in beliefs if belief is not None), None)
    if belief is None:
        return {}
    sources_m = [source.position_m for source in trial.resolved.gas.sources]
    figures = score_belief(belief, sources_m, within_m=trial.resolved.referee.success.within_m)
    return {
        "belief_distance_m": figures.expected_distance_m,
        "belief_error_m": figures.error_m,
        "belief_mass_near": figures.mass_near,
        "belief_entropy_bits": figures.entropy_bits,
        "belief_minus_log_p": figures.minus_log_p,
    }


def build_tracks(watch: SeriesCollector) -> Tracks:
    """Return the thinned tracks of all agents, a value of each series for about every second and the last."""
    tracks: Tracks = {}
    for name, agent in watch.agents.items():
        kept = select_samples(agent.t_s) if agent.t_s else np.zeros(0, np.int64)
        places_m = np.asarray(agent.position_m, dtype=np.float64).reshape(-1, 3)
        series = {
            "t_s": agent.t_s,
            **dict(zip(("x_m", "y_m", "z_m"), places_m.T, strict=True)),
            "distance_m": agent.distance_m,
            "gas_ppm": agent.nose_ppm,
            "reading": agent.reading,
            "belief_distance_m": agent.belief_distance_m,
            "belief_mass_near": agent.belief_mass_near,
        }
        tracks[name] = {key: np.asarray(values, dtype=np.float32)[kept] for key, values in series.items()}
    return tracks
