"""Loader of scenario files into frozen models, with every problem of a file reported at once."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gslcosim.base.errors import ScenarioError
from gslcosim.base.files import read_regular_file
from gslcosim.base.os_errors import describe_os_error
from gslcosim.scenario.bundled import bundled_scenarios
from gslcosim.scenario.checks.cross_checks import find_cross_problems
from gslcosim.scenario.checks.plain_values import find_numbers_too_large
from gslcosim.scenario.checks.program_checks import find_unusable_paths
from gslcosim.scenario.model_schema import find_schema_node
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.overrides import SET_OPTION, apply_overrides
from gslcosim.scenario.partial_positions import extract_position_values
from gslcosim.scenario.problems import InvalidScenarioError, Problem, ProblemLike, TextLocation, TextLocations, locate
from gslcosim.scenario.random_positions import Placer, drop_consequent_problems, replace_random_positions
from gslcosim.scenario.serialization import dump_resolved, with_absolute_gas
from gslcosim.scenario.suggestions import did_you_mean
from gslcosim.scenario.validation_errors import format_value, problems_from_validation
from gslcosim.scenario.yaml_tree import YamlTree, read_yaml

__all__ = [
    "Check",
    "LoadedScenario",
    "dump_resolved",
    "find_scenario",
    "load_scenario",
    "read_resolved",
    "resolve_values",
]

Check = Callable[[Scenario, Path], Iterable[ProblemLike]]

_ENDINGS = (".yaml", ".yml")
_MOST_TREES = 8
MAX_BYTES = 2_000_000
"""Largest size of a scenario file."""


@dataclass(frozen=True, kw_only=True)
class LoadedScenario:
    """A valid scenario and where it came from.

    `directory` is where the scenario's relative paths start; `text` is the file as read, without overrides. `included`
    are other files that it was resolved from, such as the suite that flies it.
    """

    scenario: Scenario
    path: Path
    directory: Path
    text: str
    included: tuple[Path, ...] = ()

    @property
    def name(self) -> str:
        """The scenario's name."""
        return self.scenario.name


def load_scenario(
    source: str | Path,
    *,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    checks: Sequence[Check] = (),
    placer: Placer | None = None,
    set_in: str = SET_OPTION,
) -> LoadedScenario:
    """Read, change and check a scenario.

    Args:
        source: A file, or the name of a bundled scenario.
        overrides: Values to replace, such as `agents[0].vehicle.hold_s=1`.
        seed: Replaces the scenario's seed.
        checks: Further rules, for example about places in the room. Each is given the scenario and its folder, and is
            asked even when other parts of the file have problems, as long as the places are known.
        placer: Draws the places that are `random`, for example
            `gslcosim.environment.build.random_positions.draw_positions`.
        set_in: Where problems with overrides are said to stand.

    Raises:
        ScenarioError: there is no such scenario, or it has problems: all of them in one error.
    """
    path = find_scenario(source)
    text = _read_text(path)
    tree = apply_overrides(_read_tree(text, _shown_path(source, path)), overrides, seed=seed, source=set_in)
    directory = path.parent.resolve()
    _check_sizes(tree)
    unplaced = replace_random_positions(tree.block, directory, placer) if tree.block is not None else []
    scenario, problems = _check(tree, directory, known=unplaced)
    problems = drop_consequent_problems([*problems, *_check_places(tree, scenario, problems, directory, checks)])
    if scenario is None or problems or tree.problems:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=tree.marks.root.source)
    return LoadedScenario(scenario=scenario, path=path, directory=directory, text=text)


def resolve_values(values: dict[str, Any], directory: Path, *, source: str, checks: Sequence[Check] = ()) -> Scenario:
    """Return the scenario of plain values, which a program has put together.

    Args:
        values: What a scenario file would hold, nothing of it `random`.
        directory: Where its relative paths start.
        source: Where its problems are said to stand.
        checks: Further rules, as in `load_scenario`.

    Raises:
        ScenarioError: it has problems: all of them in one error.
    """
    tree = YamlTree(values, TextLocations(TextLocation(source=source)))
    _check_sizes(tree)
    scenario, problems = _check(tree, directory, known=())
    problems = drop_consequent_problems([*problems, *_check_places(tree, scenario, problems, directory, checks)])
    if scenario is None or problems:
        raise InvalidScenarioError(locate(problems, tree.marks), name=source)
    return scenario


