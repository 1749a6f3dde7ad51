"""Loader of scenario files, with all problems at once."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import ScenarioError, describe_os_error
from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import replace_inputs
from gslcosim.scenario.checks.cross_checks import block_in, find_cross_problems, find_numbers_too_large
from gslcosim.scenario.checks.program_checks import find_unusable_paths
from gslcosim.scenario.model_schema import find_schema_node, format_value, problems_from_validation
from gslcosim.scenario.models.scenario import EnvironmentSpec, Scenario, SolverSpec, VehicleSpec
from gslcosim.scenario.models.wind import Wind
from gslcosim.scenario.overrides import SET_OPTION, apply_overrides
from gslcosim.scenario.problems import InvalidScenarioError, TextLocation, TextLocations, did_you_mean, locate
from gslcosim.scenario.serialization import YamlTree, dump_resolved, read_yaml

__all__ = [
    "Check",
    "LoadedScenario",
    "dump_resolved",
    "find_scenario",
    "load_scenario",
    "read_resolved",
    "resolve_values",
]

_SAYS_NOTHING_OF_PLACES = ("schema", "name", "seed", "tick_ms", "referee", "recording")
RANDOM = "random"
_WIND = TypeAdapter[SolverSpec](Wind)
# Refusal of a position that cannot be drawn yet; reported only if nothing else is wrong.
_AFTER_THE_OTHERS = "a random place once the other problems are solved"
Check = Callable[[Scenario, Path], Iterable[Problem]]
_ENDINGS = (".yaml", ".yml")
# Families load one file many times; `apply_overrides` does not modify its arguments.
_read_tree = lru_cache(maxsize=8)(read_yaml)
MAX_BYTES = 2_000_000
"""Largest size of a scenario file."""


def extract_position_values(values: dict[str, Any], problem_paths: Iterable[str]) -> dict[str, Any] | None:
    """Return a scenario with the positions of a faulty one and nothing else of it.

    Returns None if a problem concerns data that determine positions: none is ever guessed.
    """
    agents = values.get("agents")
    if not isinstance(agents, list) or any(_concerns_places(path) for path in problem_paths):
        return None
    places = {
        "schema": "gslcosim/scenario/1",
        "name": "places",
        "environment": values.get("environment"),
        "gas": {"sources": block_in(values, "gas").get("sources")},
        "agents": [
            {
                "name": f"agent_{i}",
                "start": {"attach": True},
                "vehicle": agent.get("vehicle"),
                "sensors": [{"model": "anemometer", "name": "wind"}],
            }
            for i, agent in enumerate(_blocks(cast("list[Any]", agents)))
        ],
    }
    return {**places, "wind": values["wind"]} if "wind" in values else places


def _concerns_places(path: str) -> bool:
    top, *inner = path.replace("[", ".").replace("]", "").split(".")
    if top in _SAYS_NOTHING_OF_PLACES:
        return False
    if top == "gas":
        return not inner or inner[0] == "sources"
    if top == "agents":
        return len(inner) < 2 or inner[1] == "vehicle"
    return True


@dataclass(frozen=True, kw_only=True)
class RandomPosition:
    """A position to draw: its path in the scenario, and the vehicle that starts there, if any."""

    path: str
    vehicle: VehicleSpec | None = None


# From the environment, its wind, the scenario's folder and seed, and the wanted positions, to a position for each.
Placer = Callable[[EnvironmentSpec, SolverSpec, Path, int, Sequence[RandomPosition]], Mapping[str, Vec3]]


def replace_random_positions(values: dict[str, Any], directory: Path, placer: Placer | None) -> list[Problem]:
    """Replace `random` positions in a scenario's plain values, in place.

    If nothing can be drawn because the environment or a vehicle has problems of its own, a placeholder takes the
    position, so that those problems are found.

    Args:
        values: The scenario as dicts, lists and scalars; modified.
        directory: The scenario's folder.
        placer: Draws the positions; absent: `random` is refused.

    Returns:
        A problem for each position that cannot be drawn.
    """
    spots = list(_spots(values))
    if not spots:
        return []
    if placer is None:
        return [_refusal(path, "three numbers: the room is not known here") for path, _, _ in spots]
    try:
        environment = EnvironmentSpec.model_validate_json(json.dumps(values.get("environment")), strict=True)
        wind = _WIND.validate_json(json.dumps(values.get("wind", {})), strict=True)
        wanted = [RandomPosition(path=path, vehicle=_vehicle_in(block, key)) for path, block, key in spots]
    except ValidationError:
        for _, block, key in spots:
            block[key] = [0.0, 0.0, 0.0]
        return [_refusal(path, _AFTER_THE_OTHERS) for path, _, _ in spots]
    seed = values.get("seed", 0)
    places = placer(environment, wind, directory, seed if isinstance(seed, int) else 0, wanted)
    for path, block, key in spots:
        if path in places:
            block[key] = list(places[path])
    return [
        _refusal(path, "a room with free air, and space for the vehicle") for path, _, _ in spots if path not in places
    ]


def drop_consequent_problems(problems: Sequence[Problem]) -> list[Problem]:
    """Leave out problems of positions that only wait for other problems to be solved, unless there are no others."""
    causes = [p for p in problems if p.expected != _AFTER_THE_OTHERS]
    return causes or list(problems)


def _refusal(path: str, expected: str) -> Problem:
    return Problem(where=path, expected=expected, found=RANDOM)


def _spots(values: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], str]]:
    for i, source in enumerate(_blocks(block_in(values, "gas").get("sources"))):
        if source.get("position_m") == RANDOM:
            yield f"gas.sources[{i}].position_m", source, "position_m"
    for i, agent in enumerate(_blocks(values.get("agents"))):
        vehicle = block_in(agent, "vehicle")
        if vehicle.get("start_m") == RANDOM:
            yield f"agents[{i}].vehicle.start_m", vehicle, "start_m"


def _vehicle_in(block: dict[str, Any], key: str) -> VehicleSpec | None:
    if key != "start_m":
        return None
    return VehicleSpec.model_validate_json(json.dumps({**block, key: [0, 0, 0]}), strict=True)


# Other items become empty blocks, so that indices are those of the file.
def _blocks(items: Any) -> list[dict[str, Any]]:
    listed = cast("list[Any]", items) if isinstance(items, list) else []
    return [cast("dict[str, Any]", item) if isinstance(item, dict) else {} for item in listed]


@dataclass(frozen=True, kw_only=True)
class LoadedScenario:
    """A valid scenario and its origin.

    `directory` is the base of the scenario's relative paths; `text` is the file as read, without overrides. `included`
    are other files from which it was resolved, such as the suite that runs it.
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
        checks: Further rules, for example about positions in the room. Each receives the scenario and its folder, and
            runs even if other parts of the file have problems, as long as the positions are known.
        placer: Draws the `random` positions, for example `gslcosim.environment.positions.draw_positions`.
        set_in: Location of the overrides, in their problems.

    Raises:
        ScenarioError: there is no such scenario, or it has problems: all of them in one error.
    """
    path = find_scenario(source)
    text = _read_text(path)
    shown_path = str(source) if Path(source).is_file() else str(path)
    tree = apply_overrides(_read_tree(text, source=shown_path), overrides, seed=seed, source=set_in)
    directory = path.parent.resolve()
    _check_sizes(tree)
    unplaced = replace_random_positions(tree.block, directory, placer) if tree.block is not None else []
    scenario = _resolve(tree, directory, checks, known=unplaced)
    return LoadedScenario(scenario=scenario, path=path, directory=directory, text=text)


def resolve_values(values: dict[str, Any], directory: Path, *, source: str, checks: Sequence[Check] = ()) -> Scenario:
    """Return the scenario of plain values that a program has composed.

    Args:
        values: The content of a scenario file, without `random` positions.
        directory: Base of its relative paths.
        source: Location of its problems.
        checks: Further rules, as in `load_scenario`.

    Raises:
        ScenarioError: it has problems: all of them in one error.
    """
    tree = YamlTree(values, TextLocations(TextLocation(source=source)))
    _check_sizes(tree)
    return _resolve(tree, directory, checks, known=())


def _resolve(tree: YamlTree, directory: Path, checks: Sequence[Check], *, known: Sequence[Problem]) -> Scenario:
    scenario, problems = _check(tree, directory, known)
    problems = drop_consequent_problems([*problems, *_check_places(tree, scenario, problems, directory, checks)])
    if scenario is None or problems or tree.problems:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=tree.marks.root.source)
    return scenario


def read_resolved(text: str, *, source: str) -> Scenario:
    """Return the scenario in a text that `dump_resolved` has written, on any host; files that it names are not read.

    Raises:
        ScenarioError: it is no scenario.
    """
    tree = read_yaml(text, source=source)
    scenario, problems = _validate(tree.values)
    if scenario is None or tree.problems:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=source)
    return scenario


def find_scenario(source: str | Path) -> Path:
    """Return the file of a scenario given by its path, or by its name if it is bundled.

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


