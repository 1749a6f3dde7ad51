"""The whole life of a service process, from the environment variable to the exit code."""

import faulthandler
import logging
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from gslcosim.bus.port import Join
from gslcosim.contract.participant import Core, Episode
from gslcosim.errors import ExitCode, GslCosimError, UsageError
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.over_bus.host import ParticipantHost
from gslcosim.runtime.participants import SERVICES
from gslcosim.runtime.privacy import keep_memory_private


def main(words: Sequence[str]) -> None:
    """Serve the service that the command line names.

    Args:
        words: The command line after the program; exactly one name is expected.
    """
    if len(words) != 1:
        names = ", ".join(kind.name for kind in SERVICES)
        sys.stderr.write(f"usage: python -m gslcosim_services NAME, with the name of a service: {names}\n")
        sys.exit(ExitCode.USAGE)
    serve(words[0])


def serve(name: str) -> None:
    """Build the core of a service, take part in the run named by `GSLCOSIM_JOIN`, and return when it is dismissed.

    Exits with code 3 after a fault; the log says why.
    """
    keep_memory_private()
    faulthandler.enable()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    # Ctrl-C is the supervisor's to handle; it dismisses the services in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _serve(name)
    except GslCosimError as error:
        logging.getLogger(name).error("%s", error)
        sys.exit(ExitCode.FAULT)


def _serve(name: str) -> None:
    from gslcosim.runtime.assembly import build_core, dataflow_of
    from gslcosim.runtime.setup import Setup

    join = Join.from_environment()
    if join.run_dir is None:
        raise UsageError(f"{name}: expected run_dir in the join data of a service, found none.")
    setup = Setup.load(Path(join.run_dir))
    take_part(join, build_core(name, setup), dataflow_of(setup.scenario), setup.episode)


def take_part(join: Join, core: Core, dataflow: Dataflow, episode: Episode) -> None:
    """Host a core in the run that `join` leads to, until it is dismissed."""
    from gslcosim.bus.zenoh_bus import ZenohBus

    with ZenohBus.open_member(join) as bus:
        host = ParticipantHost(bus, core, dataflow, episode)
        bus.on_disconnect(host.link_lost)
        host.join()
        host.run()
