"""Replay of a run: its recorded commands stand in for the agents."""

import queue
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from gslcosim.base.errors import ExitCode, GslCosimError, UsageError
from gslcosim.base.processes import Interruption
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.runtime.agents.session import (
    AgentLost,
    AgentSessions,
    AgentTransport,
    CommandReceived,
    EventSink,
    ObservationOrHead,
    build_session,
)
from gslcosim.runtime.agents.validator import RecordedCommands
from gslcosim.runtime.in_process import InProcessRun
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.replay.compare import Divergence, find_repeated_divergence
from gslcosim.runtime.replay.past_run import PastRun, find_environment, find_snapshot_before
from gslcosim.runtime.replay.snapshot import Snapshot
from gslcosim.runtime.run import OpenRun, RunPlan
from gslcosim.runtime.services import build_dataflow
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult, RunStatus
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import RecordingSpec, SnapshotsSpec


@dataclass(frozen=True, kw_only=True)
class ReplayResult:
    """Replayed run, and its first difference from the past one; `n_ticks` of both were compared.

    The run began at `snapshot`, or without one at its start; `note` is the reason why an existing one was not used.
    """

    flight: RunResult
    divergence: Divergence | None
    n_ticks: int
    snapshot: Snapshot | None = None
    note: str = ""

    @property
    def exit_code(self) -> int:
        """The exit code of the command line."""
        if self.divergence is not None:
            return ExitCode.DIVERGENCE
        ended_well = (ExitCode.SUCCESS, ExitCode.AGENT_FAILED)
        return ExitCode.SUCCESS if self.flight.exit_code in ended_well else self.flight.exit_code


class RecordedTransport(AgentTransport):
    """Transport that answers for an agent with recorded commands, or without them never; see `AgentTransport`."""

    def __init__(self, agent: str, commands: Mapping[int, Command] | None, put: EventSink) -> None:
        self._agent = agent
        self._commands = commands
        self._put = put

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Answer where a command was due."""
        del payload
        if not observation.awaiting_command or self._commands is None:
            return
        command = self._commands.get(observation.tick)
        if command is None:
            reason = f"inputs.log: expected a command for tick {observation.tick}, found none."
            self._put(AgentLost(agent=self._agent, reason=reason))
        elif command.kind == "failed":
            self._put(AgentLost(agent=self._agent, reason="the agent was gone from here on."))
        else:
            self._put(CommandReceived(agent=self._agent, payload=codec.encode(command), decided_in_s=0.0))


def replay_run(
    past: PastRun,
    *,
    runs_dir: Path,
    recording: Mapping[str, float | bool] | None = None,
    until_s: float | None = None,
    snapshots_every_s: float | None = None,
    uses_snapshots: bool = True,
    report: Callable[[RunStatus], None] = lambda _: None,
) -> ReplayResult:
    """Repeat a run in this process, without its agents, and compare it with the past one to the bit.

    A run without a verdict is replayed up to the last tick of all its services.

    Args:
        recording: Keys of the scenario's `recording` that are others now, such as `from_s`.
        until_s: End [s of simulated time]; absent: that of the run.
        snapshots_every_s: Period of snapshots [s]; absent: that of the run.
        uses_snapshots: Allows a start at a snapshot before `recording.from_s`, where there is one.
    """
    past.check_flown_here()
    began = time.perf_counter()
    scenario = _change_recording(past, recording or {}, snapshots_every_s)
    from_tick = ticks_from_seconds(scenario.recording.from_s, scenario.tick_ns) if uses_snapshots else 0
    snapshot, note = find_snapshot_before(past, from_tick) if from_tick else (None, "")
    until_tick = _find_last_tick(past, until_s)
    plan = RunPlan(
        scenario=scenario,
        environment_dir=find_environment(past, report),
        runs_dir=runs_dir,
        directory=past.directory,
        processes="one",
        began=began,
        origin={"replay_of": past.run_dir.run_id},
        snapshot=snapshot,
    )
    with OpenRun(plan, report) as run:
        run.outcome = _execute(past, run.prepare(), until_tick, run.report)
    divergence, n_ticks, now = None, 0, run.outcome.digest
    if past.digest is not None and now is not None:
        last_tick = now.final_tick if run.outcome.is_cut else past.digest.final_tick
        scenarios, n_ticks = (past.scenario, scenario), last_tick + 1
        divergence = find_repeated_divergence(past.digest, now, last_tick=last_tick, scenarios=scenarios)
    return ReplayResult(flight=run.result, divergence=divergence, n_ticks=n_ticks, snapshot=snapshot, note=note)


def _change_recording(past: PastRun, changes: Mapping[str, float | bool], snapshots_every_s: float | None) -> Scenario:
    plain = {**past.scenario.recording.model_dump(), **changes}
    try:
        update: dict[str, object] = {"recording": RecordingSpec.model_validate(plain)}
        if snapshots_every_s is not None:
            update["snapshots"] = SnapshotsSpec(every_s=snapshots_every_s)
        scenario = past.scenario.without_live_keys().model_copy(update=update)
        build_dataflow(scenario)
    except ValidationError as error:
        raise UsageError("\n".join(f"recording: {problem['msg']}" for problem in error.errors())) from error
    except GslCosimError as error:
        raise UsageError(str(error)) from error
    return scenario


# None where the run's own verdict ends it.
def _find_last_tick(past: PastRun, until_s: float | None) -> int | None:
    if until_s is None:
        return None if past.digest is not None else past.last_tick
    tick = ticks_from_seconds(until_s, past.scenario.tick_ns)
    if not 0 < tick <= past.last_tick:
        last_s = past.last_tick * past.scenario.tick_ns / 1e9
        raise UsageError(f"--until {until_s:g}: expected a time above 0 and up to the run's end at {last_s:g} s.")
    return tick


def _execute(past: PastRun, setup: RunSetup, until_tick: int | None, report: Callable[[RunStatus], None]) -> RunOutcome:
    agents = AgentSessions(queue.SimpleQueue())
    # An agent in free mode has no due commands: only its session recorded the ticks of its commands.
    recorded = replace(setup, past=RecordedCommands(commands=past.commands, until_tick=past.last_tick + 1))
    for agent in setup.scenario.agents:
        commands = None if agent.is_free else past.commands.get(agent.name, {})
        transport = RecordedTransport(agent.name, commands, agents.events.put)
        agents[agent.name] = build_session(agent, recorded if agent.is_free else setup, transport)
        agents[agent.name].is_ready = True
    with Interruption() as interruption:
        return InProcessRun(setup, agents, report, until_tick=until_tick).fly(interruption.is_set)
