"""`gslcosim agent`: check an agent against the contract, or begin a new one."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command, CommandFamily
from gslcosim.cli.completion_words import find_named
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note
from gslcosim_conformance.commands.arguments import (
    add_answer_timeout_option,
    add_checked_program_arguments,
    add_template_arguments,
)

EXAMPLES = """  gslcosim agent new python my_agent
  gslcosim agent check -- python my_agent/agent.py
  gslcosim agent check --door stdio --format json -- ./my-agent --verbose"""

DEFAULT_TIMEOUT_S = 30.0


def _add_check_arguments(parser: argparse.ArgumentParser) -> None:
    add_checked_program_arguments(
        parser,
        "agent",
        doors=("zenoh", "stdio", "tcp", "unix"),
        door_help="transport: Zenoh, or the gateway over stdio, tcp or unix",
    )
    parser.add_argument(
        "--observations",
        choices=("all", "asked"),
        default="all",
        help=("observations to send through the gateway: all, or only those that require a command (default: all)"),
    )
    add_answer_timeout_option(parser, "agent", default_s=DEFAULT_TIMEOUT_S)
    add_json_option(parser)


def _check(arguments: argparse.Namespace) -> int:
    from gslcosim_conformance import ConnectionSpec, SessionLimits, check_agent

    connection = ConnectionSpec(
        command=tuple(arguments.words),
        transport=arguments.door,
        format=arguments.format,
        observations=arguments.observations,
    )
    limits = SessionLimits(answer_s=arguments.timeout, join_s=max(arguments.timeout, DEFAULT_TIMEOUT_S))
    report = check_agent(connection, limits, lambda name: write_note(f"flight: {name}"))
    if arguments.json:
        write_json(report.as_fields())
    else:
        write(report.as_text())
    return 0 if report.has_passed else ExitCode.AGENT_FAILED


def _new(arguments: argparse.Namespace) -> int:
    from gslcosim_conformance.scaffold import create_agent

    created = create_agent(arguments.language, arguments.name, arguments.dir or Path(arguments.name))
    write(created.as_text())
    return 0


# It takes a second.
def _list_languages() -> Iterable[str]:
    from gslcosim_conformance.scaffold import list_languages

    return list_languages()


COMMAND = CommandFamily(
    name="agent",
    summary="check an agent in any language against the contract, or create one",
    examples=EXAMPLES,
    parts=(
        Command(
            name="check",
            summary="run scripted sessions with an agent and check every rule of the contract",
            examples="  gslcosim agent check -- python my_agent/agent.py\n"
            "  gslcosim agent check --door stdio --format json -- ./my-agent --verbose",
            add_arguments=_add_check_arguments,
            run=_check,
        ),
        Command(
            name="new",
            summary="create a working agent",
            examples="  gslcosim agent new python my_agent",
            add_arguments=add_template_arguments(
                "python, or another language that has a template", "the agent's name, such as my_agent"
            ),
            completes={"LANGUAGE": [find_named(_list_languages)]},
            run=_new,
        ),
    ),
)
