"""Joining a run on another host as some of its services or as one of its agents."""

import os
import queue
import signal
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.bundled import PROGRAM_ENDINGS
from gslcosim.base.errors import ScenarioError, SimulationFault, UsageError
from gslcosim.base.processes import Interruption
from gslcosim.base.spawn import check_program
from gslcosim.bus.interface import AGENT_VARIABLE, GATEWAY_VARIABLE, TOKEN_VARIABLE, Bus, JoinData
from gslcosim.bus.zenoh_bus import ZenohBus
from gslcosim.contract.participant import Core
from gslcosim.environment.generation.cache import with_variants
from gslcosim.environment.store import load_environment
from gslcosim.environment.variants import find_variants
from gslcosim.runtime.agents.loader import build_program_command, find_python_agent
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.host import Host, report_fault
from gslcosim.runtime.network import JoinFile
from gslcosim.runtime.processes.child_processes import ChildProcesses
from gslcosim.runtime.processes.current_process import keep_memory_private
from gslcosim.runtime.remote_server import (
    ProgressHandler,
    RunOffer,
    SoftwareVersions,
    fetch_environment,
    fetch_offer,
    find_local_environment,
)
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_core, build_dataflow, find_service
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario.loader import read_resolved


def build_agent_command(words: Sequence[str], *, is_behind_gateway: bool) -> list[str]:
    """Return the command line of an agent: a bundled one by its name, a file of Python, or a command as it is."""
    if not words:
        raise UsageError("gslcosim join: expected a program after agent, found none. For example agent dung_beetle.")
    is_python = len(words) == 1 and (words[0].endswith(PROGRAM_ENDINGS) or "/" not in words[0])
    if is_python:
        try:
            found = find_python_agent(words[0], Path.cwd())
        except UsageError:
            if words[0].endswith(PROGRAM_ENDINGS):
                raise
        else:
            if is_behind_gateway:
                raise UsageError(
                    f"agent: expected a command that connects to the gateway, was {words[0]!r}: Python agents attach "
                    "with start: {attach: true}, without door: tcp."
                )
            return build_program_command(found)
    check_program("agent", words, None)
    return list(words)


def join_as_agent(joined: JoinFile, command: Sequence[str], *, say: ProgressHandler) -> None:
    """Start an agent's program with its join data, and return when it has ended well; Ctrl-C ends it.

    It is not in a sandbox: this host has nothing of the run but what the agent may know. Its environment is the short
    one of all agents.
    """
    variables: dict[str, str] = {}
    if (gateway := joined.gateway) is not None:
        variables |= {GATEWAY_VARIABLE: gateway.gateway, TOKEN_VARIABLE: gateway.token}
        variables |= {AGENT_VARIABLE: ",".join(gateway.agents or [gateway.name])}
    # The end of the program, or None for a signal.
    ends: queue.SimpleQueue[tuple[int, str] | None] = queue.SimpleQueue()
    name = f"agent {joined.name}"
    with (
        Interruption(lambda: ends.put(None)),
        ChildProcesses(lambda _, code, how: ends.put((code, how)), are_foreign=True) as processes,
    ):
        processes.start(name, command, join=joined.join, variables=variables, log=None)
        say(f"{name}: started (process {processes.pids.get(name, 0)})")
        ended = ends.get()
    if ended is None:
        raise KeyboardInterrupt
    code, how = ended
    if code != 0:
        raise SimulationFault(f"{name}: the program {how}.")
    say(f"agent {joined.name}: has ended with the run")


@dataclass(frozen=True, kw_only=True)
class JoinResult:
    """Result of joining: the services, their last tick, and whether the run came to its end."""

    run_id: str
    services: tuple[str, ...]
    last_tick: int
    is_whole: bool
    n_resends: int
    run_dir: Path
    recording: Path | None


def join_as_services(
    join: JoinData, names: Sequence[str], *, runs_dir: Path, say: ProgressHandler, is_trusted: bool = False
) -> JoinResult:
    """Take part in a run as some of its services, in this one process, and return when the run is over.

    Args:
        runs_dir: Where a folder for what this host writes is made; where the run's own folder is here too, in that.
        is_trusted: Whether programs that the run's scenario names are started here, for its own models.
    """
    keep_memory_private()
    # An end by SIGTERM is reported in the same way as one by Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with ZenohBus.open_member(join) as bus:
        offer = fetch_offer(bus)
        here = SoftwareVersions.here()
        check_offer(offer, names, here)
        say(f"{offer.run_id}: joined as {', '.join(names)}")
        setup = build_joined_setup(join, offer, names, bus, runs_dir=runs_dir, say=say, is_trusted=is_trusted)
        at_fault = names[0]
        try:
            cores: list[Core] = []
            # From upstream to downstream.
            for at_fault in (name for name in offer.expected if name in names):
                if (check_host := find_service(at_fault, setup.scenario).check_host) is not None:
                    check_host(setup)
                cores.append(build_core(at_fault, setup))
            return _host_services(bus, cores, setup, offer, join.window_ticks, say)
        except UsageError:
            # The user can correct the command and join again; the run waits.
            raise
        except KeyboardInterrupt:
            report_fault(
                bus, at_fault, UsageError(f"it was ended on {socket.gethostname()}, by Ctrl-C or a signal."), tick=0
            )
            raise
        except Exception as error:
            report_fault(bus, at_fault, error, tick=0)
            raise


