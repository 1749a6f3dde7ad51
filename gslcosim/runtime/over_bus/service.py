"""The whole life of a service process, from the environment variable to the exit code."""

import faulthandler
import logging
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.bus.port import Join
from gslcosim.contract.participant import Core, Episode
from gslcosim.errors import ExitCode, UsageError
from gslcosim.machine import fault_text
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.over_bus.fault_telling import tell_fault
from gslcosim.runtime.over_bus.host import Host
from gslcosim.runtime.participants import default_services
from gslcosim.runtime.privacy import keep_memory_private
from gslcosim.runtime.snapshots.taking import Keeping

if TYPE_CHECKING:
    from gslcosim.runtime.clock_pace import ClockPace


def main(words: Sequence[str]) -> None:
    """Serve the services that the command line names, in this one process, or fork servers of them.

    Args:
        words: The command line after the program: at least one name, or `--fork-server` and a file descriptor.
    """
    if words[:1] == ["--fork-server"]:
        from gslcosim.runtime.over_bus import fork_server

        fork_server.main(int(words[1]))
        return
    if not words:
        names = ", ".join(kind.name for kind in default_services())
        sys.stderr.write(f"usage: python -m gslcosim_services NAME…, with names of services: {names}\n")
        sys.exit(ExitCode.USAGE)
    serve(words)


def serve(names: Sequence[str], join: Join | None = None) -> None:
    """Build the cores of services, take part in a run, and return when they are dismissed.

    Args:
        names: The services.
        join: How they join the run; absent: as `GSLCOSIM_JOIN` says.

    Exits with code 3 after a fault; the log says why.
    """
    keep_memory_private()
    faulthandler.enable()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    # Ctrl-C is the supervisor's to handle; it dismisses the services in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _serve(names, join)
    except Exception as error:
        logging.getLogger("+".join(names)).error("%s", fault_text(error, traceback.format_exc()))
        sys.exit(ExitCode.FAULT)


def _serve(names: Sequence[str], join: Join | None) -> None:
    from gslcosim.runtime.assembly import build_core, dataflow_of
    from gslcosim.runtime.clock_pace import clock_pace_of
    from gslcosim.runtime.setup import Setup

    join = join or Join.from_environment()
    if join.run_dir is None:
        raise UsageError(f"{names[0]}: expected run_dir in the join data of a service, found none.")
    at_fault = names[0]
    try:
        setup = Setup.load(Path(join.run_dir))
        cores: list[Core] = []
        for at_fault in names:
            cores.append(build_core(at_fault, setup))
        dataflow = dataflow_of(setup.scenario, window_ticks=join.window_ticks)
    except Exception as error:
        _tell(join, at_fault, error)
        raise
    take_part(join, cores, dataflow, setup.episode, clock_pace_of(setup), Keeping.of(setup))


# The log says it too, but where a disk is full there is none.
def _tell(join: Join, name: str, error: Exception) -> None:
    from gslcosim.bus.zenoh_bus import ZenohBus

    with ZenohBus.open_member(join) as bus:
        tell_fault(bus, name, error, tick=0)


def take_part(
    join: Join,
    cores: Sequence[Core],
    dataflow: Dataflow,
    episode: Episode,
    pace: "ClockPace | None" = None,
    keeping: Keeping | None = None,
) -> None:
    """Host cores in the run that `join` leads to, until they are dismissed."""
    from gslcosim.bus.zenoh_bus import ZenohBus

    with ZenohBus.open_member(join) as bus:
        host = Host(bus, cores, dataflow, episode, pace, keeping)
        bus.on_disconnect(host.link_lost)
        host.join()
        host.run()
