"""A run flown again from what it has left: the commands that took effect stand in for the agents."""

import json
import queue
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending
from gslcosim.contract.schema import contract_hash
from gslcosim.environment.store import load_environment
from gslcosim.errors import ContractError, EnvironmentDataError, ExitCode, GslCosimError, UsageError
from gslcosim.generation import prepare_environment
from gslcosim.runtime.agents.desk import desk_of
from gslcosim.runtime.agents.events import AgentEvent, AgentGone, CommandCame, CommandRefused, PutEvent
from gslcosim.runtime.agents.links import Seen
from gslcosim.runtime.assembly import dataflow_of
from gslcosim.runtime.digest import Divergence, RunDigest, first_divergence
from gslcosim.runtime.flight import fly_into_folder
from gslcosim.runtime.in_process import InProcessFlight
from gslcosim.runtime.interruption import Interruption
from gslcosim.runtime.outcome import Outcome
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.status import FlightResult, FlightStatus
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import RecordingSpec
from gslcosim.ticks import ticks_from_seconds

# The port whose messages depend on how a run is recorded.
_RECORDED_PORTS = {keys.FILAMENTS}


@dataclass(frozen=True, kw_only=True)
class PastRun:
    """What a run has left, as far as it is needed to fly it again.

    `commands` are those that took effect, by agent and tick; `digest` is absent where the run came to no verdict.
    """

    run_dir: RunDir
    scenario: Scenario
    commands: Mapping[str, Mapping[int, Command]]
    digest: RunDigest | None
    last_tick: int
    environment_hash: str

    @classmethod
    def load(cls, folder: Path) -> "PastRun":
        """Read the folder of a run.

        Raises:
            UsageError: a file is missing or not what it should be, or the run spoke another contract.
        """
        run_dir = RunDir(folder)
        manifest, result = _json_of(folder / "manifest.json"), _json_of(folder / "result.json")
        if manifest.get("contract_hash") != contract_hash():
            raise UsageError(
                f"{folder.name}: expected a run of contract {contract_hash()}, was {manifest.get('contract_hash')}, "
                f"flown by gslcosim {manifest.get('gslcosim')}. Replay it with that version."
            )
        return cls(
            run_dir=run_dir,
            scenario=run_dir.load_scenario(),
            commands=read_inputs(run_dir.inputs),
            digest=RunDigest.load(run_dir.digest) if run_dir.digest.is_file() else None,
            last_tick=int(result.get("ticks", 0)),
            environment_hash=str(manifest.get("environment_hash")),
        )


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """A run flown again: the flight, and where it differs from the past one; `n_ticks` of both were compared."""

    flight: FlightResult
    divergence: Divergence | None
    n_ticks: int

    @property
    def exit_code(self) -> int:
        """The exit code of the command line."""
        if self.divergence is not None:
            return ExitCode.DIVERGENCE
        ended_well = (ExitCode.SUCCESS, ExitCode.AGENT_FAILED)
        return ExitCode.SUCCESS if self.flight.exit_code in ended_well else self.flight.exit_code


def read_inputs(path: Path) -> dict[str, dict[int, Command]]:
    """Return the commands of `inputs.log` by agent and tick.

    Raises:
        UsageError: it is missing, or a line of it is no command.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise UsageError(f"{path.parent.name}: expected an inputs.log, {error.strerror}.\nFile: {path}") from error
    commands: dict[str, dict[int, Command]] = {}
    for number, line in enumerate(lines, 1):
        try:
            command, agent = codec.decode_json(Command, line), str(json.loads(line)["agent"])
        except (ContractError, KeyError, ValueError) as error:
            raise UsageError(f"{path}:{number}: expected an agent's command, was {line[:60]!r} ({error}).") from error
        commands.setdefault(agent, {})[command.tick] = command
    return commands


class ReplayLink:
    """Answers for an agent with what it has answered in the past; see `AgentLink`."""

    may_lose = False

    def __init__(self, agent: str, commands: Mapping[int, Command], put: PutEvent) -> None:
        self._agent = agent
        self._commands = commands
        self._put = put

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Do nothing: nobody decides anew."""

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Answer where the agent was asked."""
        del payload
        if not observation.awaiting_command:
            return
        command = self._commands.get(observation.tick)
        if command is None:
            reason = f"inputs.log: expected a command for tick {observation.tick}, found none."
            self._put(AgentGone(agent=self._agent, reason=reason))
        elif command.kind == "failed":
            self._put(AgentGone(agent=self._agent, reason="the agent was gone from here on."))
        else:
            self._put(CommandCame(agent=self._agent, payload=codec.encode(command), decided_in_s=0.0))

    def repeat(self) -> None:
        """Do nothing: no message gets lost."""

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Do nothing: it waits until it is asked."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Do nothing: nobody is there."""


