"""Recipes of environments: what `environment generate` makes, from a scenario, a layout file or a kind of layout."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import ScenarioError
from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.loader import Check, Placer, load_scenario
from gslcosim.scenario.model_schema import find_schema_node, list_kinds, problems_from_validation
from gslcosim.scenario.models.scenario import SCHEMA, EnvironmentSpec, Scenario, SolverSpec
from gslcosim.scenario.overrides import apply_overrides
from gslcosim.scenario.problems import InvalidScenarioError, did_you_mean, locate
from gslcosim.scenario.serialization import read_yaml

LAYOUT_KEYS = ("layout", "wind")


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A room and the wind in it; `sources_m` are the scenario's, where there is one.

    `directory` is where relative paths start.
    """

    name: str
    environment: EnvironmentSpec
    wind: SolverSpec
    directory: Path | None = None
    sources_m: tuple[Vec3, ...] = ()


def load_recipe(
    source: str, *, overrides: Sequence[str] = (), checks: Sequence[Check] = (), placer: Placer | None = None
) -> Recipe:
    """Read what to generate.

    Args:
        source: A scenario's file or name, a YAML file with the keys `layout` and, if wanted, `wind`, or a kind of
            layout, which is then generated with all its defaults.
        overrides: Values to replace, such as `wind.cell_m=0.1`.
        checks: Further rules for scenarios.
        placer: Draws the places of scenarios that are `random`.
    """
    path, kinds = Path(source), list_kinds(find_schema_node(("environment", "layout")).annotation)
    is_layout_file = path.is_file() and _is_layout_file(path)
    if not is_layout_file and (path.exists() or source in bundled_scenarios() or source not in kinds):
        if not path.exists() and path.suffix == "" and len(path.parts) == 1 and source not in bundled_scenarios():
            names = list(dict.fromkeys([*bundled_scenarios(), *kinds]))
            raise ScenarioError(
                f"{source}: expected a file, a bundled scenario or a kind of layout ({', '.join(names)}), "
                f"found none of them. {did_you_mean(source, names)}".rstrip()
            )
        return _from_scenario(source, overrides, checks, placer)
    text = read_regular_file(path).decode("utf-8-sig") if is_layout_file else f"layout: {{kind: {source}}}"
    return _from_layout(text, source, [each.removeprefix("environment.") for each in overrides])


def _from_scenario(source: str, overrides: Sequence[str], checks: Sequence[Check], placer: Placer | None) -> Recipe:
    loaded = load_scenario(source, overrides=overrides, checks=checks, placer=placer)
    scenario = loaded.scenario
    if scenario.environment.path is not None:
        raise ScenarioError(
            f"{source}: environment: expected something to make, was path: {scenario.environment.path}, "
            f"which is made already."
        )
    return Recipe(
        name=scenario.name,
        environment=scenario.environment,
        wind=scenario.wind,
        directory=loaded.directory,
        sources_m=tuple(each.position_m for each in scenario.gas.sources),
    )


def _is_layout_file(path: Path) -> bool:
    try:
        values = read_yaml(read_regular_file(path).decode("utf-8-sig"), source=str(path)).block
    except (OSError, UnicodeDecodeError):
        return False
    return values is not None and "layout" in values and "schema" not in values


def _from_layout(text: str, source: str, overrides: Sequence[str]) -> Recipe:
    tree = apply_overrides(read_yaml(text, source=source), overrides)
    values = cast("dict[str, Any]", tree.block)
    problems = [
        Problem(where=key, expected=f"one of the keys {', '.join(LAYOUT_KEYS)}", found="an unknown key")
        for key in values
        if key not in LAYOUT_KEYS
    ]
    try:
        recipe = _from_values(values, Path(source).stem)
    except ValidationError as error:
        problems += [
            replace(each, where=each.where.removeprefix("environment.")) for each in problems_from_validation(error)
        ]
        recipe = None
    if recipe is None or problems or tree.problems:
        raise InvalidScenarioError([*tree.problems, *locate(problems, tree.marks)], name=source)
    return recipe


# Read as a part of a scenario whose other parts are well, so that problems are reported in the same words.
def _from_values(values: dict[str, Any], name: str) -> Recipe:
    rest: dict[str, Any] = {
        "schema": SCHEMA,
        "name": "layout",
        "gas": {"sources": [{"position_m": [0, 0, 0]}]},
        "agents": [
            {
                "name": "none",
                "start": {"attach": True},
                "vehicle": {"start_m": [0, 0, 0]},
                "sensors": [{"model": "tgs2600", "name": "none"}],
            }
        ],
    }
    whole = {**rest, "environment": {"layout": values["layout"]}, "wind": values.get("wind", {})}
    scenario = Scenario.model_validate_json(json.dumps(whole), strict=True)
    return Recipe(name=name, environment=scenario.environment, wind=scenario.wind)