# These come first, so that no check that looks for files or computes has to consider them.
def _check_sizes(tree: YamlTree) -> None:
    if problems := [*find_unusable_paths(tree.block), *find_numbers_too_large(tree.block)]:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=tree.marks.root.source)


def _check(tree: YamlTree, directory: Path, known: Sequence[Problem]) -> tuple[Scenario | None, list[Problem]]:
    values = tree.block
    if values is None:
        expected = find_schema_node(()).describe()
        return None, [Problem(where="", expected=expected, found=format_value(tree.values))]
    # Services have no base folder for paths.
    gas = {key: block for key, block in values.items() if key == "gas"}
    gas = replace_inputs(gas, lambda path: str((directory / Path(path).expanduser()).resolve()))
    scenario, found = _validate(values | gas)
    known_paths = {problem.where for problem in known}
    problems: list[Problem] = [*known, *(problem for problem in found if problem.where not in known_paths)]
    problems += find_cross_problems(values, directory=directory)
    # A value whose text is faulty has no further problems.
    spoilt = [located.problem.where for located in tree.problems]
    inside = tuple(f"{path}{mark}" for path in spoilt for mark in ".[")
    return scenario, [p for p in problems if p.where not in spoilt and not p.where.startswith(inside)]


# JSON, because strict models accept its lists as tuples and its whole numbers as reals, but no text as a number.
def _validate(values: Any) -> tuple[Scenario | None, list[Problem]]:
    try:
        return Scenario.model_validate_json(json.dumps(values), strict=True), []
    except ValidationError as error:
        return None, problems_from_validation(error)