def replay(
    past: PastRun,
    *,
    runs_dir: Path,
    recording: Mapping[str, float | bool] | None = None,
    until_s: float | None = None,
    report: Callable[[FlightStatus], None] = lambda _: None,
) -> Replayed:
    """Fly a run again in this process, without its agents, and compare it with the past one to the bit.

    A run that came to no verdict is flown as far as all its services had come.

    Args:
        past: The run.
        runs_dir: Where the new run's folder is made.
        recording: Keys of the scenario's `recording` that are others now, such as `gas_every_s`.
        until_s: Where to end [s of simulated time]; absent: where the run ended.
        report: Is told how preparation and flight go.

    Raises:
        UsageError: it cannot be recorded like that, or the end is none of the run's.
        EnvironmentDataError: the room is not the one that was flown in.
    """
    began = time.perf_counter()
    scenario = _recorded_anew(past, recording or {})
    until_tick = _last_tick(past, until_s)
    environment_dir = _environment_of(past, report)
    outcome, flight = fly_into_folder(
        scenario,
        environment_dir,
        lambda setup, told: _fly(past, setup, until_tick, told),
        runs_dir=runs_dir,
        processes="one",
        began=began,
        report=report,
        origin=past.run_dir,
    )
    divergence, n_ticks = _compare(past, scenario, outcome)
    return Replayed(flight=flight, divergence=divergence, n_ticks=n_ticks)


def _recorded_anew(past: PastRun, changes: Mapping[str, float | bool]) -> Scenario:
    plain = {**past.scenario.recording.model_dump(), **changes}
    try:
        scenario = past.scenario.model_copy(update={"recording": RecordingSpec.model_validate(plain)})
        dataflow_of(scenario)
    except ValidationError as error:
        raise UsageError("\n".join(f"recording: {problem['msg']}" for problem in error.errors())) from error
    except GslCosimError as error:
        raise UsageError(str(error)) from error
    return scenario


# None where the run's own verdict ends it.
def _last_tick(past: PastRun, until_s: float | None) -> int | None:
    if until_s is None:
        return None if past.digest is not None else past.last_tick
    tick = ticks_from_seconds(until_s, past.scenario.tick_ns)
    if not 0 < tick <= past.last_tick:
        last_s = past.last_tick * past.scenario.tick_ns / 1e9
        raise UsageError(f"--until {until_s:g}: expected a time above 0 and up to the run's end at {last_s:g} s.")
    return tick


def _environment_of(past: PastRun, report: Callable[[FlightStatus], None]) -> Path:
    folder = Path(str(_json_of(past.run_dir.setup).get("environment")))
    try:
        environment = load_environment(folder)
    except EnvironmentDataError:
        # It was in the cache, and is made anew.
        folder = prepare_environment(
            past.scenario,
            scenario_dir=past.run_dir.path,
            progress=lambda text, fraction: report(FlightStatus(state="preparing", text=text, fraction=fraction)),
        )
        environment = load_environment(folder)
    if environment.content_hash != past.environment_hash:
        raise EnvironmentDataError(
            f"{folder}: expected the environment {past.environment_hash}, in which the run was flown, was "
            f"{environment.content_hash}. Bring back the files or the version of gslcosim that made it."
        )
    return folder.resolve()


def _fly(past: PastRun, setup: Setup, until_tick: int | None, report: Callable[[FlightStatus], None]) -> Outcome:
    events: queue.SimpleQueue[AgentEvent] = queue.SimpleQueue()
    desks = {
        agent.name: desk_of(agent, setup, ReplayLink(agent.name, past.commands.get(agent.name, {}), events.put))
        for agent in setup.scenario.agents
    }
    for desk in desks.values():
        desk.is_ready = True
    with Interruption() as interruption:
        flight = InProcessFlight(setup, desks, events, report, until_tick=until_tick)
        return flight.fly(interruption.is_set)


def _compare(past: PastRun, scenario: Scenario, outcome: Outcome) -> tuple[Divergence | None, int]:
    if past.digest is None or outcome.digest is None:
        return None, 0
    is_recorded_alike = past.scenario.recording == scenario.recording
    ports = {*past.digest.trails, *outcome.digest.trails} - (set() if is_recorded_alike else _RECORDED_PORTS)
    final_tick = outcome.digest.final_tick if outcome.is_cut else past.digest.final_tick
    before, now = (
        RunDigest.of({port: trail for port, trail in digest.trails.items() if port in ports}, digest.writer_of, tick)
        for digest, tick in ((past.digest, final_tick), (outcome.digest, outcome.digest.final_tick))
    )
    return first_divergence(before, now), final_tick + 1


def _json_of(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path.parent.name}: expected a run with a {path.name} ({error}).\nFile: {path}") from error
    if not isinstance(content, dict):
        raise UsageError(f"{path}: expected a JSON object, was {type(content).__name__}.")
    return cast(dict[str, Any], content)
