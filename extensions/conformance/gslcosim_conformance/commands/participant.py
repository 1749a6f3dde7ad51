"""`gslcosim participant`: check your own model against its contract, or create one."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, CommandFamily
from gslcosim.cli.completion_words import find_named
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note
from gslcosim_conformance.commands.arguments import (
    add_answer_timeout_option,
    add_checked_program_arguments,
    add_template_arguments,
)

EXAMPLES = """  gslcosim participant new c my_model
  gslcosim participant check -- ./my_model
  gslcosim participant check --format json --parameters '{above_ppm: 0.5}' -- python3 my_model.py"""

DEFAULT_TIMEOUT_S = 10.0


def _add_check_arguments(parser: argparse.ArgumentParser) -> None:
    add_checked_program_arguments(
        parser, "program", doors=("stdio", "tcp", "unix"), door_help="transport of the gateway"
    )
    parser.add_argument("--parameters", default="{}", metavar="YAML", help="settings in its briefing, as in a scenario")
    add_answer_timeout_option(parser, "program", default_s=DEFAULT_TIMEOUT_S)
    add_json_option(parser)


def _check(arguments: argparse.Namespace) -> int:
    from gslcosim_conformance import ConnectionSpec, SessionLimits
    from gslcosim_conformance.participant_check import check_participant

    connection = ConnectionSpec(command=tuple(arguments.words), transport=arguments.door, format=arguments.format)
    limits = SessionLimits(answer_s=arguments.timeout, join_s=max(arguments.timeout, 30.0))
    parameters = _parameters(arguments.parameters)
    report = check_participant(connection, limits, parameters, lambda name: write_note(f"session: {name}"))
    if arguments.json:
        write_json(report.as_fields())
    else:
        write(report.as_text())
    return 0 if report.has_passed else ExitCode.AGENT_FAILED


def _new(arguments: argparse.Namespace) -> int:
    from gslcosim_conformance.scaffold import create_participant

    folder = arguments.dir or Path(arguments.name)
    write(create_participant(arguments.language, arguments.name, folder))
    return 0


# The words of a scenario's `parameters`, with its rules.
def _parameters(text: str) -> dict[str, Any]:
    import yaml
    from pydantic import ValidationError

    from gslcosim.scenario.models.participants import ParticipantProgramSpec

    try:
        fields = {"name": "model", "start": {"command": ("x",)}, "writes": ("x",), "parameters": yaml.safe_load(text)}
        return dict(ParticipantProgramSpec.model_validate(fields).parameters)
    except (yaml.YAMLError, ValidationError) as error:
        expected = "a block such as {above_ppm: 0.5}, with names and plain values"
        raise UsageError(f"--parameters: expected {expected}, was {text!r}.") from error


def _list_languages() -> Iterable[str]:
    from gslcosim_conformance.scaffold import PARTICIPANT_SUFFIXES

    return PARTICIPANT_SUFFIXES


COMMAND = CommandFamily(
    name="participant",
    summary="check your own model, in any language, against its contract, or create one",
    examples=EXAMPLES,
    parts=(
        Command(
            name="check",
            summary="run scripted sessions with a program and check every rule of the contract",
            examples="  gslcosim participant check -- ./my_model\n"
            "  gslcosim participant check --format json --parameters '{above_ppm: 0.5}' -- python3 my_model.py",
            add_arguments=_add_check_arguments,
            run=_check,
        ),
        Command(
            name="new",
            summary="create a working program",
            examples="  gslcosim participant new c my_model",
            add_arguments=add_template_arguments("c, python or rust", "the participant's name, such as my_model"),
            completes={"LANGUAGE": [find_named(_list_languages)]},
            run=_new,
        ),
    ),
)
