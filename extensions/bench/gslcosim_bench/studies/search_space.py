"""Space of a search for failures: a family of cases or a scenario, and the factors whose levels are searched."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gslcosim.base.bundled import bundled_families, bundled_scenarios
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import find_scenario
from gslcosim.scenario.problems import did_you_mean
from gslcosim.scenario.serialization import read_yaml
from gslcosim_bench.cases.families import DrawnSpec, find_family_beside
from gslcosim_bench.cases.models import START_PATH

_STEP = 0.15
"""Standard deviation of a number's mutation, as a share of its range."""
_DIGITS = 4


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A dimension of a search: values of a list, numbers from `low` to `high`, or whole numbers below `n`.

    `choices` are blocks of values by path, of which a case has one.
    """

    name: str
    paths: tuple[str, ...]
    choices: tuple[Mapping[str, Any], ...] = ()
    low: float = 0.0
    high: float = 0.0
    is_log: bool = False
    n: int = 0

    def draw(self, rng: np.random.Generator) -> float:
        """Return a random level: an index, or a number."""
        if self.choices or self.n:
            return int(rng.integers(len(self.choices) or self.n))
        return self._number(float(rng.random()))

    def mutate(self, level: float, rng: np.random.Generator) -> float:
        """Return another level: a number nearby, or any other index."""
        n = len(self.choices) or self.n
        if n:
            return int((level + 1 + rng.integers(max(n - 1, 1))) % n)
        return self._number(min(max(self._share(level) + _STEP * float(rng.normal()), 0.0), 1.0))

    def values(self, level: float) -> dict[str, Any]:
        """Return what a level sets, by path."""
        if self.choices:
            return dict(self.choices[int(level)])
        return dict.fromkeys(self.paths, int(level) if self.n else level)

    def describe(self, level: float) -> str:
        """Return a level in a few words."""
        if not self.choices:
            return f"{level:g}"
        return ", ".join(_short(value) for value in self.choices[int(level)].values())

    def _number(self, share: float) -> float:
        value = self.low * (self.high / self.low) ** share if self.is_log else self.low + (self.high - self.low) * share
        return float(f"{value:.{_DIGITS}g}")

    def _share(self, value: float) -> float:
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("kind", " ".join(f"{key} {_short(inner)}" for key, inner in value.items())))
    if isinstance(value, list | tuple):
        return f"[{' '.join(_short(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, kw_only=True)
class SearchSpace:
    """Cases among which failures are sought: a scenario, values that it always has, and what is searched.

    Starts of the first vehicle are always searched; sources where the scenario has them `random`.
    """

    name: str
    scenario: Path
    set: Mapping[str, Any]
    factors: tuple[Factor, ...]

    @cached_property
    def place_paths(self) -> tuple[str, ...]:
        """The paths of the places that are searched: the start, and sources."""
        text = self.scenario.read_text(encoding="utf-8-sig")
        block: dict[str, Any] = read_yaml(text, source=str(self.scenario)).block or {}
        sources = block.get("gas", {}).get("sources", [])
        drawn = [f"gas.sources[{i}].position_m" for i, each in enumerate(sources) if each.get("position_m") == "random"]
        return (START_PATH, *drawn)


def find_space(source: str, varied: Sequence[str]) -> SearchSpace:
    """Return the space that a command line names.

    Args:
        source: A family of cases, whose `vary` is searched, or a scenario: a file, or the name of a bundled one.
        varied: More that is searched, such as `wind.cell_m=0.2:0.4` or `agents[0].sensors[0].model=pid,tgs2600`.
    """
    path = Path(source)
    is_family = source in bundled_families() or (path.is_file() and "gslcosim/family/" in path.read_text()[:2000])
    if is_family:
        family = find_family_beside(source, Path.cwd())
        factors = [factor for axis in family.spec.vary for factor in _factors_of_axis(axis)]
        space = SearchSpace(name=family.name, scenario=family.scenario, set=family.spec.set, factors=())
    else:
        try:
            scenario = find_scenario(source).resolve()
        except ScenarioError as error:
            known = [*bundled_families(), *bundled_scenarios()]
            raise ScenarioError(
                f"--in: expected a family or a scenario, a file or a bundled one, was '{source}'. "
                f"{did_you_mean(source, known)}".rstrip()
            ) from error
        factors, space = [], SearchSpace(name=scenario.stem, scenario=scenario, set={}, factors=())
    factors += [_parse_factor(text) for text in varied]
    paths = [path for factor in factors for path in factor.paths]
    if twice := next((path for path in paths if paths.count(path) > 1 or path in space.set), None):
        raise UsageError(f"--vary: expected each value once, was {twice} twice. Leave one out.")
    return replace(space, factors=tuple(factors))


def _factors_of_axis(axis: Mapping[str, DrawnSpec]) -> list[Factor]:
    listed = {path: drawn.values for path, drawn in axis.items() if drawn.values is not None}
    found: list[Factor] = []
    if listed:
        n = len(next(iter(listed.values())))
        choices = tuple({path: values[k] for path, values in listed.items()} for k in range(n))
        found.append(Factor(name="+".join(map(_last_word, listed)), paths=tuple(listed), choices=choices))
    for path, drawn in axis.items():
        if drawn.between is not None:
            low, high = drawn.between
            found.append(Factor(name=_last_word(path), paths=(path,), low=low, high=high, is_log=drawn.log))
        elif drawn.rooms is not None:
            found.append(Factor(name=_last_word(path), paths=(path,), n=drawn.rooms))
    return found


def _last_word(path: str) -> str:
    parts = path.split(".")
    return ".".join(parts[-2:]) if parts[-1] in ("seed", "model") else parts[-1]


def _parse_factor(text: str) -> Factor:
    path, equals, words = text.partition("=")
    ends = words.split(":")
    if equals and path and len(ends) in (2, 3) and "[" not in words:
        try:
            low, high = float(ends[0]), float(ends[1])
        except ValueError:
            low, high = 1.0, 0.0
        is_log = ends[2:] == ["log"]
        if low < high and (is_log or len(ends) == 2) and (low > 0 or not is_log):
            return Factor(name=_last_word(path), paths=(path,), low=low, high=high, is_log=is_log)
    elif equals and path:
        try:
            values: Any = yaml.load(f"[{words}]", Loader=CoreLoader)
        except yaml.YAMLError:
            values = []
        if isinstance(values, list) and len(values) > 1:
            return Factor(name=_last_word(path), paths=(path,), choices=tuple({path: value} for value in values))
    raise UsageError(
        f"--vary: expected PATH=LEAST:MOST, with :log behind it if need be, or PATH=VALUE,VALUE, was '{text}'. "
        "For example: --vary gas.sources[0].filaments_per_s=3:30:log"
    )


def get_place(scenario: Scenario, path: str) -> tuple[float, ...]:
    """Return a start or the position of a source of a resolved scenario, world frame [m]."""
    if path == START_PATH:
        return scenario.agents[0].vehicle.start_m
    return scenario.gas.sources[int(path.partition("[")[2].partition("]")[0])].position_m