def _check_places(
    tree: YamlTree, scenario: Scenario | None, problems: list[Problem], directory: Path, checks: Sequence[Check]
) -> list[Problem]:
    if scenario is None and tree.block is not None:
        places = extract_position_values(tree.block, [problem.where for problem in problems])
        scenario = _validate(places)[0] if places else None
    if scenario is None:
        return []
    known = {problem.where for problem in problems}
    found = [problem for check in checks for problem in check(scenario, directory)]
    return [problem for problem in found if problem.where not in known]


def read_text(path: Path, *, shown_path: str) -> str:
    """Return the text of a file that a user wrote; errors name it by `shown_path`.

    Raises:
        ScenarioError: it cannot be read, or is not UTF-8.
    """
    try:
        return read_regular_file(path, max_bytes=MAX_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = describe_os_error(error) if isinstance(error, OSError) else "no UTF-8"
        raise ScenarioError(
            f"{shown_path}: expected a file of UTF-8 text, was one that cannot be read ({reason})."
        ) from error


def list_input_files(scenario: Scenario, directory: Path) -> list[Path]:
    """Return the inputs that a scenario names beside its own file: the room's folder or geometry, its wind, stored gas.

    Args:
        scenario: The scenario.
        directory: Base of its relative paths.
    """
    named = (*scenario.environment.inputs, scenario.wind.file, scenario.gas.stored_folder)
    return [(directory / Path(name).expanduser()).absolute() for name in named if name is not None]
