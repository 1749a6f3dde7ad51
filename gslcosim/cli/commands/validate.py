"""`gslcosim validate`: all problems of a scenario, suite, method card, family or train file, before anything flies."""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

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


@dataclass(frozen=True, kw_only=True)
class _ValidFile:
    """Outcome of the check of a valid file: a sentence, and its content by kind for `--json`."""

    sentence: str
    content: dict[str, Any]


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
    from gslcosim.scenario.problems import InvalidScenarioError

    kind, path = find_file_kind(arguments.scenario)
    try:
        if kind == "scenario":
            return _validate_scenario(arguments)
        _refuse_options(arguments, kind)
        valid = _VALIDATORS[kind](path, arguments)
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
    seed = arguments.seed if kind != "suite" else None
    given = {"--set": arguments.set, "--resolved": arguments.resolved, "--seed": seed is not None}
    for option in (option for option, is_given in given.items() if is_given):
        raise UsageError(f"{option}: expected a scenario with it, was the file of a {_WORDS[kind]}. Leave it out.")


def _validate_suite(path: str, arguments: argparse.Namespace) -> _ValidFile:
    from gslcosim_bench.cases import build_plan, load_suite
    from gslcosim_bench.execution.verification import check_machine

    loaded = load_suite(path, seed=arguments.seed, is_flown=True)
    plan = build_plan(loaded)
    check_machine(plan)
    names = ", ".join(entry.spec.name for entry in plan.entries)
    return _ValidFile(
        sentence=f"Suite {loaded.suite.name}: {len(plan.cases)} cases, {len(plan.trials)} trials, entries: {names}.",
        content={"suite": json.loads(loaded.suite.model_dump_json(by_alias=True, exclude_none=True))},
    )


def _validate_card(path: str, arguments: argparse.Namespace) -> _ValidFile:
    from gslcosim.scenario.checks.card_file import check_card_file

    del arguments
    card = check_card_file(Path(path))
    return _ValidFile(
        sentence=f"Method {card.title}, family {card.family}, {len(card.parameters)} parameters.",
        content={"card": json.loads(card.model_dump_json(by_alias=True))},
    )


def _validate_family(path: str, arguments: argparse.Namespace) -> _ValidFile:
    from gslcosim.scenario.checks.registry import find_problems
    from gslcosim.scenario.loader import raise_located
    from gslcosim_training.family import SPLITS, load_family

    del arguments
    family = load_family(path)
    raise_located(find_problems("family", family, family.directory), family.path, shown_path=path)
    seeds = ", ".join(f"{family.spec.seeds.of(split).count} of {split}" for split in SPLITS)
    return _ValidFile(
        sentence=f"Family {family.name}, seeds: {seeds}.",
        content={"family": json.loads(family.spec.model_dump_json(by_alias=True, exclude_none=True))},
    )


def _validate_train_file(path: str, arguments: argparse.Namespace) -> _ValidFile:
    from gslcosim_training.train_file import load_train_file

    del arguments
    file = load_train_file(path, is_flown=True)
    return _ValidFile(
        sentence=f"Training {file.spec.name} with {file.spec.trainer.kind} in the family {file.family.name}.",
        content={"train": json.loads(file.spec.model_dump_json(by_alias=True, exclude_none=True))},
    )


_WORDS: "dict[FileKind, str]" = {
    "suite": "suite", "card": "method card", "family": "family", "train": "training",
}  # fmt: skip
_VALIDATORS: "dict[FileKind, Callable[[str, argparse.Namespace], _ValidFile]]" = {
    "suite": _validate_suite,
    "card": _validate_card,
    "family": _validate_family,
    "train": _validate_train_file,
}
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
