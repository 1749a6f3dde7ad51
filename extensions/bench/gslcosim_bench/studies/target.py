"""Target of a study: a method, its suite with disjoint seeds, and values of its parameters."""

import itertools
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from gslcosim.base.bundled import PROGRAM_ENDINGS, bundled_agents, bundled_scenarios, bundled_suites
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.method_names import name_method
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.contract.messages import ParameterValue
from gslcosim.methods.card import MethodCard, Parameter, find_unmet_needs
from gslcosim.scenario.loader import find_scenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.scenario.problems import did_you_mean
from gslcosim.scenario.serialization import read_yaml
from gslcosim_bench.cases.agent_setup import find_card, resolve_start
from gslcosim_bench.cases.models import (
    MAX_NAME_LENGTH,
    SCHEMA,
    Case,
    ControlsSpec,
    DrawSpec,
    EntrySpec,
    RecordSpec,
    ScenarioSpec,
    Suite,
    derive_seed,
)
from gslcosim_bench.cases.plan import expand_cases, find_parameter_value, read_scenario_name
from gslcosim_bench.cases.suite_files import LoadedSuite, find_suite, load_suite

REPETITIONS = 10
"""Default number of flights of a single scenario; a suite states its own."""

_ENDINGS = (".yaml", ".yml")
DEFAULT = "default"
"""Name, in tuning, of the method with the parameters it was entered with."""
_PART = "parameters."
_DIGITS = 4


@dataclass(frozen=True, kw_only=True)
class StudyTarget:
    """A method under study, its card if it has one, and the cases that it flies in."""

    loaded: LoadedSuite
    entry: EntrySpec
    card: MethodCard | None

    def default_of(self, parameter: str) -> Any:
        """Return the value that the entry flies with when nothing is changed; None where nobody says."""
        return find_parameter_value(self.entry, self.card, parameter)


def find_target(source: str, entry: str, *, repetitions: int | None = None, seed: int | None = None) -> StudyTarget:
    """Return the method and cases that a command line names.

    Args:
        source: A suite or a scenario: a file, or the name of a bundled one.
        entry: An entry of the suite, a bundled method, or a Python file.
        repetitions: Replaces those of the suite and all that it includes; a scenario has 10.
        seed: Replaces the suite's.
    """
    if is_scenario(source):
        chosen = find_method_entry(entry, option="--entry")
        path = find_scenario(source).resolve()
        suite = Suite(
            schema=SCHEMA,
            name=read_scenario_name(path),
            seed=1 if seed is None else seed,
            scenarios=(ScenarioSpec(source=source if source in bundled_scenarios() else str(path)),),
            repetitions=repetitions or REPETITIONS,
            entries=(chosen,),
            anchors=(),
        )
        loaded = LoadedSuite(suite=suite, path=path, directory=path.parent, shown_path=source)
    else:
        loaded = load_suite(source, seed=seed, is_flown=True)
        if repetitions is not None:
            loaded = with_changed_fields(loaded, repetitions=repetitions)
        chosen = _entry_in(loaded, entry)
    return StudyTarget(loaded=loaded, entry=chosen, card=find_card(chosen, loaded.directory))


