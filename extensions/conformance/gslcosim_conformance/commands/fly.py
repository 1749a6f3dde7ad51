"""`gslcosim fly`: a person searches, with the keyboard, seeing what an agent sees."""

import argparse
import contextlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import Command, add_pace_option, add_runs_dir_option, add_scenario_arguments, load_checked
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.processes.fork_server import ForkServer
    from gslcosim.runtime.status import RunStatus
    from gslcosim.scenario import LoadedScenario
    from gslcosim_conformance.teleop import TeleopClient

EXAMPLES = """  gslcosim fly tiny_room
  gslcosim fly warehouse_empty --pace 4 --name alice
  gslcosim fly swarm_tiny --agent beetle_3
  gslcosim fly warehouse_racks --asked --step 2"""

USUAL_PACE = "1"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
# A person may think for a day.
_ANSWER_WITHIN_S = 86_400


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument("--agent", metavar="NAME", help="agent that you replace (default: the first of the scenario)")
    parser.add_argument("--name", default="human", help="name of your method in lists and tables")
    add_pace_option(parser, default=f"{USUAL_PACE}; with --asked as fast as it goes")
    parser.add_argument(
        "--asked", action="store_true", help="simulated time waits for you whenever an agent would decide"
    )
    parser.add_argument("--step", type=float, default=1.0, metavar="M", help="distance of a key press (default: 1)")
    parser.add_argument(
        "--processes", choices=("separate", "grouped", "one"), help="as for up (default: from the scenario)"
    )
    add_runs_dir_option(parser)
    add_json_option(parser)


@dataclass
class _Progress:
    """Messages of the run before it starts, for the person who waits; they say where the client attaches."""

    agent: str
    text: str = "The run is prepared."
    seat: "TeleopClient | None" = None

    def __call__(self, status: "RunStatus") -> None:
        from gslcosim.cli.run_output import format_status

        self.text = format_status(status)
        if status.run_dir is not None and self.seat is not None:
            self.seat.attach(status.run_dir / "join" / "agents" / f"{self.agent}.json")


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_conformance.teleop import MIN_COLUMNS, MIN_ROWS, check_terminal

    check_terminal(MIN_COLUMNS, MIN_ROWS)
    if _NAME.fullmatch(arguments.name) is None:
        raise UsageError(f"--name: expected letters, digits and underscores, was {arguments.name!r}.")
    if not 0.125 <= arguments.step <= 8:
        raise UsageError(f"--step: expected metres from 0.125 to 8, was {arguments.step:g}.")
    from gslcosim.runtime.processes.fork_server import ForkServer

    is_forking = arguments.processes != "one" and ForkServer.is_possible()
    with ForkServer() if is_forking else contextlib.nullcontext() as fork_server:
        return _fly(arguments, fork_server)


def _fly(arguments: argparse.Namespace, fork_server: "ForkServer | None") -> int:
    loaded, agent = _with_a_person(arguments)

    from gslcosim.cli.run_output import format_summary
    from gslcosim.runtime.run import run_scenario
    from gslcosim_conformance.teleop import TeleopClient, Terminal

    progress = _Progress(agent)
    with Terminal() as keyboard:
        seat = progress.seat = TeleopClient(
            keyboard, waits_for_questions=arguments.asked, step_m=arguments.step, progress=lambda: progress.text
        )
        seat.start()
        try:
            flight = run_scenario(
                loaded,
                runs_dir=arguments.runs_dir,
                processes=arguments.processes,
                fork_server=fork_server,
                report=progress,
            )
        finally:
            seat.leave()
    if arguments.json:
        write_json(flight.result)
    else:
        write(format_summary(flight))
    if seat.failure is not None:
        write_note(f"The terminal failed: {seat.failure!r}")
    if not flight.result.get("valid"):
        for fault in flight.result.get("faults", []):
            write_note(f"{fault['participant']}: {fault['text']}")
    return flight.exit_code


# The agent is one that attaches itself; everything else is as the scenario says.
def _with_a_person(arguments: argparse.Namespace) -> "tuple[LoadedScenario, str]":
    from gslcosim.scenario import load_scenario

    plain = load_scenario(arguments.scenario, overrides=arguments.set, seed=arguments.seed).scenario
    names = [agent.name for agent in plain.agents]
    name = arguments.agent or names[0]
    if name not in names:
        raise UsageError(f"--agent: expected one of {', '.join(names)}, which take part, was {name!r}.")
    shared = plain.agents_by_process().get(name, ())
    if len(shared) > 1:
        raise UsageError(
            f"--agent {name}: expected an agent whose process flies no other, but it flies {', '.join(shared[1:])} "
            "too. Take another, or give those a start of their own."
        )
    at = f"agents[{names.index(name)}]"
    arguments.set = [
        *arguments.set,
        f"{at}.start={{attach: true, door: unix, method: {arguments.name}}}",
        f"{at}.parameters={{}}",
        f"{at}.mode={'on_request' if arguments.asked else 'free'}",
        *([f"{at}.answer_within_s={_ANSWER_WITHIN_S}"] if arguments.asked else []),
    ]
    if arguments.pace is None and not arguments.asked and plain.pace is None:
        arguments.pace = USUAL_PACE
    return load_checked(arguments), name


COMMAND = Command(
    name="fly",
    summary="control a vehicle yourself with the keyboard; you see only what an agent receives",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