def read_resolved(text: str, *, source: str) -> Scenario:
    """Return the scenario in a text as `dump_resolved` writes it, on whatever host; no file that it names is looked at.

    Args:
        text: The YAML.
        source: Where its problems are said to stand.

    Raises:
        ScenarioError: it is no scenario.
    """
    tree = read_yaml(text, source=source)
    scenario, problems = _validate(tree.values)
    if scenario is None or tree.problems:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=source)
    return scenario


def find_scenario(source: str | Path) -> Path:
    """Return the file of a scenario that is named by path, or by name when it is bundled.

    Raises:
        ScenarioError: there is none.
    """
    path = Path(source)
    if path.is_file():
        return path
    if path.exists():
        what = "a folder" if path.is_dir() else "a pipe or a device"
        raise ScenarioError(f"{source}: expected a scenario file, was {what}.")
    bundled = bundled_scenarios()
    if str(source) in bundled:
        return bundled[str(source)]
    if path.suffix in _ENDINGS or len(path.parts) > 1:
        siblings = [p.name for p in path.parent.glob("*.y*ml")] if path.parent.is_dir() else []
        is_bundled = path.stem in bundled
        hint = f"{path.stem} is bundled: give its name alone." if is_bundled else did_you_mean(path.name, siblings)
        raise ScenarioError(f"{source}: expected a scenario file, found none. {hint}".rstrip())
    raise ScenarioError(
        f"{source}: expected a file or a bundled scenario ({', '.join(bundled)}), found neither. "
        f"{did_you_mean(str(source), bundled)}".rstrip()
    )


# Families load one file many times; `apply_overrides` modifies nothing of what it is given.
@lru_cache(_MOST_TREES)
def _read_tree(text: str, source: str) -> YamlTree:
    return read_yaml(text, source=source)


def _read_text(path: Path) -> str:
    try:
        return read_regular_file(path, max_bytes=MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"{path}: expected UTF-8 text, was something else from byte {error.start} on. Save the file as UTF-8."
        ) from error
    except OSError as error:
        raise ScenarioError(
            f"{path}: expected a file that can be read, was one that cannot ({describe_os_error(error)})."
        ) from error


def _shown_path(source: str | Path, path: Path) -> str:
    return str(source) if Path(source).is_file() else str(path)


# They come first: no check that looks for files or computes needs to think of them.
def _check_sizes(tree: YamlTree) -> None:
    if problems := [*find_unusable_paths(tree.block), *find_numbers_too_large(tree.block)]:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=tree.marks.root.source)


def _check(tree: YamlTree, directory: Path, known: Sequence[Problem]) -> tuple[Scenario | None, list[ProblemLike]]:
    values = tree.block
    if values is None:
        expected = find_schema_node(()).describe()
        return None, [Problem(path="", expected=expected, found=format_value(tree.values))]
    scenario, found = _validate(values)
    scenario = scenario and with_absolute_gas(scenario, directory)
    known_paths = {problem.path for problem in known}
    problems: list[ProblemLike] = [*known, *(problem for problem in found if problem.path not in known_paths)]
    problems += find_cross_problems(values, directory=directory)
    spoilt = [located.problem.path for located in tree.problems]
    return scenario, [p for p in problems if not any(_is_inside(p.path, path) for path in spoilt)]


# JSON, because strict models take its lists as tuples and its whole numbers as reals, but no text as a number.
def _validate(values: Any) -> tuple[Scenario | None, list[Problem]]:
    try:
        return Scenario.model_validate_json(json.dumps(values), strict=True), []
    except ValidationError as error:
        return None, problems_from_validation(error)


def _check_places(
    tree: YamlTree, scenario: Scenario | None, problems: list[ProblemLike], directory: Path, checks: Sequence[Check]
) -> list[ProblemLike]:
    if scenario is None and tree.block is not None:
        places = extract_position_values(tree.block, [problem.path for problem in problems])
        scenario = _validate(places)[0] if places else None
    if scenario is None:
        return []
    known = {problem.path for problem in problems}
    found = [problem for check in checks for problem in check(scenario, directory)]
    return [problem for problem in found if problem.path not in known]


def _is_inside(path: str, part: str) -> bool:
    return path == part or path.startswith((f"{part}.", f"{part}["))
