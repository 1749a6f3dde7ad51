"""Outcome of a run as `result.json` holds it, and its exit code."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ExitCode
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.messages import Verdict
from gslcosim.runtime.agents.session import AgentSessions
from gslcosim.runtime.agents.validator import AgentFault
from gslcosim.runtime.digest import RunDigest
from gslcosim.runtime.processes.sandbox.selection import is_sandboxed
from gslcosim.runtime.run_dir import RunManifest
from gslcosim.scenario import Scenario
from gslcosim.validity.conduct import INTERNAL_KEYS
from gslcosim.validity.findings import Validity, assess_run


@dataclass(frozen=True, kw_only=True)
class ServiceFault:
    """Fault that makes a run invalid: the participant, its last tick, and the reason."""

    participant: str
    tick: int
    text: str
    exit_code: ExitCode = ExitCode.FAULT


@dataclass(kw_only=True)
class RunOutcome:
    """Outcome of a run: a verdict with digests, or the fault that ended it."""

    ticks_flown: int = 0
    flight_wall_s: float = 0.0
    start_up_s: float = 0.0
    # For the environment and its kernels, before anything of the run was started.
    preparation_s: float = 0.0
    verdict: Verdict | None = None
    digest: RunDigest | None = None
    fault: ServiceFault | None = None
    is_interrupted: bool = False
    # True where the run ended at the requested tick, before its verdict.
    is_cut: bool = False
    agent_faults: list[AgentFault] = field(default_factory=list[AgentFault])
    timing: dict[str, Mapping[str, int]] = field(default_factory=dict[str, Mapping[str, int]])
    # Summaries of participants, by key of the result.
    summary: Mapping[str, Any] = field(default_factory=dict[str, Any])
    # Wall time of each decision of an agent [s].
    decisions_s: list[float] = field(default_factory=list[float])
    # Confinement of each agent's process, by agent.
    sandboxes: Mapping[str, str] = field(default_factory=dict[str, str])

    def collect(
        self,
        sessions: AgentSessions,
        *,
        verdict: Verdict | None,
        reached_tick: int,
        timing: Mapping[str, Mapping[str, int]],
        summaries: Iterable[Mapping[str, Any]],
    ) -> None:
        """Add the verdict, or the tick reached without one, and the accounts of agents and services."""
        self.verdict = verdict
        self.ticks_flown = verdict.tick if verdict else reached_tick
        self.agent_faults = sessions.faults
        self.decisions_s = [taken_s for session in sessions.values() for taken_s in session.decisions_s]
        self.timing = dict(timing)
        self.summary = {key: value for summary in summaries for key, value in summary.items()}

    @property
    def is_valid(self) -> bool:
        """True when the run counts."""
        return self.verdict is not None and self.digest is not None and self.fault is None and not self.is_interrupted

    def require_reason(self) -> None:
        """Put the supervisor at fault for an end without a reason."""
        if not (self.is_valid or self.is_interrupted or self.is_cut) and self.fault is None:
            lacking = "a verdict" if self.verdict is None else "a digest"
            text = f"expected a verdict and a digest, an interruption or a fault, found none: {lacking} is missing."
            self.fault = ServiceFault(participant="supervisor", tick=self.ticks_flown, text=text)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command line."""
        if self.is_interrupted:
            return ExitCode.INTERRUPTED
        if self.fault is not None:
            return self.fault.exit_code
        if self.is_cut:
            return ExitCode.SUCCESS
        if self.verdict is None or self.digest is None:
            return ExitCode.FAULT
        return ExitCode.SUCCESS if self.verdict.end_reason == "success" else ExitCode.AGENT_FAILED

    def assess(self, scenario: Scenario, environments: Sequence[Path], manifest: RunManifest | None = None) -> Validity:
        """Return the findings for or against the run's figures.

        Args:
            environments: The folder of its environment, and those that events made of it.
        """
        return assess_run(
            scenario,
            environments,
            summary=self.summary,
            n_ticks=self.ticks_flown + 1,
            sandboxes=self.sandboxes,
            unconfined=[name for name, words in self.sandboxes.items() if not is_sandboxed(words)],
            is_complete=self.is_valid,
            manifest=manifest,
        )

    def as_result(self, scenario: Scenario, *, run_id: str, wall_s: float, validity: Validity) -> dict[str, Any]:
        """Return the content of `result.json`."""
        tick_ns = scenario.tick_ns
        sim_time_s = seconds_from_ticks(self.ticks_flown, tick_ns)
        factor = sim_time_s / self.flight_wall_s if self.flight_wall_s > 0 else 0.0
        return {
            "schema": "gslcosim/result/1",
            "run_id": run_id,
            "scenario": scenario.name,
            "seed": scenario.seed,
            "valid": self.is_valid,
            "validity": validity.as_fields(),
            "end_reason": self._end_reason(),
            "sim_time_s": sim_time_s,
            "wall_time_s": round(wall_s, 3),
            "preparation_s": round(self.preparation_s, 3),
            "start_up_s": round(self.start_up_s, 3),
            "flight_wall_s": round(self.flight_wall_s, 3),
            "real_time_factor": round(factor, 1),
            "ticks": self.ticks_flown,
            "digest": self.digest.hex if self.digest else None,
            "resends": sum(timing.get("n_resends", 0) for timing in self.timing.values()),
            "faults": self._faults(),
            "sandboxes": dict(self.sandboxes),
            "agents": self._agents(scenario),
            **{key: value for key, value in self.summary.items() if key not in INTERNAL_KEYS},
            "timing_us_per_tick": {name: _get_per_tick_us(timing) for name, timing in self.timing.items()},
        }

    # With the settings and grants of each, without which figures of two runs cannot be compared.
    def _agents(self, scenario: Scenario) -> list[dict[str, Any]]:
        specs, methods = {agent.name: agent for agent in scenario.agents}, scenario.methods
        return [
            {
                **agent.model_dump(),
                "method": methods[agent.name],
                "knows": list(specs[agent.name].knows.granted),
                "parameters": specs[agent.name].parameters,
            }
            for agent in (self.verdict.agents if self.verdict else ())
        ]

    def _end_reason(self) -> str:
        if self.is_interrupted:
            return "interrupted"
        if self.is_cut:
            return "cut"
        if self.fault is not None:
            return "timeout" if self.fault.exit_code is ExitCode.TIMEOUT else "simulation_fault"
        return self.verdict.end_reason if self.verdict else "simulation_fault"

    def _faults(self) -> list[dict[str, Any]]:
        faults: list[dict[str, Any]] = []
        if self.fault is not None:
            faults.append({"participant": self.fault.participant, "tick": self.fault.tick, "text": self.fault.text})
        faults += [{"participant": f"agent {f.agent}", "tick": f.tick, "text": f.text} for f in self.agent_faults]
        return faults


def _get_per_tick_us(timing: Mapping[str, int]) -> dict[str, float]:
    n_steps = max(timing.get("n_steps", 0), 1)
    return {
        kind.removesuffix("_ns"): round(total / n_steps / 1000, 1)
        for kind, total in timing.items()
        if kind.endswith("_ns")
    }
