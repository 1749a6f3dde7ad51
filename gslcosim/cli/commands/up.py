"""`gslcosim up`: run a scenario."""

import argparse
import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.cli.arguments import (
    Command,
    add_pace_option,
    add_runs_dir_option,
    add_scenario_arguments,
    load_checked,
    read_certificate,
)
from gslcosim.cli.commands.view import add_live_options, open_live_view
from gslcosim.cli.run_output import Report, format_summary, note_faults, show_run_progress
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.network import Network
    from gslcosim.runtime.processes.fork_server import ForkServer
    from gslcosim.runtime.status import RunStatus

UP_EXAMPLES = """  gslcosim up warehouse_empty
  gslcosim up my_scenario.yaml --seed 8 --set agents[0].vehicle.hold_s=1
  gslcosim up warehouse_empty --processes grouped
  gslcosim up warehouse_empty --live
  gslcosim up warehouse_empty --elsewhere fields --listen tcp/127.0.0.1:7447
  gslcosim up warehouse_empty --pace 1
  gslcosim up warehouse_empty --in-process --json | jq .real_time_factor"""


def _add_up_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "--processes",
        choices=("separate", "grouped", "one"),
        help=(
            "one process per service and agent, one for all services, or one for everything; "
            "results are equal (default: from the scenario, else separate)"
        ),
    )
    parser.add_argument(
        "--in-process", action="store_const", const="one", dest="processes", help="the same as --processes one"
    )
    add_pace_option(parser)
    add_live_options(parser)
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.add_argument(
        "--listen",
        action="append",
        default=[],
        metavar="ENDPOINT",
        help="let processes on other hosts join here, for example tls/0.0.0.0:7447; repeatable",
    )
    parser.add_argument(
        "--insecure",
        action="store_true",
        help=(
            "allow endpoints beyond this machine without TLS: anyone on the network can then read and change the run"
        ),
    )
    parser.add_argument(
        "--elsewhere",
        action="append",
        default=[],
        metavar="SERVICE,…",
        help="leave these services to gslcosim join on another host; all for all of them",
    )
    parser.add_argument(
        "--no-services",
        action="append_const",
        const="all",
        dest="elsewhere",
        help="the same as --elsewhere all, as in compose.yaml",
    )
    parser.add_argument(
        "--join-dir",
        type=Path,
        metavar="DIR",
        help=("folder of the join files for processes on other hosts (default: join in the run directory)"),
    )
    parser.add_argument(
        "--tls-certificate", type=Path, metavar="FILE", help="PEM certificate for endpoints that begin with tls/"
    )
    parser.add_argument("--tls-key", type=Path, metavar="FILE", help="PEM private key of the certificate")
    parser.add_argument(
        "--tls-ca", type=Path, metavar="FILE", help="PEM certificate of the authority (default: the certificate itself)"
    )
    parser.add_argument(
        "--tls-client-ca",
        type=Path,
        metavar="FILE",
        help="admit only clients by tls/ whose certificate this PEM certificate has signed",
    )
    parser.add_argument(
        "--lease-s",
        type=float,
        default=None,
        metavar="S",
        help="timeout in seconds for silent processes on other hosts (default: 15)",
    )
    parser.add_argument(
        "--window-ticks",
        type=int,
        metavar="N",
        help=("maximum lead of a writer over its slowest reader in ticks (default: 256); raise it for distant hosts"),
    )
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run_up(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.processes.fork_server import ForkServer

    is_forking = arguments.processes != "one" and "all" not in arguments.elsewhere and ForkServer.is_possible()
    # First, as it imports the packages of services while the scenario is read and checked.
    with ForkServer() if is_forking else contextlib.nullcontext() as fork_server:
        return _run_scenario(arguments, fork_server)


def _run_scenario(arguments: argparse.Namespace, fork_server: "ForkServer | None") -> int:
    loaded = load_checked(arguments)

    from gslcosim.runtime.run import run_scenario

    network = _network(arguments)
    is_shown = not arguments.quiet and not arguments.json
    title = f"{loaded.name}, seed {loaded.scenario.seed}"
    with open_live_view(arguments.live, loaded.scenario) as live:
        with show_run_progress(title, is_quiet=arguments.quiet or arguments.json) as report:
            flight = run_scenario(
                loaded,
                runs_dir=arguments.runs_dir,
                processes=arguments.processes,
                network=network,
                fork_server=fork_server,
                report=live.passing_on(_note_join_files(report, network) if network.elsewhere and is_shown else report),
            )
        live.end()
        if arguments.json:
            write_json(flight.result)
        elif not arguments.quiet:
            write(format_summary(flight))
        note_faults(flight)
        live.stay_open(flight.exit_code)
    return flight.exit_code


# The services on other hosts need their join files.
def _note_join_files(report: Report, network: "Network") -> Report:
    def note_and_report(status: "RunStatus") -> None:
        if status.run_dir is not None:
            folder = (network.join_dir or status.run_dir / "join") / "services"
            write_note(f"Elsewhere: gslcosim join {folder / 'NAME.json'}, for {', '.join(network.elsewhere)}")
        report(status)

    return note_and_report


def _network(arguments: argparse.Namespace) -> "Network":
    from gslcosim.runtime.network import DEFAULT_LEASE_S, Network

    named = [name.strip() for words in arguments.elsewhere for name in words.split(",")]
    return Network(
        listen=tuple(arguments.listen),
        elsewhere=tuple(dict.fromkeys(named)),
        join_dir=arguments.join_dir,
        tls=read_certificate(arguments),
        lease_s=DEFAULT_LEASE_S if arguments.lease_s is None else arguments.lease_s,
        is_insecure=arguments.insecure,
        window_ticks=arguments.window_ticks,
    )


UP = Command(
    name="up",
    is_computing=True,
    summary="run a scenario with its services and agents, and print the outcome",
    examples=UP_EXAMPLES,
    add_arguments=_add_up_arguments,
    run=_run_up,
)
