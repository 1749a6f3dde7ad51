"""Suites with an entry for each setting, in the same cases, with seeds that no test suite has."""

import itertools
import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from gslcosim.bench.cases.models import ControlsSpec, DrawSpec, EntrySpec, RecordSpec, ScenarioSpec
from gslcosim.bench.cases.plan import expand_cases
from gslcosim.bench.cases.suite_files import LoadedSuite, bundled_suites, load_suite
from gslcosim.bench.cases.trials import Case, derive_seed
from gslcosim.bench.studies.target import StudyTarget, with_changed_fields
from gslcosim.contract.messages import ParameterValue

DEFAULT = "default"
"""Name, in tuning, of the method with the parameters it was entered with."""

_LONGEST = 40


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Values of parameters under a name, which is that of an entry."""

    name: str
    parameters: Mapping[str, ParameterValue]


def build_setting_suite(subject: StudyTarget, settings: Sequence[Setting], *, name: str) -> LoadedSuite:
    """Return a suite with an entry for each setting, in the cases of the subject's suite.

    Without anchors, controls and recordings: settings are compared with each other.

    Args:
        subject: The method and its cases.
        settings: What it is set to; all other parameters stay as they were entered.
        name: What the suite is called; cut where too long.
    """
    entries = tuple(_entry(subject.entry, setting) for setting in settings)
    bare = with_changed_fields(
        subject.loaded, entries=entries, anchors=(), controls=ControlsSpec(), record=RecordSpec()
    )
    title = f"{subject.entry.name} with other parameters"
    suite = bare.suite.model_copy(update={"name": name[:_LONGEST].rstrip("_"), "title": title, "question": ""})
    return LoadedSuite(
        suite=suite, path=bare.path, directory=bare.directory, shown_path=bare.shown_path, included=bare.included
    )


def restrict_cases(loaded: LoadedSuite, chosen: Collection[str]) -> LoadedSuite:
    """Return a suite of some of a suite's cases, with their names, seeds and plumes: planning the others takes time.

    Each scenario becomes a suite that is included, whose values go together instead of multiplying.

    Args:
        loaded: The suite.
        chosen: Names of cases.
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
    spec = ScenarioSpec(source=str(first.source), name=first.scenario, family=first.family, set=kept)
    together = {path: tuple(case.varied[path] for case in cases) for path in first.varied}
    update = {"name": name, "scenarios": (spec,), "set": {}, "vary": (together,) if together else (), "include": ()}
    return replace(owner, suite=owner.suite.model_copy(update=update), included=())


# A parameter for a single scenario would hide the values that are compared.
def _entry(entry: EntrySpec, setting: Setting) -> EntrySpec:
    kept = {
        scenario: {name: value for name, value in values.items() if name not in setting.parameters}
        for scenario, values in entry.parameters_in.items()
    }
    parameters = {**entry.parameters, **setting.parameters}
    return entry.model_copy(update={"name": setting.name, "parameters": parameters, "parameters_in": kept})


def build_settings(entry: str, varied: Mapping[str, Sequence[ParameterValue]]) -> tuple[Setting, ...]:
    """Return a setting for each combination of values, the last parameter running fastest.

    Names tell the values, as in `e_coli_step_m_0_5`; where they would be too long or equal they are numbered instead.
    """
    combinations = [dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())]
    names = ["_".join([entry, *(f"{key}_{_word(value)}" for key, value in each.items())]) for each in combinations]
    if len(set(names)) < len(names) or max(map(len, names)) > _LONGEST:
        width = len(str(len(names)))
        stem = entry[: _LONGEST - width - 1].rstrip("_")
        names = [f"{stem}_{i + 1:0{width}d}" for i in range(len(names))]
    return tuple(Setting(name=name, parameters=each) for name, each in zip(names, combinations, strict=True))


def _word(value: ParameterValue) -> str:
    if isinstance(value, tuple):
        return "_".join(_word(item) for item in value)
    text = f"{value:g}" if isinstance(value, float) else str(value).lower()
    if isinstance(value, int | float):
        text = text.replace("-", "minus_")
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")


def collect_seeds(loaded: LoadedSuite) -> frozenset[int]:
    """Return all seeds that the runs of a suite have: of runs, of gas, and of what is drawn, such as rooms."""
    seeds: set[int] = set()
    for _, case in expand_cases(loaded):
        seeds |= {derive_seed(case.suite_seed, case.name, i) for i in range(case.repetitions)}
        seeds |= {derive_seed(case.suite_seed, "gas", case.scenario, i) for i in range(case.gas_seeds)}
    return frozenset(seeds | _drawn(loaded))


def _drawn(loaded: LoadedSuite) -> set[int]:
    suite = loaded.suite
    drawn = {
        derive_seed(suite.seed, "draw", path, k)
        for axis in suite.vary
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
        subject: The method and its cases.
        purpose: For example `training`.
        number: Distinguishes several of one purpose.
        repetitions: Of each case.
        taken: Seeds that may not occur, see `collect_seeds`.
    """
    for attempt in itertools.count():
        words = (purpose, number, attempt) if attempt else (purpose, number)
        seed = derive_seed(subject.loaded.suite.seed, *words)
        found = with_changed_fields(subject.loaded, seed=seed, repetitions=repetitions)
        if collect_seeds(found).isdisjoint(taken):
            return found
    raise AssertionError("counting does not end")
