"""Checks of train files and families before anything is flown: trainer and settings, first cases, batches."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.problems import Problem
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim_training.batch.case_builder import list_batch_misfits
from gslcosim_training.family import SPLITS, Family, Split
from gslcosim_training.train_file import PpoFileSettings, TrainFile
from gslcosim_training.trainers.evolution import CaseRun, build_method_entry, find_method_settings_problems
from gslcosim_training.trainers.tabular_q import find_action_problems
from gslcosim_training.trainers.trainer import MethodSettings, TableSettings


def find_case_problems(family: Family, directory: Path) -> Iterator[Problem]:
    """Yield what is wrong with the first case of each split of a family; the others differ by what is drawn."""
    del directory
    for split in SPLITS:
        yield from _load_first_case(family, split)[1]


def find_trainer_problems(file: TrainFile, directory: Path) -> Iterator[Problem]:
    """Yield what is wrong with the trainer of a train file, its settings and its numbers of cases."""
    del directory
    spec = file.spec
    splits: tuple[tuple[Split, int], ...] = (("training", spec.cases.training), ("validation", spec.cases.validation))
    for split, n in splits:
        seeds = file.family.spec.seeds.of(split)
        if n > seeds.count:
            yield Problem(
                where=f"cases.{split}",
                expected=f"at most {seeds.count}, as many as the seeds that {file.family.name} has for it",
                found=str(n),
                remedy=f"Lower it, or raise seeds.{split}.count of the family.",
            )
    if isinstance(spec.trainer, MethodSettings):
        yield from find_method_settings_problems(spec.trainer)
    elif isinstance(spec.trainer, TableSettings):
        yield from find_action_problems(spec.action.settings)
    elif isinstance(spec.trainer, PpoFileSettings):
        yield from _find_ppo_problems(spec.trainer)


def find_flight_problems(file: TrainFile, directory: Path) -> Iterator[Problem]:
    """Yield why the first cases of a training cannot be flown: by its method, or as a batch."""
    del directory
    trainer = file.spec.trainer
    splits: tuple[Split, ...] = ("training", "validation")
    for split in splits:
        case, problems = _load_first_case(file.family, split)
        if case is None:
            yield from (replace(problem, where="family") for problem in problems)
        elif isinstance(trainer, MethodSettings):
            yield from _find_method_problems(file, trainer, case)
        else:
            for key, expected, found in list_batch_misfits(case.scenario, file.spec.flying):
                yield Problem(
                    where="family",
                    expected=f"cases with {key} as trainer.kind: {trainer.kind} flies them: {expected}",
                    found=str(found),
                    remedy=f"Take another family, or trainer.kind: method. It is seed {case.scenario.seed} of {split}.",
                )


def _load_first_case(family: Family, split: Split) -> tuple[LoadedScenario | None, list[Problem]]:
    case = None
    try:
        case = family.case(split, 0)
        checks = list_scenario_checks("room", "services", prepares_run=False)
        lines = [str(problem) for check in checks for problem in check(case.scenario, case.directory)]
    except ScenarioError as error:
        cause = error.__cause__
        lines = [str(each) for each in cause.problems] if isinstance(cause, InvalidScenarioError) else [str(cause)]
    if case is not None and not lines:
        return case, []
    seed = family.spec.seeds.of(split).first
    expected, found = "a scenario of which each seed makes a case", f"one that is wrong with seed {seed} of {split}"
    return None, [Problem(where="scenario", expected=expected, found=found, remedy=line) for line in lines]


def _find_method_problems(file: TrainFile, trainer: MethodSettings, case: LoadedScenario) -> Iterator[Problem]:
    if any(find_method_settings_problems(trainer)):
        return  # what is no method lacks nothing
    try:
        CaseRun(family=file.family.name, case=case, entry=build_method_entry(trainer, {})).check()
    except ScenarioError as error:
        found = error.problems if isinstance(error, InvalidScenarioError) else (error,)
        for each in found:
            expected = f"a method that has all that it needs in the cases of {file.family.name}"
            yield Problem(where="trainer.method", expected=expected, found=f"'{trainer.method}'", remedy=str(each))


def _find_ppo_problems(trainer: PpoFileSettings) -> Iterator[Problem]:
    from gslcosim_training.trainers.recurrent_ppo import PpoSettings, load_jax

    try:
        load_jax()
    except UsageError as error:
        yield Problem(
            where="trainer.kind",
            expected="a trainer whose packages are installed",
            found=f"'{trainer.kind}'",
            remedy=str(error).removeprefix("trainer: "),
        )
    problems = [*PpoSettings.find_problems(trainer.settings)]
    yield from (replace(problem, where=f"trainer.settings{problem.where}") for problem in problems)
    parts = trainer.settings.get("parts", PpoSettings.parts)
    if not problems and trainer.searches % parts:
        expected = f"a divisor of {trainer.searches} searches"
        yield Problem(where="trainer.settings.parts", expected=expected, found=str(parts))