def check_offer(offer: RunOffer, names: Sequence[str], here: SoftwareVersions) -> None:
    """Refuse to take part if the run does not admit it, or if its digest would differ from that on one host."""
    for name in names:
        if name not in offer.expected:
            raise UsageError(
                f"expected services that the run awaits from elsewhere ({', '.join(offer.expected)}), was {name!r}."
            )
        if name in offer.present:
            raise UsageError(f"expected a service that the run still awaits, but {name} has joined it already.")
    refusal = offer.software.find_mismatch(here)
    if refusal:
        raise UsageError(f"this host: {refusal} Install the same on both.")


def build_joined_setup(
    join: JoinData,
    offer: RunOffer,
    names: Sequence[str],
    bus: Bus,
    *,
    runs_dir: Path,
    say: ProgressHandler,
    is_trusted: bool,
) -> RunSetup:
    """Return the setup of this host's services: the folder of the run and its rooms, which are fetched.

    Nothing is written but in the folder of runs and in the cache, whatever the run's host offers.
    """
    try:
        scenario = read_resolved(offer.scenario, source=f"{offer.run_id}: scenario")
    except ScenarioError as error:
        raise SimulationFault(
            f"the run's offer: expected a scenario as resolved, was another text.\n{error}"
        ) from error
    # Also where a model of the run's own has the name of one of our services.
    for own in () if is_trusted else scenario.participants:
        if own.name in names:
            raise UsageError(
                f"participants.{own.name}: expected --trusted, because the run's host says which program is started "
                f"here: {' '.join(own.start.words)}"
            )
    situations = find_variants(scenario)[1:]
    if len(situations) != len(offer.later_rooms):
        raise SimulationFault(
            f"the run's offer: expected {len(situations)} later rooms, as its scenario has, was "
            f"{len(offer.later_rooms)}."
        )
    room, *later = (
        find_local_environment(each) or fetch_environment(bus, each, say) for each in (offer, *offer.later_rooms)
    )
    shared = Path(join.run_dir) if join.run_dir is not None else None
    if shared is not None and _is_run_dir(shared, offer):
        run_dir = RunDir(shared)
    else:
        run_dir = RunDir(runs_dir / offer.run_id)
        _check_is_new(run_dir, offer)
        (run_dir.path / "logs").mkdir(parents=True, exist_ok=True)
        run_dir.replace(run_dir.scenario.name, offer.scenario)
    later_rooms = dict(zip(situations, later, strict=True))
    return RunSetup(
        run_dir=run_dir,
        scenario=scenario,
        environment_dir=room.resolve(),
        environment=with_variants(load_environment(room), later_rooms),
        later_rooms=later_rooms,
        directory=Path.cwd(),
        paced_from_tick=offer.paced_from_tick,
    )


# Several services may join one after another; files of another run are not overwritten.
def _check_is_new(run_dir: RunDir, offer: RunOffer) -> None:
    path = run_dir.path
    if not os.path.lexists(path):
        return
    is_folder = path.is_dir() and not path.is_symlink()
    # A folder that another `gslcosim join` is still filling holds no scenario yet.
    is_half = is_folder and all(entry.name == "logs" or entry.name.startswith(".") for entry in path.iterdir())
    if not is_half and not (is_folder and _is_run_dir(path, offer)):
        raise UsageError(
            f"The folder of --runs-dir already has another {offer.run_id}. Move it away, or choose another folder."
            f"\nFolder: {path}"
        )


# Hosts with a shared disk, such as containers, have the same run at the same path.
def _is_run_dir(path: Path, offer: RunOffer) -> bool:
    try:
        run_dir = RunDir(path)
        is_open = path.name == offer.run_id and run_dir.scenario.is_file() and not (path / "result.json").exists()
        return is_open and run_dir.scenario.read_text() == offer.scenario
    except OSError:
        return False


def _host_services(
    bus: ZenohBus,
    cores: Sequence[Core],
    setup: RunSetup,
    offer: RunOffer,
    window_ticks: int | None,
    say: ProgressHandler,
) -> JoinResult:
    host = Host(bus, cores, build_dataflow(setup.scenario, window_ticks=window_ticks), setup.episode)
    bus.on_disconnect(host.on_link_lost)
    bus.subscribe(protocol.START_KEY, lambda _key, _payload: say("flying"))
    host.join()
    say(f"ready, waits for the start (process {os.getpid()})")
    host.run()
    recording = setup.run_dir.recording
    services = tuple(core.spec.name for core in cores)
    return JoinResult(
        run_id=offer.run_id,
        services=services,
        last_tick=host.last_tick,
        is_whole=host.is_whole,
        n_resends=host.n_resends,
        run_dir=setup.run_dir.path,
        recording=recording if "recorder" in services and recording.exists() else None,
    )
