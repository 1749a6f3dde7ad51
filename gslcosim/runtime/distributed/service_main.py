"""Main program of a service process, from the environment variable to the exit code."""

import faulthandler
import importlib
import logging
import os
import signal
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.base.errors import ExitCode, UsageError, format_fault
from gslcosim.bus.interface import JoinData
from gslcosim.contract.participant import Core, Episode
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.distributed.host import Host, report_fault
from gslcosim.runtime.processes.current_process import keep_memory_private, set_process_title
from gslcosim.runtime.processes.fork_server import ForkWork, serve_forks
from gslcosim.runtime.services import default_services
from gslcosim.runtime.stepper import SnapshotPolicy

if TYPE_CHECKING:
    from gslcosim.runtime.stepper import ClockPace


def main(words: Sequence[str]) -> None:
    """Serve the services that the command line names, in this one process, or fork servers of them."""
    if words[:1] == ["--fork-server"]:
        serve_forks(int(words[1]), build_fork_work())
        return
    if not words:
        names = ", ".join(kind.name for kind in default_services())
        sys.stderr.write(f"usage: python -m gslcosim_services NAME…, with names of services: {names}\n")
        sys.exit(ExitCode.USAGE)
    serve(words)


def build_fork_request(names: Sequence[str], join: JoinData) -> dict[str, Any]:
    """Return what a fork server is asked for, to get a process that serves `names` in the run that `join` leads to."""
    return {"services": list(names), "join": join.model_dump(exclude_none=True)}


def build_fork_work() -> ForkWork:
    """Return the work of a fork server whose forks become services."""
    early = {kind.name: kind.import_early for kind in default_services() if kind.import_early is not None}
    return ForkWork(become=_become_service, preload=import_shared_modules, early=early)


def _become_service(request: Mapping[str, Any]) -> None:
    names = [str(name) for name in request["services"]]
    set_process_title(f"{sys.executable} -P -m gslcosim_services {' '.join(names)}")
    serve(names, JoinData.model_validate(request["join"]))


def import_shared_modules() -> None:
    """Import what several services need, and load the compiler of their kernels; starts no thread."""
    # Otherwise MuJoCo imports what opens windows, which starts a process to look for it; pictures need none of it.
    chosen = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = chosen or "disable"
    try:
        for module in ("gslcosim.bus.zenoh_bus", "gslcosim.runtime.services", "gslcosim.runtime.distributed.host"):
            importlib.import_module(module)
        for module in (module for kind in default_services() for module in kind.preloads):
            importlib.import_module(module)
    finally:
        if chosen is None:
            del os.environ["MUJOCO_GL"]
    # The first kernel that a process calls loads numba's compiler, a fifth of a second: once here, not in each fork.
    importlib.import_module("gslcosim.environment.grid_kernels").to_next_border(0.5, 0, 1.0)


def serve(names: Sequence[str], join: JoinData | None = None) -> None:
    """Build the cores of services, take part in a run, and return when they are dismissed.

    Args:
        join: Data with which they join the run; absent: those in `GSLCOSIM_JOIN`.

    Exits with code 3 after a fault; the reason is in the log.
    """
    keep_memory_private()
    faulthandler.enable()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    # The supervisor handles Ctrl-C; it dismisses the services in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _build_and_host(names, join)
    except Exception as error:
        logging.getLogger("+".join(names)).error("%s", format_fault(error, traceback.format_exc()))
        sys.exit(ExitCode.FAULT)


def _build_and_host(names: Sequence[str], join: JoinData | None) -> None:
    from gslcosim.runtime.services import build_core, build_dataflow
    from gslcosim.runtime.setup import RunSetup
    from gslcosim.runtime.stepper import build_clock_pace

    join = join or JoinData.from_environment()
    if join.run_dir is None:
        raise UsageError(f"{names[0]}: expected run_dir in the join data of a service, found none.")
    at_fault = names[0]
    try:
        setup = RunSetup.load(Path(join.run_dir))
        cores: list[Core] = []
        for at_fault in names:
            cores.append(build_core(at_fault, setup))
        dataflow = build_dataflow(setup.scenario, window_ticks=join.window_ticks)
    except Exception as error:
        from gslcosim.bus.zenoh_bus import ZenohBus

        # The fault is in the log too, but on a full disk there is no log.
        with ZenohBus.open_member(join) as bus:
            report_fault(bus, at_fault, error, tick=0)
        raise
    host_cores(join, cores, dataflow, setup.episode, build_clock_pace(setup), SnapshotPolicy.of(setup))


def host_cores(
    join: JoinData,
    cores: Sequence[Core],
    dataflow: Dataflow,
    episode: Episode,
    pace: "ClockPace | None" = None,
    keeping: SnapshotPolicy | None = None,
) -> None:
    """Host cores in the run that `join` leads to, until they are dismissed."""
    from gslcosim.bus.zenoh_bus import ZenohBus

    with ZenohBus.open_member(join) as bus:
        host = Host(bus, cores, dataflow, episode, pace, keeping)
        bus.on_disconnect(host.on_link_lost)
        host.join()
        host.run()
