"""`gslcosim validate`: all problems of a file, of any kind, before a run."""

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from gslcosim.base.bundled import bundled_families, bundled_train_files
from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, add_override_options, load_checked
from gslcosim.cli.completion_words import AGENTS, SCENARIOS, SUITES, YAML_FILES, find_named
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.scenario.checks.registry import FileKind

EXAMPLES = """  gslcosim validate my_scenario.yaml
  gslcosim validate warehouse_empty --set wind.cell_m=0.1
  gslcosim validate my_scenario.yaml --resolved > complete.yaml
  gslcosim validate my_suite.yaml
  gslcosim validate my_agent/method.yaml
  gslcosim validate my_training.train.yaml"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario",
        metavar="FILE",
        help=("file of a scenario, suite, method card, family or training, or the name of a bundled one"),
    )
    add_override_options(parser)
    parser.add_argument("--resolved", action="store_true", help="print the scenario with all defaults and changes")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.scenario.checks.file_kinds import find_file_kind
    from gslcosim.scenario.checks.registry import SCENARIO
    from gslcosim.scenario.problems import InvalidScenarioError

    kind, path = find_file_kind(arguments.scenario)
    try:
        if kind.name == SCENARIO:
            return _validate_scenario(arguments)
        _refuse_options(arguments, kind)
        valid = kind.validate(path, seed=arguments.seed)
    except InvalidScenarioError as error:
        if not arguments.json:
            raise
        write_json({"valid": False, "problems": [located.as_fields() for located in error.problems]})
        return ExitCode.USAGE
    if arguments.json:
        write_json({"valid": True, "problems": [], **valid.content})
    else:
        write(f"{arguments.scenario}: valid. {valid.sentence}")
    return 0


def _validate_scenario(arguments: argparse.Namespace) -> int:
    from gslcosim.scenario import dump_resolved
    from gslcosim.scenario.checks.registry import find_warnings
    from gslcosim.scenario.serialization import plain_values

    loaded = load_checked(arguments, prepares_run=False)
    warnings = find_warnings(loaded.scenario, loaded.directory)
    if arguments.json:
        fields = {"valid": True, "problems": [], "warnings": [asdict(warning) for warning in warnings]}
        write_json({**fields, "scenario": plain_values(loaded.scenario)})
    elif arguments.resolved:
        write(dump_resolved(loaded.scenario).rstrip("\n"))
    else:
        agents = ", ".join(agent.name for agent in loaded.scenario.agents)
        write(f"{arguments.scenario}: valid. Scenario {loaded.name}, seed {loaded.scenario.seed}, agents: {agents}.")
        for warning in warnings:
            write_note(f"Warning: {warning}")
    return 0


def _refuse_options(arguments: argparse.Namespace, kind: "FileKind") -> None:
    seed = None if kind.has_seed else arguments.seed
    given = {"--set": arguments.set, "--resolved": arguments.resolved, "--seed": seed is not None}
    for option in (option for option, is_given in given.items() if is_given):
        raise UsageError(f"{option}: expected a scenario with it, was the file of a {kind.words}. Leave it out.")


COMMAND = Command(
    name="validate",
    summary="list all problems of a scenario, suite, method card, family or train file",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={
        "FILE": [SCENARIOS, SUITES, *map(find_named, (bundled_families, bundled_train_files)), AGENTS, YAML_FILES]
    },
    run=_run,
)
