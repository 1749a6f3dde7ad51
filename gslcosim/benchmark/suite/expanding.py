"""From what varies in a suite to its cases."""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gslcosim.benchmark.suite.loading import LoadedSuite
from gslcosim.benchmark.suite.models import DrawSpec, ScenarioSpec, n_values
from gslcosim.benchmark.suite.seeds import seed_of
from gslcosim.benchmark.suite.trials import Case
from gslcosim.errors import ScenarioError
from gslcosim.safe_files import read_regular_file
from gslcosim.scenario.loading import find_scenario
from gslcosim.scenario.yaml_tree import read_yaml

_UNITS = ("_m_s", "_m2_s", "_m", "_s", "_frac", "_per_s")


def cases_of(loaded: LoadedSuite) -> Iterator[tuple[LoadedSuite, Case]]:
    """Yield the cases of a suite, with the suite that each comes from: those of included suites first.

    Raises:
        ScenarioError: two scenarios have one name, or a scenario is not there.
    """
    seen: dict[str, str] = {}
    for owner, case in _cases(loaded, is_sandboxed=False):
        if case.name in seen:
            raise ScenarioError(
                f"{loaded.shown_path}: scenarios: expected cases with names of their own, was {case.name} twice "
                f"(in {seen[case.name]} and {owner.suite.name}). Give one of the scenarios a name."
            )
        seen[case.name] = owner.suite.name
        yield owner, case


def _cases(loaded: LoadedSuite, *, is_sandboxed: bool) -> Iterator[tuple[LoadedSuite, Case]]:
    suite = loaded.suite
    is_sandboxed = is_sandboxed or suite.sandbox == "required"
    for inner in loaded.included:
        yield from _cases(inner, is_sandboxed=is_sandboxed)
    for i, spec in enumerate(suite.scenarios):
        source = _source(spec, loaded)
        name = spec.name or _name_in(source)
        for varied in _combinations(loaded):
            values = {**suite.set, **spec.set, **varied}
            yield (
                loaded,
                Case(
                    name="/".join([name, *_labels(varied)]),
                    scenario=name,
                    family=spec.family or name,
                    source=source,
                    varied=varied,
                    overrides=tuple(f"{path}={json.dumps(value)}" for path, value in values.items()),
                    suite_seed=suite.seed,
                    repetitions=suite.repetitions,
                    gas_seeds=suite.gas_seeds or suite.repetitions,
                    no_source_frac=suite.controls.no_source_frac,
                    is_sandboxed=is_sandboxed,
                    set_in=f"{loaded.shown_path}: scenarios[{i}] {name}",
                ),
            )


def _source(spec: ScenarioSpec, loaded: LoadedSuite) -> Path:
    beside = loaded.directory / spec.source
    try:
        return find_scenario(beside if beside.is_file() else spec.source)
    except ScenarioError as error:
        raise ScenarioError(f"{loaded.shown_path}: scenarios: {error}") from error


def _name_in(path: Path) -> str:
    block = read_yaml(read_regular_file(path).decode("utf-8-sig"), source=str(path)).block
    return str((block or {}).get("name", path.stem))


def _combinations(loaded: LoadedSuite) -> Iterator[dict[str, Any]]:
    axes = [
        [{path: _value(loaded, path, values, k) for path, values in axis.items()} for k in range(_length(axis))]
        for axis in loaded.suite.vary
    ]
    for choice in itertools.product(*axes):
        yield {path: value for part in choice for path, value in part.items()}


def _length(axis: dict[str, Any]) -> int:
    return n_values(next(iter(axis.values()))) if axis else 1


def _value(loaded: LoadedSuite, path: str, values: "DrawSpec | tuple[Any, ...]", k: int) -> Any:
    if isinstance(values, DrawSpec):
        return seed_of(loaded.suite.seed, "draw", path, k)
    return values[k]


# `agents[0].vehicle.start_m: [3, 3, 0.2]` becomes `start=3,3,0.2`.
def _labels(varied: dict[str, Any]) -> Iterator[str]:
    for path, value in varied.items():
        key = path.rpartition(".")[2].partition("[")[0]
        ending = next((unit for unit in _UNITS if key.endswith(unit)), "")
        yield f"{key.removesuffix(ending)}={_short(value)}"


def _short(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ",".join(_short(item) for item in value)
    if isinstance(value, dict):
        return ",".join(f"{key}:{_short(inner)}" for key, inner in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)
