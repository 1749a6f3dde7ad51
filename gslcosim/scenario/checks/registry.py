"""Registry of checks: what each is for, when it is needed, and the function that finds the problems.

`gslcosim validate`, `up`, `bench` and `train` take their checks from here, so that none of them sees less than another.
What a check computes belongs to the package that knows about it; it is imported when the check is run, since most
scenarios need none of what is slow to import.
Problems of a scenario's plain values, of which no valid scenario can be made, are found by the loader itself
(`cross_checks`, `program_checks`), whoever loads it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from gslcosim.base.problems import Problem
from gslcosim.scenario.models.gas import FarrellGasSpec, FilamentsSpec
from gslcosim.scenario.models.scenario import Processes, Scenario

FileKind = Literal["scenario", "suite", "card", "family", "train"]
Subject = Literal["room", "agents", "services", "machine"]
SUBJECTS: tuple[Subject, ...] = ("room", "agents", "services", "machine")


def _is_always_needed(content: Any) -> bool:
    del content
    return True


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check of a kind of file.

    Attributes:
        name: What errors of the registry and tests call it.
        of: The kind of file that it is for.
        finder: `module:function`; the function takes what the file holds (a `Scenario`, `Suite`, `MethodCard`, `Family`
            or `TrainFile`) and the file's folder, and returns the problems.
        subject: Of a scenario: the room with what is in the air, the agents that fly, the services, or this machine.
            A suite and a training check rooms case by case and agents entry by entry.
        is_needed: Whether content needs the check at all; asked before anything is imported.
        is_part_of_preparation: Whether the preparation of a run reads the same files and says the same, so that only
            who prepares nothing runs it.
        is_warning: Whether what it finds is no reason to refuse the file: `validate` says it, and the validity of a run
            where it concerns the result.
    """

    name: str
    of: FileKind
    finder: str
    subject: Subject | None = None
    is_needed: Callable[[Any], bool] = _is_always_needed
    is_part_of_preparation: bool = False
    is_warning: bool = False

    def find(self, content: Any, directory: Path) -> Iterable[Problem]:
        """Return the problems of what a file holds.

        Args:
            content: What the file holds.
            directory: Its folder, where relative paths start.
        """
        if not self.is_needed(content):
            return ()
        module, _, function = self.finder.partition(":")
        return getattr(import_module(module), function)(content, directory)


def _has_own_services(scenario: Scenario) -> bool:
    return bool(scenario.services or scenario.participants)


def _has_fmus(scenario: Scenario) -> bool:
    return any(own.start.fmu is not None for own in scenario.participants)


def _makes_demands(scenario: Scenario) -> bool:
    started = (*scenario.agents, *scenario.participants)
    return any(each.sandbox not in ("auto", "none") or each.limits.are_given or each.environment for each in started)


def _has_stored_wind(scenario: Scenario) -> bool:
    if scenario.environment.path is not None:
        return False  # its wind is in it, and `scenario.wind` has no meaning
    is_from_folder = scenario.environment.folder_key is not None and scenario.wind.solver in ("auto", "stored")
    return scenario.wind.file is not None or is_from_folder


def _has_given_eddies(scenario: Scenario) -> bool:
    turbulence = scenario.gas.turbulence if isinstance(scenario.gas, FilamentsSpec) else None
    return turbulence is not None and turbulence.kind == "given"


def _solves_wind(scenario: Scenario) -> bool:
    is_built_in = scenario.wind.solver == "built_in" or (
        scenario.wind.solver == "auto" and scenario.environment.folder_key is None
    )
    return scenario.environment.path is None and is_built_in


