"""Scoring of a trial: from its collected series to its row and its track."""

import math
from typing import Any

import numpy as np

from gslcosim.bench.cases.trials import Trial
from gslcosim.bench.execution.collector import AgentSeries, SeriesCollector
from gslcosim.bench.metrics.beliefs import score_belief
from gslcosim.bench.metrics.declarations import score_declarations
from gslcosim.bench.metrics.gas_contact import first_contact_s, tracking_ratio
from gslcosim.bench.metrics.path_metrics import (
    directness,
    find_leading_agent,
    spl,
    times_within_s,
    tracking_phase,
    travel_overhead,
)
from gslcosim.bench.metrics.scores import counted_time_s, score
from gslcosim.bench.metrics.series import select_samples
from gslcosim.bench.store.columns import TRIAL_COLUMNS, Tracks
from gslcosim.contract.messages import AgentResult
from gslcosim.runtime.outcome import RunOutcome
from gslcosim_services.referee.agent_evaluation import GAS_CONTACT_PPM

Row = dict[str, Any]
"""A value for each column of `trials.parquet`; None where it is absent."""

COMPLETED = "flown"


def row_without_result(trial: Trial, environment_hash: str, *, status: str, fault: str) -> Row:
    """Return the row of a trial that brought no result, and why.

    Args:
        trial: Which.
        environment_hash: Of its room.
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