def is_scenario(source: str) -> bool:
    """Return whether a name or file is a scenario rather than a suite; a bundled suite goes before a scenario."""
    path = Path(source)
    if path.is_file():
        try:
            text = read_regular_file(path).decode("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(f"{path}: expected a file of UTF-8 text, was one that cannot be read.") from error
        return str((read_yaml(text, source=str(path)).block or {}).get("schema", "")) != SCHEMA
    if path.is_dir() or source in bundled_suites():
        find_suite(source)
        return False
    scenarios = bundled_scenarios()
    if source in scenarios:
        return True
    if path.suffix in _ENDINGS or len(path.parts) > 1:
        raise ScenarioError(f"{source}: expected the file of a suite or a scenario, found none.")
    names = [*bundled_suites(), *scenarios]
    raise ScenarioError(
        f"{source}: expected a file, a bundled suite or a bundled scenario ({', '.join(names)}), found none. "
        f"{did_you_mean(source, names)}".rstrip()
    )


def with_changed_fields(loaded: LoadedSuite, **values: Any) -> LoadedSuite:
    """Return a suite with other values of its fields, and the suites that it includes with the same.

    Other `repetitions` replace those, and the seeds, that single scenarios have.
    """
    included = tuple(with_changed_fields(inner, **values) for inner in loaded.included)
    if "repetitions" in values:
        same = {"repetitions": None, "seeds": None}
        values = {"scenarios": tuple(spec.model_copy(update=same) for spec in loaded.suite.scenarios), **values}
    return replace(loaded, suite=loaded.suite.model_copy(update=values), included=included)


def _entry_in(loaded: LoadedSuite, name: str) -> EntrySpec:
    for giver in _givers(loaded):
        for entry in (*giver.suite.entries_with_anchors, *giver.suite.entries):
            if entry.name == name:
                # Paths of an included suite's entry start at that suite's file.
                start = entry.start if giver is loaded else resolve_start(entry.start, giver.directory)
                return entry.model_copy(update={"vary": {}, "start": start})
    if (other := _bundled_or_file(name)) is not None:
        return other
    known = [entry.name for giver in _givers(loaded) for entry in giver.suite.entries_with_anchors]
    names = list(dict.fromkeys([*known, *bundled_agents()]))
    raise UsageError(
        f"--entry: expected an entry of {loaded.suite.name} ({', '.join(dict.fromkeys(known))}), a bundled method or "
        f"a Python file, was '{name}'. {did_you_mean(name, names)}".rstrip()
    )


def _givers(loaded: LoadedSuite) -> list[LoadedSuite]:
    if loaded.suite.entries:
        return [loaded]
    return [loaded, *(giver for inner in loaded.included for giver in _givers(inner))]


def find_method_entry(name: str, *, option: str) -> EntrySpec:
    """Return the entry of a bundled method or a Python file.

    Args:
        option: What of the command line names it, for the error.
    """
    entry = _bundled_or_file(name)
    if entry is None:
        raise UsageError(
            f"{option}: expected a bundled method or a Python file, was '{name}'. "
            f"{did_you_mean(name, list(bundled_agents()))}".rstrip()
        )
    return entry


def _bundled_or_file(name: str) -> EntrySpec | None:
    if name in bundled_agents():
        return EntrySpec(name=name, start=StartSpec(python=name))
    path = Path(name)
    if not name.endswith(PROGRAM_ENDINGS) or not path.is_file():
        return None
    return EntrySpec(
        name=_as_name(name_method(python=str(path.resolve()))), start=StartSpec(python=str(path.resolve()))
    )


def _as_name(text: str) -> str:
    word = "".join(c if c.isascii() and c.isalnum() else "_" for c in text.lower()).strip("_")
    return (word if word[:1].isalpha() else f"entry_{word}")[:MAX_NAME_LENGTH].rstrip("_")


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Values of parameters under a name, which is that of an entry."""

    name: str
    parameters: Mapping[str, ParameterValue]

    def entry(self, subject: StudyTarget) -> EntrySpec:
        """Return the subject's entry with these values; all other parameters stay as they were entered."""
        return subject.entry.with_parameters(self.name, self.parameters)


def build_study_suite(subject: StudyTarget, entries: Sequence[EntrySpec], *, name: str) -> LoadedSuite:
    """Return the subject's suite with other entries, which stand for settings of its method.

    Without anchors, controls and recordings: settings are compared with each other.

    Args:
        name: What the suite is called; cut where too long.
    """
    bare = with_changed_fields(
        subject.loaded, entries=tuple(entries), anchors=(), controls=ControlsSpec(), record=RecordSpec()
    )
    title = f"{subject.entry.name} with other parameters"
    suite = bare.suite.model_copy(update={"name": name[:MAX_NAME_LENGTH].rstrip("_"), "title": title, "question": ""})
    return replace(bare, suite=suite)


def restrict_cases(loaded: LoadedSuite, chosen: Collection[str]) -> LoadedSuite:
    """Return a suite of some of a suite's cases, with their names, seeds and plumes: planning the others takes time.

    Each scenario becomes a suite that is included, whose values go together instead of multiplying.
    """
    parts: dict[tuple[Path, str], tuple[LoadedSuite, list[Case]]] = {}
    n_cases = 0
    for owner, case in expand_cases(loaded):
        n_cases += 1
        if case.name in chosen:
            parts.setdefault((owner.path, case.scenario), (owner, []))[1].append(case)
    if sum(len(cases) for _, cases in parts.values()) == n_cases:
        return loaded
    included = tuple(_part(owner, cases, f"part_{i + 1}") for i, (owner, cases) in enumerate(parts.values()))
    outer = {"scenarios": (), "set": {}, "vary": (), "include": tuple(inner.suite.name for inner in included)}
    return replace(loaded, suite=loaded.suite.model_copy(update=outer), included=included)


def _part(owner: LoadedSuite, cases: Sequence[Case], name: str) -> LoadedSuite:
    first = cases[0]
    values = {path: json.loads(value) for path, _, value in (each.partition("=") for each in first.overrides)}
    kept = {path: value for path, value in values.items() if path not in first.varied}
    spec = ScenarioSpec(
        source=str(first.source),
        name=first.scenario,
        family=first.family,
        set=kept,
        repetitions=None if first.seeds else first.repetitions,
        gas_seeds=None if first.seeds else first.gas_seeds,
        seeds=first.seeds or None,
    )
    together = {path: tuple(case.varied[path] for case in cases) for path in first.varied}
    update = {"name": name, "scenarios": (spec,), "set": {}, "vary": (together,) if together else (), "include": ()}
    return replace(owner, suite=owner.suite.model_copy(update=update), included=())


def collect_seeds(loaded: LoadedSuite) -> frozenset[int]:
    """Return all seeds that the runs of a suite have: of runs, of gas, and of what is drawn, such as rooms."""
    seeds: set[int] = set()
    for _, case in expand_cases(loaded):
        seeds |= {case.run_seed(i) for i in range(case.repetitions)}
        seeds |= {case.plume_seed(i) for i in range(case.gas_seeds)}
    return frozenset(seeds | _drawn(loaded))


def _drawn(loaded: LoadedSuite) -> set[int]:
    suite = loaded.suite
    drawn = {
        derive_seed(suite.seed, "draw", path, k)
        for axis in (*suite.vary, *(axis for spec in suite.scenarios for axis in spec.axes))
        for path, values in axis.items()
        if isinstance(values, DrawSpec)
        for k in range(values.draw)
    }
    return drawn.union(*(_drawn(inner) for inner in loaded.included))


def collect_test_seeds(loaded: LoadedSuite) -> frozenset[int]:
    """Return all seeds of a suite and of every bundled one: those on which nothing may be tuned."""
    return collect_seeds(loaded) | collect_bundled_seeds()


@cache
def collect_bundled_seeds() -> frozenset[int]:
    """Return all seeds of the bundled suites: those on which nothing may be tuned or trained."""
    return frozenset[int]().union(*(collect_seeds(load_suite(path)) for path in bundled_suites().values()))


def with_disjoint_seeds(
    subject: StudyTarget, purpose: str, number: int, *, repetitions: int, taken: frozenset[int]
) -> LoadedSuite:
    """Return the subject's suite with seeds of their own: none of them is among those taken.

    seed = derive_seed(suite's seed, purpose, number), and with 1, 2, ... behind it should any run's seed be taken

    Args:
        purpose: For example `training`.
        taken: Seeds that may not occur, see `collect_seeds`.
    """
    fixed = next((case for _, case in expand_cases(subject.loaded) if case.seed is not None), None)
    if fixed is not None:
        raise UsageError(
            f"{subject.loaded.shown_path}: expected scenarios whose seeds can be drawn again, was {fixed.name}, a case "
            "of a family. Tune on scenarios, or train on the family: gslcosim train."
        )
    for attempt in itertools.count():
        words = (purpose, number, attempt) if attempt else (purpose, number)
        seed = derive_seed(subject.loaded.suite.seed, *words)
        found = with_changed_fields(subject.loaded, seed=seed, repetitions=repetitions)
        if collect_seeds(found).isdisjoint(taken):
            return found
    raise AssertionError("counting does not end")


@dataclass(frozen=True, kw_only=True)
class ParameterRange:
    """From where to where a number is searched, in its unit; `is_log`: in equal factors instead of equal steps."""

    name: str
    low: float
    high: float
    is_whole: bool = False
    is_log: bool = False

    def __str__(self) -> str:
        return f"{self.name}={self.low:g}:{self.high:g}{':log' if self.is_log else ''}"

    def holds(self, value: object) -> bool:
        """Return whether a value is a number within the range."""
        return isinstance(value, int | float) and not isinstance(value, bool) and self.low <= value <= self.high

    def rounded(self, value: float) -> int | float:
        """Return a value as it is run: with four digits, so that it can be read and typed."""
        if self.is_whole:
            return round(value)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


def parse_varied(texts: Sequence[str], subject: StudyTarget) -> dict[str, tuple[ParameterValue, ...]]:
    """Return the values of each parameter of texts such as `step_m=0.2,0.5,1.0`."""
    varied: dict[str, tuple[ParameterValue, ...]] = {}
    for text in texts:
        name, equals, listed = text.partition("=")
        values = _listed(listed) if equals and name else ()
        if not values:
            raise UsageError(
                f"--vary: expected PARAMETER=VALUE,VALUE and so on, was '{text}'. "
                "For example: --vary step_m=0.2,0.5,1.0"
            )
        if name in varied:
            raise UsageError(f"--vary: expected each parameter once, was {name} twice. Put its values into one list.")
        values = tuple(check_value("--vary", name, value, subject.card) for value in values)
        if twice := [value for i, value in enumerate(values) if value in values[:i]]:
            raise UsageError(f"--vary {name}: expected each value once, was {twice[0]} twice. Leave one out.")
        varied[name] = values
    return varied


def parse_ranges(texts: Sequence[str], subject: StudyTarget) -> tuple[ParameterRange, ...]:
    """Return the ranges of texts such as `step_m=0.1:2.0` or `step_m=0.1:2.0:log`."""
    ranges = [_range(text, subject.card) for text in texts]
    names = [each.name for each in ranges]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise UsageError(f"--range: expected each parameter once, was {twice} twice. Leave one out.")
    return tuple(ranges)


def card_ranges(subject: StudyTarget) -> tuple[ParameterRange, ...]:
    """Return the ranges of all numbers on a card that have a least, a most and a default.

    A number whose default is null is left to the scenario, and is no part of the method unless it is named.
    """
    parameters = subject.card.parameters if subject.card is not None else {}
    ranges = tuple(
        ParameterRange(name=name, low=each.min, high=each.max, is_whole=each.kind == "int")
        for name, each in parameters.items()
        if each.kind in ("float", "int")
        and each.default is not None
        and each.min is not None
        and each.max is not None
        and each.min < each.max
    )
    if not ranges:
        raise UsageError(
            f"--range: expected ranges to search, for {subject.entry.name} has no card (method.yaml beside its "
            "program) with numbers that have min and max; was none. For example: --range step_m=0.1:2.0"
        )
    return ranges


def check_value(option: str, name: str, value: Any, card: MethodCard | None) -> Any:
    """Return a value as the method gets it; without a card everything is allowed."""
    if card is None:
        return tuple(value) if isinstance(value, list) else value
    shortages = find_unmet_needs(card, sensors=(), knows=(), n_channels=0, parameters={name: value})
    wrong = next((each for each in shortages if each.where.startswith(_PART)), None)
    if wrong is not None:
        raise UsageError(f"{option} {name}: expected {wrong.expected}, was {wrong.found}. {wrong.remedy}")
    return card.parameters[name].parsed(value)


def _listed(text: str) -> tuple[Any, ...]:
    try:
        values = yaml.load(f"[{text}]", Loader=CoreLoader)
    except yaml.YAMLError:
        return ()
    is_list = isinstance(values, list) and all(isinstance(v, bool | int | float | str | list) for v in values)
    return tuple(values) if is_list else ()


def _range(text: str, card: MethodCard | None) -> ParameterRange:
    name, equals, ends = text.partition("=")
    words = ends.split(":")
    is_log = len(words) == 3 and words[2] == "log"
    numbers = [_number(word) for word in words[:2]]
    if not equals or not name or len(words) not in (2, 3) or (len(words) == 3 and not is_log) or None in numbers:
        raise UsageError(
            f"--range: expected PARAMETER=LEAST:MOST, or with :log behind it, was '{text}'. "
            "For example: --range step_m=0.1:2.0"
        )
    low, high = (number for number in numbers if number is not None)
    parameter = _numeric("--range", name, (low, high), card)
    is_whole = parameter.kind == "int" if parameter is not None else isinstance(low, int) and isinstance(high, int)
    if not low < high or (is_log and low <= 0):
        wanted = "a least value above 0 for :log" if is_log and low <= 0 else "the least value before the most"
        raise UsageError(f"--range {name}: expected {wanted}, was {ends}. For example: --range {name}=0.1:2.0")
    return ParameterRange(name=name, low=low, high=high, is_whole=is_whole, is_log=is_log)


def _numeric(option: str, name: str, ends: tuple[float, float], card: MethodCard | None) -> Parameter | None:
    parameter = card.parameters.get(name) if card is not None else None
    if parameter is not None and (parameter.kind not in ("float", "int") or parameter.choices):
        raise UsageError(
            f"{option} {name}: expected a parameter that is a number, was one that is not. "
            f"Compare its values with: gslcosim bench sweep SUITE --entry NAME --vary {name}=..."
        )
    for end in ends:
        check_value(option, name, end, card)
    return parameter


def _number(word: str) -> int | float | None:
    try:
        value = yaml.load(word, Loader=CoreLoader)
    except yaml.YAMLError:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
    return value if is_number else None
