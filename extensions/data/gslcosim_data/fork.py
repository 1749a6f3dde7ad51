"""Fork of a run: repeated up to a tick, and changed from there on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gslcosim.base.errors import ExitCode, ScenarioError, UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.ticks import seconds_from_ticks, ticks_from_seconds
from gslcosim.contract import codec, keys
from gslcosim.contract.environment_messages import EVENTS
from gslcosim.runtime.agents.validator import RecordedCommands
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.processes.fork_server import ForkServer
from gslcosim.runtime.replay.compare import Divergence, find_repeated_divergence
from gslcosim.runtime.replay.past_run import PastRun, find_environment, find_snapshot_before
from gslcosim.runtime.replay.snapshot import Snapshot
from gslcosim.runtime.run import PriorRun, run_scenario
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.status import RunResult, RunStatus
from gslcosim.scenario import LoadedScenario
from gslcosim.scenario.loader import Check, resolve_values
from gslcosim.scenario.models.scenario import Processes
from gslcosim.scenario.overrides import apply_overrides
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim.scenario.serialization import plain_values, read_yaml
from gslcosim_data.fork_changes import check_changes, find_changed_paths


@dataclass(frozen=True, kw_only=True)
class Fork:
    """A run to fork, the tick from which agents' own answers count, and the scenario from there on.

    The fork runs from `snapshot`, or from the start if absent; `note` is the reason why an existing one is not used.
    """

    past: PastRun
    at_tick: int
    loaded: LoadedScenario
    snapshot: Snapshot | None
    note: str = ""

    @property
    def origin(self) -> dict[str, Any]:
        """Origin of the new run, for its manifest."""
        past, scenario = self.past, self.loaded.scenario
        return {
            "run": past.run_dir.run_id,
            "digest": past.digest and past.digest.hex,
            "tick": self.at_tick,
            "at_s": seconds_from_ticks(self.at_tick, scenario.tick_ns),
            **({} if self.snapshot is None else {"snapshot_tick": self.snapshot.tick}),
            "changed": list(find_changed_paths(plain_values(past.scenario), plain_values(scenario))),
        }


@dataclass(frozen=True, kw_only=True)
class ForkResult:
    """Result of a fork: its run, and the place where its past differs from that of the original, which is a fault."""

    flight: RunResult
    divergence: Divergence | None

    @property
    def exit_code(self) -> int:
        """The exit code of the command line."""
        return self.flight.exit_code if self.divergence is None else ExitCode.DIVERGENCE


def prepare_fork(
    past: PastRun,
    *,
    at_s: float,
    overrides: Sequence[str] = (),
    checks: Sequence[Check] = (),
    uses_snapshots: bool = True,
) -> Fork:
    """Return a fork, checked.

    Args:
        at_s: From when on agents' own answers count [s of simulated time].
        overrides: Values to replace in its scenario, such as `agents[0].parameters.step_m=2`.
        checks: Further rules of scenarios; see `load_scenario`.
        uses_snapshots: Allows a start at a snapshot of the run, where there is one at or before the time.
    """
    at_tick = ticks_from_seconds(at_s, past.scenario.tick_ns)
    if not 0 < at_tick <= past.last_tick:
        last_s = seconds_from_ticks(past.last_tick, past.scenario.tick_ns)
        raise UsageError(
            f"--at {at_s:g}: expected a time above 0 and up to the end of {past.run_dir.run_id} at {last_s:g} s."
        )
    check_inputs(past)
    loaded = _load_forked_scenario(past, overrides, checks)
    check_changes(past.scenario, loaded.scenario, at_tick=at_tick)
    snapshot, note = find_snapshot_before(past, at_tick) if uses_snapshots else (None, "")
    # A snapshot holds the events of the run.
    if snapshot is not None and past.scenario.events != loaded.scenario.events:
        note = (
            f"The snapshot of {past.run_dir.run_id} at tick {snapshot.tick} cannot be used: "
            "it knows of the run's events only, and those of the fork are others."
        )
        snapshot = None
    fork = Fork(past=past, at_tick=at_tick, loaded=loaded, snapshot=snapshot, note=note)
    _check_agents(fork)
    return fork


def check_inputs(past: PastRun) -> None:
    """Compare `inputs.log` of a run with the chains of commands in `digest.json`, if there is one."""
    past.check_flown_here()
    if past.digest is None:
        return
    for agent in past.scenario.agents:
        trail = past.digest.trails.get(keys.command(agent.name), HashChain())
        found = HashChain()
        for tick, command in sorted(past.commands.get(agent.name, {}).items()):
            found.append(tick, codec.encode(command))
        found = found.until(past.last_tick)
        if (found.ticks, found.links) != (trail.ticks, trail.links):
            raise UsageError(
                f"{past.run_dir.run_id}: expected the {len(trail.ticks)} commands of {agent.name} in inputs.log that "
                f"digest.json has a hash of, were others ({len(found.ticks)}). Bring back the files as the run has "
                f"left them.\nFile: {past.run_dir.inputs}"
            )


def run_fork(
    fork: Fork,
    *,
    runs_dir: Any,
    processes: Processes | None = None,
    fork_server: ForkServer | None = None,
    report: Callable[[RunStatus], None] = lambda _: None,
) -> ForkResult:
    """Run a fork and compare its past bit by bit with that of the original run.

    Args:
        processes: Distribution of the run over processes; absent: that of the scenario.
        fork_server: Forks the services; absent: one is started where it is needed.
    """
    past = fork.past
    repetition = PriorRun(
        environment_dir=find_environment(past, report),
        past=RecordedCommands(commands=past.commands, until_tick=fork.at_tick),
        origin={"fork_of": fork.origin},
        snapshot=fork.snapshot,
    )
    flight = run_scenario(
        fork.loaded,
        runs_dir=runs_dir,
        processes=processes,
        fork_server=fork_server,
        report=report,
        repetition=repetition,
    )
    return ForkResult(flight=flight, divergence=_find_past_divergence(fork, RunDir(flight.run_dir)))


def _load_forked_scenario(past: PastRun, overrides: Sequence[str], checks: Sequence[Check]) -> LoadedScenario:
    file = past.run_dir.scenario
    text = read_regular_file(file).decode()
    tree = apply_overrides(read_yaml(text, source=str(file)), overrides)
    if tree.problems or tree.block is None:
        raise InvalidScenarioError(tree.problems, name=str(file))
    try:
        scenario = resolve_values(tree.block, past.directory, source=f"{past.run_dir.run_id} as changed", checks=checks)
    except ScenarioError as error:
        if past.directory == past.run_dir.path.absolute():
            note = "Relative paths of agents start in the run's folder, as it does not say where it was flown."
            raise ScenarioError(f"{error}\n{note}") from error
        raise
    run = past.run_dir.path.absolute()
    return LoadedScenario(scenario=scenario, path=file, directory=past.directory, text=text, included=(run,))


def _check_agents(fork: Fork) -> None:
    for before, after in zip(fork.past.scenario.agents, fork.loaded.scenario.agents, strict=True):
        commands = fork.past.commands.get(before.name, {})
        failed = next((tick for tick, command in commands.items() if command.kind == "failed"), None)
        if before != after and failed is not None and failed < fork.at_tick:
            failed_s = seconds_from_ticks(failed, fork.past.scenario.tick_ns)
            raise UsageError(
                f"--at: expected a time up to {failed_s:g} s, at which {before.name} failed, to change this agent: "
                "nothing it answers afterwards counts."
            )


# Briefings and recordings may differ; everything else has to be equal.
def _find_past_divergence(fork: Fork, run_dir: RunDir) -> Divergence | None:
    if fork.past.digest is None or not run_dir.digest.is_file():
        return None
    before, now = fork.past.digest, RunDigest.load(run_dir.digest)
    scenarios = (fork.past.scenario, fork.loaded.scenario)
    other = {keys.briefing(agent.name) for agent in fork.past.scenario.agents}
    if scenarios[0].events != scenarios[1].events:
        other |= {EVENTS}
    last_tick = min(fork.at_tick - 1, now.final_tick)
    now = now.without(other, final_tick=last_tick)
    return find_repeated_divergence(before, now, last_tick=last_tick, scenarios=scenarios, other=other)
