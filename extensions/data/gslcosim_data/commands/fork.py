"""`gslcosim fork`: repeat a run up to some time, and continue it with changes."""

import argparse
import contextlib
import json
import re
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import MANIFEST, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.run_output import format_summary, note_faults, show_run_progress
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.processes.fork_server import ForkServer
    from gslcosim.scenario import Scenario

EXAMPLES = """  gslcosim fork warehouse_empty-seed7-2025 --at 120 --agent infotaxis
  gslcosim fork runs/night_42 --at 60 --set agents[0].seed=5
  gslcosim fork runs/swarm --at 30 --agent moth=./my_agent.py --set agents[1].parameters.step_m=2
  gslcosim fork runs/night_42 --at 60 --event '{what: wind_changes, at_s: 70, share: 0.5}'
  gslcosim fork runs/night_42 --at 60 --agent '{command: [./my_agent], door: stdio}'"""

_NAMED = re.compile(r"([A-Za-z_]\w*)=(.+)", re.DOTALL)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", metavar="RUN", help="a run: folder or id")
    parser.add_argument(
        "--at",
        type=float,
        metavar="S",
        required=True,
        dest="at_s",
        help="simulated time of the fork",
    )
    parser.add_argument(
        "--agent",
        action="append",
        default=[],
        metavar="[NAME=]AGENT",
        help=(
            "new agent from there on: a bundled one, a Python file, a command line, or a block "
            "like start in a scenario; NAME selects one of several agents; it starts without "
            "parameters"
        ),
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=("replace one value that does not affect the past, for example agents[0].parameters.step_m=2"),
    )
    parser.add_argument(
        "--from-start", action="store_true", help="repeat the whole past, even if the run has a snapshot of it"
    )
    parser.add_argument(
        "--event",
        action="append",
        default=[],
        metavar="EVENT",
        help="additional event after the fork, a block as in events of a scenario; repeatable",
    )
    parser.add_argument(
        "--processes", choices=("separate", "grouped", "one"), help="as for up (default: from the scenario of the run)"
    )
    parser.add_argument(
        "--in-process", action="store_const", const="one", dest="processes", help="the same as --processes one"
    )
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.processes.fork_server import ForkServer

    is_forking = arguments.processes != "one" and ForkServer.is_possible()
    with ForkServer() if is_forking else contextlib.nullcontext() as fork_server:
        return _run_fork(arguments, fork_server)


def _run_fork(arguments: argparse.Namespace, fork_server: "ForkServer | None") -> int:
    from gslcosim.runtime.replay.past_run import PastRun
    from gslcosim.scenario.checks.registry import list_scenario_checks
    from gslcosim_data.fork import prepare_fork, run_fork

    manifest = find_in_run(arguments.run, runs_dir=arguments.runs_dir, file_name=MANIFEST)
    past = PastRun.load(manifest.parent)
    fork = prepare_fork(
        past,
        at_s=arguments.at_s,
        overrides=[
            *agent_overrides(past.scenario, arguments.agent),
            *event_overrides(past.scenario, arguments.event),
            *arguments.set,
        ],
        checks=list_scenario_checks(processes=arguments.processes),
        uses_snapshots=not arguments.from_start,
    )
    if fork.note:
        write_note(f"{fork.note} The run is repeated from its start.")
    title = f"{past.run_dir.run_id} from {arguments.at_s:g} s on"
    with show_run_progress(title, is_quiet=arguments.quiet or arguments.json) as report:
        forked = run_fork(
            fork, runs_dir=arguments.runs_dir, processes=arguments.processes, fork_server=fork_server, report=report
        )
    flight, divergence = forked.flight, forked.divergence
    if arguments.json:
        write_json({**flight.result, "fork_of": {**fork.origin, "divergence": divergence and vars(divergence)}})
    elif not arguments.quiet:
        write(format_summary(flight))
        write(f"fork of    {past.run_dir.path} at {arguments.at_s:g} s (tick {fork.at_tick})")
        if fork.snapshot is not None:
            write(f"begun at   the snapshot of tick {fork.snapshot.tick}; the recording begins there")
        write(f"see both   gslcosim view {past.run_dir.path} {flight.run_dir}")
    note_faults(flight)
    if divergence is not None:
        write_note(
            f"The past did not repeat: different from {past.run_dir.path} from tick {divergence.tick} on, before the "
            f"fork at tick {fork.at_tick}: participant {divergence.participant}, port {divergence.port}: "
            f"{divergence.text}. That run was flown by {past.flown_by}; fork it with that version and packages."
        )
    return forked.exit_code


def agent_overrides(scenario: "Scenario", agents: Sequence[str]) -> list[str]:
    """Return overrides for the agents of a command line: the start of each, without the former agent's parameters.

    Args:
        scenario: The run's scenario.
        agents: Texts like `infotaxis` or `moth=./my_agent.py`.
    """
    names = [agent.name for agent in scenario.agents]
    overrides: list[str] = []
    for text in agents:
        named = _NAMED.fullmatch(text)
        name, program = named.groups() if named else ("", text)
        if named is None and len(names) > 1:
            raise UsageError(f"--agent {text}: expected NAME={text} with one of {', '.join(names)}, which take part.")
        if named is not None and name not in names:
            raise UsageError(f"--agent {text}: expected one of {', '.join(names)}, which took part, was {name!r}.")
        i = names.index(name) if name else 0
        overrides += [f"agents[{i}].start={_start_block(program)}", f"agents[{i}].parameters={{}}"]
    return overrides


def event_overrides(scenario: "Scenario", events: Sequence[str]) -> list[str]:
    """Return the override that adds events to those of a run."""
    from gslcosim.scenario.serialization import plain_values

    known = [json.dumps(event) for event in plain_values(scenario).get("events", [])]
    return [f"events=[{', '.join([*known, *events])}]"] if events else []


def _start_block(program: str) -> str:
    from gslcosim.base.bundled import PROGRAM_ENDINGS, bundled_agents

    if program.lstrip().startswith("{"):
        return program
    if program in bundled_agents() or program.endswith(PROGRAM_ENDINGS):
        return json.dumps({"python": program})
    try:
        words = shlex.split(program)
    except ValueError as error:
        raise UsageError(
            f"--agent {program}: expected a command line, was one that cannot be read ({error})."
        ) from error
    if len(words) == 1 and "/" not in program:
        raise UsageError(
            f"--agent {program}: expected a bundled agent (`gslcosim list agents`), a .py file, a program with a slash "
            "in its path, or a command line, found none of these."
        )
    return json.dumps({"command": words})


COMMAND = Command(
    name="fork",
    is_computing=True,
    summary="repeat a run up to a time and continue with another agent, parameters or seed",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