CHECKS = (
    Check(
        name="places",
        of="scenario",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_place_problems",
    ),
    Check(
        name="stored wind",
        of="scenario",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_stored_wind_problems",
        is_needed=_has_stored_wind,
        is_part_of_preparation=True,
    ),
    Check(
        name="stored gas",
        of="scenario",
        subject="room",
        finder="gslcosim_services.fields.models.formula_fields:find_stored_gas_problems",
        is_needed=lambda scenario: scenario.gas.stored is not None,
    ),
    Check(
        name="mixed air",
        of="scenario",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_mixed_air_problems",
        is_needed=lambda scenario: scenario.gas.stored is not None,
        is_warning=True,
    ),
    Check(
        name="costly wind",
        of="scenario",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_costly_wind_problems",
        is_needed=_solves_wind,
        is_warning=True,
    ),
    Check(
        name="eddies",
        of="scenario",
        subject="room",
        finder="gslcosim_services.fields.turbulence.air:find_eddy_warnings",
        is_needed=_has_given_eddies,
        is_warning=True,
    ),
    Check(
        name="gusts",
        of="scenario",
        subject="room",
        finder="gslcosim_services.fields.models.farrell:find_gust_warnings",
        is_needed=lambda scenario: isinstance(scenario.gas, FarrellGasSpec),
        is_warning=True,
    ),
    Check(
        name="methods",
        of="scenario",
        subject="agents",
        finder="gslcosim_services.sensing.briefing:find_method_problems",
    ),
    Check(
        name="services",
        of="scenario",
        subject="services",
        finder="gslcosim.runtime.services:find_service_problems",
        is_needed=_has_own_services,
    ),
    Check(
        name="FMUs",
        of="scenario",
        subject="services",
        finder="gslcosim_fmi.checks:find_fmu_problems",
        is_needed=_has_fmus,
    ),
    Check(
        name="states of FMUs",
        of="scenario",
        subject="services",
        finder="gslcosim_fmi.checks:find_fmu_warnings",
        is_needed=lambda scenario: scenario.snapshots is not None and _has_fmus(scenario),
        is_warning=True,
    ),
    Check(
        name="sandboxes",
        of="scenario",
        subject="machine",
        finder="gslcosim.runtime.processes.sandbox.selection:find_sandbox_problems",
        is_needed=_makes_demands,
    ),
    Check(
        name="drawing",
        of="scenario",
        subject="machine",
        finder="gslcosim.runtime.rendering:find_rendering_problems",
        is_needed=lambda scenario: bool(scenario.cameras),
    ),
    Check(name="scenarios", of="suite", finder="gslcosim_bench.cases.suite_checks:find_scenario_problems"),
    Check(name="entries", of="suite", finder="gslcosim_bench.cases.suite_checks:find_entry_problems"),
    Check(name="programs", of="card", finder="gslcosim.scenario.checks.program_checks:find_neighbour_problems"),
    Check(name="first cases", of="family", finder="gslcosim_training.train_checks:find_case_problems"),
    Check(name="trainer", of="train", finder="gslcosim_training.train_checks:find_trainer_problems"),
    Check(name="flights", of="train", finder="gslcosim_training.train_checks:find_flight_problems"),
)


def list_scenario_checks(
    *subjects: Subject,
    without: Sequence[str] = (),
    processes: Processes | None = None,
    prepares_run: bool = True,
) -> tuple[Callable[[Scenario, Path], Iterable[Problem]], ...]:
    """Return the checks of scenarios in the order of the registry, as `load_scenario` takes them.

    Args:
        subjects: Those wanted; none means all.
        without: Names of checks that are not for this machine.
        processes: How the run is spread over processes, where the caller says otherwise than the scenario.
        prepares_run: Whether a run is prepared right after, which then finds what is part of preparation.
    """
    chosen = [
        check
        for check in CHECKS
        if check.of == "scenario"
        and not check.is_warning
        and check.subject in (subjects or SUBJECTS)
        and check.name not in without
        and not (prepares_run and check.is_part_of_preparation)
    ]

    def with_processes(check: Check) -> Callable[[Scenario, Path], Iterable[Problem]]:
        def find(scenario: Scenario, directory: Path) -> Iterable[Problem]:
            spread = scenario if processes is None else scenario.model_copy(update={"processes": processes})
            return check.find(spread, directory)

        return find

    return tuple(check.find if processes is None else with_processes(check) for check in chosen)


def find_warnings(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return what is to be known of a valid scenario before it is run.

    Args:
        scenario: What is to be run.
        directory: The scenario's folder, where relative paths start.
    """
    warnings = (check for check in CHECKS if check.of == "scenario" and check.is_warning)
    return [problem for check in warnings for problem in check.find(scenario, directory)]


def find_problems(of: FileKind, content: Any, directory: Path) -> Iterator[Problem]:
    """Yield the problems that all checks of a kind of file find.

    Args:
        of: The kind of file.
        content: What the file holds.
        directory: Its folder, where relative paths start.
    """
    for check in CHECKS:
        if check.of == of and not check.is_warning:
            yield from check.find(content, directory)
