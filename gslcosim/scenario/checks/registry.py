"""Registry of checks and kinds of files: the subject of each, its condition, and the function that finds the problems.

Every command takes its checks from here, so that none of them has fewer than another. Extensions add kinds of files
with their checks, and checks of scenarios, by entry points in `gslcosim.checks`. The computation of a check is in the
package of its subject, and is imported when the check runs, since most scenarios need none of the slow imports.
Problems of a scenario's plain values that rule out any valid scenario are found by the loader itself (`cross_checks`,
`program_checks`), for every caller.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from gslcosim.base.bundled import bundled_agents, bundled_scenarios
from gslcosim.base.extensions import CHECKS_GROUP, instance_of, list_registered, load_registered, tuple_of
from gslcosim.base.problems import Problem
from gslcosim.methods.card import CARD_FILE
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim.scenario.models.scenario import Processes, Scenario

Subject = Literal["room", "agents", "services", "machine"]
SUBJECTS: tuple[Subject, ...] = ("room", "agents", "services", "machine")
SCENARIO = "scenario"
# Entry points with an extension's checks of scenarios are named `scenario.NAME`; one with a kind of file has the kind's
# name.
_OF_SCENARIOS = f"{SCENARIO}."


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check of a kind of file.

    Attributes:
        name: Its name in errors of the registry and in tests.
        of: Name of the kind of file that it checks.
        finder: `module:function`; the function takes the file's content (a `Scenario`, a `MethodCard`, or an
            extension's own type) and folder, and returns the problems.
        subject: For scenarios: the room with its air, the agents, the services, or this machine.
        is_needed: Whether the content needs the check at all; evaluated before any import.
        is_part_of_preparation: Whether the preparation of a run reads the same files and reports the same problems, so
            that only commands without preparation run the check.
        is_warning: Whether its findings are no reason to refuse the file: `validate` prints them, and the
            validity of a run has those that concern its result.
    """

    name: str
    finder: str
    of: str = SCENARIO
    subject: Subject | None = None
    is_needed: Callable[[Any], bool] = lambda _: True
    is_part_of_preparation: bool = False
    is_warning: bool = False

    def find(self, content: Any, directory: Path) -> Iterable[Problem]:
        """Return the problems of a file's content."""
        if not self.is_needed(content):
            return ()
        return import_function(self.finder)(content, directory)


def import_function(place: str) -> Callable[..., Any]:
    """Return the function at `module:function`."""
    module, _, function = place.partition(":")
    return getattr(import_module(module), function)


@dataclass(frozen=True, kw_only=True)
class ValidFile:
    """Outcome of the check of a valid file: a sentence, and its content by kind for `--json`."""

    sentence: str
    content: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class FileKind:
    """A kind of file that a user writes.

    Attributes:
        name: The word in its `schema`: `suite` of `gslcosim/suite/1`.
        words: Its name in sentences: `method card`.
        ending: Its usual name, or the end of it, such as `.train.yaml`.
        list_bundled: Returns the bundled files by name.
        validator: `module:function`; the function takes a path and a seed or None, and returns a `ValidFile` or raises
            `ScenarioError`. Empty for scenarios, which `gslcosim validate` loads with the changes of its options.
        has_seed: Whether the validator takes a seed in place of the file's.
        checks: Its checks.
    """

    name: str
    words: str
    ending: str
    list_bundled: Callable[[], Mapping[str, Path]]
    validator: str = ""
    has_seed: bool = False
    checks: tuple[Check, ...] = ()

    def validate(self, path: str, *, seed: int | None) -> ValidFile:
        """Return the outcome of the check of a file."""
        return import_function(self.validator)(path, seed)


def _makes_demands(scenario: Scenario) -> bool:
    started = (*scenario.agents, *scenario.participants)
    return any(each.sandbox not in ("auto", "none") or each.limits.are_given or each.environment for each in started)


def _has_stored_wind(scenario: Scenario) -> bool:
    if scenario.environment.path is not None:
        return False  # its wind is in that folder, and `scenario.wind` has no meaning
    is_from_folder = scenario.environment.folder_key is not None and scenario.wind.solver in ("auto", "stored")
    return scenario.wind.file is not None or is_from_folder


def _has_given_eddies(scenario: Scenario) -> bool:
    turbulence = scenario.gas.eddies if isinstance(scenario.gas, FilamentsSpec) else None
    return turbulence is not None and turbulence.kind == "given" and "length_m" in turbulence.model_fields_set


_SCENARIO_CHECKS = (
    Check(name="places", subject="room", finder="gslcosim.environment.generation.checks:find_place_problems"),
    Check(
        name="stored wind",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_stored_wind_problems",
        is_needed=_has_stored_wind,
        is_part_of_preparation=True,
    ),
    Check(
        name="mixed air",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_mixed_air_problems",
        is_needed=lambda scenario: scenario.gas.stored_folder is not None,
        is_warning=True,
    ),
    Check(
        name="costly wind",
        subject="room",
        finder="gslcosim.environment.generation.checks:find_costly_wind_problems",
        is_needed=lambda scenario: scenario.uses_built_in_solver,
        is_warning=True,
    ),
    Check(
        name="eddies",
        subject="room",
        finder="gslcosim_services.fields.turbulence.air:find_eddy_warnings",
        is_needed=_has_given_eddies,
        is_warning=True,
    ),
    Check(name="methods", subject="agents", finder="gslcosim_services.sensing.briefing:find_method_problems"),
    Check(
        name="services",
        subject="services",
        finder="gslcosim.runtime.services:find_service_problems",
        is_needed=lambda scenario: bool(scenario.services or scenario.participants),
    ),
    Check(
        name="sandboxes",
        subject="machine",
        finder="gslcosim.runtime.processes.sandbox.selection:find_sandbox_problems",
        is_needed=_makes_demands,
    ),
    Check(
        name="drawing",
        subject="machine",
        finder="gslcosim.runtime.rendering:find_rendering_problems",
        is_needed=lambda scenario: bool(scenario.cameras),
    ),
)


_OWN_KINDS = (
    FileKind(name=SCENARIO, words="scenario", ending=".yaml", list_bundled=bundled_scenarios, checks=_SCENARIO_CHECKS),
    FileKind(
        name="method",
        words="method card",
        ending=CARD_FILE,
        list_bundled=lambda: {name: path.with_name(CARD_FILE) for name, path in bundled_agents().items()},
        validator="gslcosim.scenario.checks.card_file:validate_card",
        checks=(
            Check(
                name="programs", of="method", finder="gslcosim.scenario.checks.program_checks:find_neighbour_problems"
            ),
        ),
    ),
)


def list_file_kinds() -> tuple[FileKind, ...]:
    """Return all kinds of files: scenarios, those of extensions by name, and method cards."""
    names = [point.name for point in list_registered(CHECKS_GROUP) if not point.name.startswith(_OF_SCENARIOS)]
    registered = [kind for name in names if (kind := find_kind(name)) is not None]
    scenario, card = _OWN_KINDS
    return (scenario, *registered, card)


@cache
def find_kind(name: str) -> FileKind | None:
    """Return the kind of file of a name, or None if no installed package has it."""
    if own := next((kind for kind in _OWN_KINDS if kind.name == name), None):
        return own
    if name.startswith(_OF_SCENARIOS):
        return None
    return next(load_registered(CHECKS_GROUP, instance_of(FileKind), "a FileKind", name=name), None)


@cache
def list_checks(of: str) -> tuple[Check, ...]:
    """Return all checks of a kind of file; those of scenarios in the order of their subjects."""
    if of != SCENARIO:
        kind = find_kind(of)
        return () if kind is None else kind.checks
    names = [point.name for point in list_registered(CHECKS_GROUP) if point.name.startswith(_OF_SCENARIOS)]
    loaded = (load_registered(CHECKS_GROUP, tuple_of(Check), "a tuple of Check", name=name) for name in names)
    checks = [*_SCENARIO_CHECKS, *(check for found in loaded for some in found for check in some)]
    return tuple(sorted(checks, key=lambda check: SUBJECTS.index(check.subject or "room")))


def list_scenario_checks(
    *subjects: Subject,
    without: Sequence[str] = (),
    processes: Processes | None = None,
    prepares_run: bool = True,
) -> tuple[Callable[[Scenario, Path], Iterable[Problem]], ...]:
    """Return the checks of scenarios in the order of the registry, in the form for `load_scenario`.

    Args:
        subjects: Subjects to check; none means all.
        without: Names of checks that do not apply to this machine.
        processes: Distribution of the run over processes, in place of the scenario's own.
        prepares_run: Whether the preparation of a run follows, and with it the checks that are part of preparation.
    """
    chosen = [
        check
        for check in list_checks(SCENARIO)
        if not check.is_warning
        and check.subject in (subjects or SUBJECTS)
        and check.name not in without
        and not (prepares_run and check.is_part_of_preparation)
    ]

    def find_in(check: Check, scenario: Scenario, directory: Path) -> Iterable[Problem]:
        spread = scenario if processes is None else scenario.model_copy(update={"processes": processes})
        return check.find(spread, directory)

    return tuple(partial(find_in, check) for check in chosen)


def find_warnings(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return the warnings about a valid scenario before its run."""
    warnings = (check for check in list_checks(SCENARIO) if check.is_warning)
    return [problem for check in warnings for problem in check.find(scenario, directory)]


def find_problems(of: str, content: Any, directory: Path) -> Iterator[Problem]:
    """Yield the problems found by all checks of a kind of file."""
    for check in list_checks(of):
        if not check.is_warning:
            yield from check.find(content, directory)
