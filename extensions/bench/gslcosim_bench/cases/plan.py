"""Plan of a suite: its axes expanded into cases, the cases into trials, and how long they take."""

import hashlib
import itertools
import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import list_live_keys
from gslcosim.base.untrusted_input import MalformedFileError, read_json
from gslcosim.environment.generation.cache import recipe_hash
from gslcosim.environment.geometry_source import find_folder
from gslcosim.environment.positions import (
    can_start_at,
    draw_positions,
    find_point_problems,
    find_position_problems,
    nearest_start_m,
    read_room,
)
from gslcosim.environment.store import load_environment
from gslcosim.methods.card import MethodCard
from gslcosim.scenario import Scenario, load_scenario
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.loader import RandomPosition, resolve_values
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
from gslcosim.scenario.problems import (
    InvalidScenarioError,
    LocatedProblem,
    ProblemsError,
    TextLocation,
    TextLocations,
    locate,
)
from gslcosim.scenario.serialization import plain_values, read_yaml
from gslcosim_bench.cases.agent_setup import apply_entry, build_environment, close_sources, find_card
from gslcosim_bench.cases.families import find_family_beside
from gslcosim_bench.cases.models import (
    LABELS,
    Axis,
    Case,
    DrawSpec,
    DroppedCase,
    EntrySpec,
    MovedStart,
    ScenarioSpec,
    Suite,
    Trial,
    TrialSlot,
    Values,
    as_overrides,
    derive_seed,
    n_values,
    select_labels,
)
from gslcosim_bench.cases.sensor_holds import with_sensor_holds
from gslcosim_bench.cases.spec_files import find_scenario_beside
from gslcosim_bench.cases.suite_files import LoadedSuite, agent_hash, case_hash, software_hash, trial_id

# Simulated seconds a worker flies in one by the clock, where nothing has been measured yet.
DEFAULT_PACE = 120.0
# What a trial costs beside flying: starting cores and agents, judging, storing [s].
OVERHEAD_S = 0.1
ROOM_S, PLUME_S = 60.0, 10.0
BYTES_PER_TRIAL = 9_000
MAX_DRAWS = 100
"""After so many draws no air is looked for any longer at the height of a source."""
MAX_PROBLEMS = 100
"""With so many problems, further cases of a suite are not looked at."""
_N = 200_000
_UNITS = ("_m_s", "_m2_s", "_m", "_s", "_frac", "_per_s")
Progress = Callable[[int], None]
"""Receives the number of trials planned so far."""


class _Pace(TypedDict):
    sim_s_per_s: float


def measured_pace() -> float:
    """Return the simulated seconds that a worker runs per second on this machine, as last measured."""
    try:
        measured = read_json(_file(), _Pace)["sim_s_per_s"]
    except MalformedFileError:
        return DEFAULT_PACE
    return measured if 0.0 < measured < math.inf else DEFAULT_PACE


def save_pace(*, sim_s: float, busy_s: float) -> None:
    """Remember what was measured; a cache that cannot be written is no reason to fail."""
    if sim_s < 1000.0 or busy_s <= 0.0:
        return
    try:
        _file().parent.mkdir(parents=True, exist_ok=True)
        _file().write_text(json.dumps({"sim_s_per_s": sim_s / busy_s}), encoding="utf-8")
    except OSError:
        return


def _file() -> Path:
    return get_cache_root() / "bench_pace.json"


def reference_loop_s() -> float:
    """Return the present duration of the loop by the clock [s]: about 0.02 s on a machine of 2023."""
    began = time.perf_counter()
    total = 0
    for i in range(_N):
        total += i * i & 0xFF
    assert total > 0, "the loop is not optimised away"
    return time.perf_counter() - began


def expand_cases(loaded: LoadedSuite) -> Iterator[tuple[LoadedSuite, Case]]:
    """Yield the cases of a suite, with the suite that each comes from: those of included suites first."""
    seen: dict[str, tuple[LoadedSuite, Case]] = {}
    for owner, case in _cases(loaded, is_sandboxed=False):
        if case.name in seen:
            first, other = seen[case.name]
            raise ScenarioError(
                f"{loaded.shown_path}: scenarios: expected cases with names of their own, was {case.name} twice "
                f"(in {' and '.join(dict.fromkeys((first.suite.name, owner.suite.name)))}). "
                f"{_how_to_tell_apart(other, case)}"
            )
        seen[case.name] = owner, case
        yield owner, case


def _how_to_tell_apart(one: Case, other: Case) -> str:
    if one.set_in != other.set_in:
        return "Give one of the scenarios a name."
    if one.varied == other.varied:
        return "Write each value of starts and vary once; for more runs of a case raise repetitions."
    if one.overrides == other.overrides:
        return "Labels alone make no case: vary a value with them, or list the scenario once for each, under two names."
    return "Names show six digits of a value: vary values that differ in these."


def _cases(loaded: LoadedSuite, *, is_sandboxed: bool) -> Iterator[tuple[LoadedSuite, Case]]:
    suite = loaded.suite
    is_sandboxed = is_sandboxed or suite.sandbox == "required"
    for inner in loaded.included:
        yield from _cases(inner, is_sandboxed=is_sandboxed)
    for i, spec in enumerate(suite.scenarios):
        repetitions = len(spec.seeds) if spec.seeds else spec.repetitions or suite.repetitions
        for name, place, source, seed, drawn in _places_of(spec, loaded):
            for varied in _combinations(suite.axes_of(spec), suite.seed):
                values = {**suite.set, **drawn, **spec.set, **varied, **_holds(suite)}
                yield (
                    loaded,
                    Case(
                        name="/".join([place, *_labels(varied)]),
                        scenario=name,
                        family=spec.family or name,
                        source=source,
                        varied={**select_labels(values), **drawn, **varied},
                        overrides=as_overrides(values),
                        suite_seed=suite.seed,
                        repetitions=repetitions,
                        gas_seeds=repetitions if spec.seeds else spec.gas_seeds or suite.gas_seeds or repetitions,
                        no_source_frac=suite.controls.no_source_frac,
                        is_sandboxed=is_sandboxed,
                        set_in=f"{loaded.shown_path}: scenarios[{i}] {name}",
                        seed=seed,
                        seeds=spec.seeds or (),
                        has_sensor_holds=suite.hold_s == "by_sensor",
                        source_height_m=spec.source_height_m,
                    ),
                )


# One hold for all vehicles of a suite; that of sensors follows when an entry has its own.
def _holds(suite: Suite) -> Values:
    if suite.hold_s is None:
        return {}
    fixed = {"agents[0].vehicle.hold_rule": "fixed"}
    return fixed if suite.hold_s == "by_sensor" else {"agents[0].vehicle.hold_s": suite.hold_s, **fixed}


# A scenario, or each case of a family: name, beginning of the case's name, file, seed, and the values that it draws.
def _places_of(spec: ScenarioSpec, loaded: LoadedSuite) -> Iterator[tuple[str, str, Path, int | None, Values]]:
    try:
        if spec.split is None or spec.cases is None:
            source = find_scenario_beside(spec.source, loaded.directory)
            name = spec.name or read_scenario_name(source)
            yield name, name, source, None, {}
            return
        family = find_family_beside(spec.source, loaded.directory)
        name = spec.name or family.name
        for i, seed in enumerate(family.seeds_of(spec.split, spec.cases)):
            yield name, f"{name}/seed={seed}", family.scenario, seed, family.values_of(spec.split, i)
    except (ScenarioError, UsageError) as error:
        raise ScenarioError(f"{loaded.shown_path}: scenarios: {error}") from error


def read_scenario_name(path: Path) -> str:
    """Return the name that a scenario's file gives it, else that of the file."""
    block = read_yaml(read_regular_file(path).decode("utf-8-sig"), source=str(path)).block
    return str((block or {}).get("name", path.stem))


def _combinations(axes: Sequence[Axis], suite_seed: int) -> Iterator[dict[str, Any]]:
    listed = [
        [{path: _value(path, values, k, suite_seed) for path, values in axis.items()} for k in range(_length(axis))]
        for axis in axes
    ]
    for choice in itertools.product(*listed):
        yield {path: value for part in choice for path, value in part.items()}


def _length(axis: Axis) -> int:
    return n_values(next(iter(axis.values()))) if axis else 1


def _value(path: str, values: "DrawSpec | tuple[Any, ...]", k: int, suite_seed: int) -> Any:
    if isinstance(values, DrawSpec):
        return derive_seed(suite_seed, "draw", path, k)
    return values[k]


# `agents[0].vehicle.start_m: [3, 3, 0.2]` becomes `start=3,3,0.2`.
def _labels(varied: dict[str, Any]) -> Iterator[str]:
    for path, value in varied.items():
        if path.startswith(LABELS):
            continue
        key = path.rpartition(".")[2].partition("[")[0]
        ending = next((unit for unit in _UNITS if key.endswith(unit)), "")
        yield f"{key.removesuffix(ending)}={_short(value)}"


def _short(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ",".join(_short(item) for item in value)
    if isinstance(value, dict):
        return ",".join(f"{key}:{_short(inner)}" for key, inner in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, kw_only=True)
class PlannedEntry:
    """An entry of a plan: its name, its hash, and what its card says."""

    spec: EntrySpec
    directory: Path
    agent_hash: str
    card: MethodCard | None

    def value_of(self, parameter: str) -> Any:
        """Return a parameter's value; see `find_parameter_value`."""
        return find_parameter_value(self.spec, self.card, parameter)


def find_parameter_value(entry: EntrySpec, card: MethodCard | None, parameter: str) -> Any:
    """Return a parameter's value: the entry's own, or the default of its card; None where nobody says."""
    known = card.parameters.get(parameter) if card is not None else None
    return entry.parameters.get(parameter, known.default if known is not None else None)


def group_settings(entries: Sequence[PlannedEntry]) -> list[dict[str, Any]]:
    """Return groups of entries that differ in parameters alone, as `manifest.json` has them.

    Each has a `title`, and for the parameters that differ `units`, `defaults` of the card and, by entry, `values`.
    """
    groups: dict[str, list[PlannedEntry]] = {}
    for entry in entries:
        same = entry.spec.model_dump_json(exclude={"name", "parameters", "parameters_in"})
        groups.setdefault(f"{entry.agent_hash}/{same}", []).append(entry)
    found: list[dict[str, Any]] = []
    for group in groups.values():
        names = dict.fromkeys(name for entry in group for name in entry.spec.parameters)
        varied = [name for name in names if any(e.value_of(name) != group[0].value_of(name) for e in group)]
        if varied:
            card = group[0].card
            known = card.parameters if card is not None else {}
            found.append(
                {
                    "title": card.title if card is not None else group[0].spec.name,
                    "units": {name: known[name].unit if name in known else "1" for name in varied},
                    "defaults": {name: known[name].default for name in varied if name in known},
                    "values": {e.spec.name: {name: e.value_of(name) for name in varied} for e in group},
                }
            )
    return found


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The trials of a suite in order, and what was dropped or moved.

    `suite_hash` is equal for all who meet the same cases, whatever they enter. `n_left_out` counts by case the trials
    that nobody wanted; they have a place in the order but no id, as their scenarios were not resolved. The first trial
    of each case is always planned.
    """

    loaded: LoadedSuite
    cases: tuple[Case, ...]
    trials: tuple[Trial, ...]
    dropped: tuple[DroppedCase, ...]
    moved: tuple[MovedStart, ...]
    entries: tuple[PlannedEntry, ...]
    suite_hash: str
    software_hash: str
    n_left_out: Mapping[str, int] = field(default_factory=dict[str, int])

    @property
    def n_trials(self) -> int:
        """The number of trials that the suite has, those that were left out too."""
        return len(self.trials) + sum(self.n_left_out.values())

    @property
    def sim_s(self) -> float:
        """Simulated time if every trial took as long as it may [s]."""
        limits_s = {case.name: 0.0 for case in self.cases}
        for trial in self.trials:
            if not limits_s[trial.case]:
                limits_s[trial.case] = trial.resolved.referee.stop.time_limit_s
        return sum(limits_s[trial.case] for trial in self.trials) + sum(
            n * limits_s[case] for case, n in self.n_left_out.items()
        )


def build_plan(
    loaded: LoadedSuite,
    *,
    wants: Callable[[TrialSlot], bool] = lambda _: True,
    progress: Progress = lambda _: None,
) -> Plan:
    """Return the plan of a suite.

    Args:
        wants: Whether a trial is wanted. To resolve what an entry flies takes most of the time; ids, seeds and order
            are the same whatever else is wanted.
    """
    owned = list(expand_cases(loaded))
    sources = (*_suite_files(loaded), *(case.source.absolute() for _, case in owned))
    planner = _Planner(tuple(dict.fromkeys(sources)), wants)
    trials: list[Trial] = []
    n_left_out: dict[str, int] = {}
    n_trials = 0
    cases: list[Case] = []
    case_hashes: list[str] = []
    dropped: list[DroppedCase] = []
    # By their texts: many cases have the same ones.
    problems: dict[str, LocatedProblem] = {}
    for owner, case in owned:
        try:
            found = planner.trials_of(loaded, owner, case, first_index=n_trials)
        except InvalidScenarioError as error:
            problems |= {str(problem): problem for problem in error.problems}
            if len(problems) >= MAX_PROBLEMS:
                break
            continue
        if isinstance(found, DroppedCase):
            dropped.append(found)
            continue
        cases.append(case)
        trials += found.trials
        n_trials += found.n_trials
        if found.n_trials > len(found.trials):
            n_left_out[case.name] = found.n_trials - len(found.trials)
        case_hashes += found.case_hashes
        progress(n_trials)
    if problems:
        raise InvalidScenarioError(list(problems.values()), name=loaded.shown_path)
    if not trials:
        reasons = f" The first: {dropped[0].case}: {dropped[0].reason}" if dropped else ""
        raise ScenarioError(f"{loaded.shown_path}: expected at least one case, was none.{reasons}")
    return Plan(
        loaded=loaded,
        cases=tuple(cases),
        trials=tuple(trials),
        dropped=tuple(dropped),
        moved=tuple(planner.moved),
        entries=tuple(planner.entries.values()),
        suite_hash=combine_hashes(case_hashes),
        software_hash=software_hash(),
        n_left_out=n_left_out,
    )


def build_plan_of_rows(
    loaded: LoadedSuite, rows: Iterable[Mapping[str, Any]], *, wants: Callable[[TrialSlot], bool] = lambda _: False
) -> Plan:
    """Return the plan of a suite with the trials of some rows of results; the whole one where it lacks some of them.

    Args:
        rows: Rows as `trials.parquet` has them.
        wants: Whether another trial is wanted too.
    """
    # As plain tuples, which equal slots: rows of somebody else may lack a column.
    slots = {tuple(row.get(key) for key in TrialSlot._fields): row["trial"] for row in rows}
    plan = build_plan(loaded, wants=lambda slot: slot in slots or wants(slot))
    is_found = {*slots.values()} <= {trial.id for trial in plan.trials}
    return plan if is_found or not plan.n_left_out else build_plan(loaded)


def _suite_files(loaded: LoadedSuite) -> Iterator[Path]:
    yield loaded.path
    for inner in loaded.included:
        yield from _suite_files(inner)


# What is planned of a case: the wanted trials of all that it has, and the hashes of all its repetitions.
@dataclass(frozen=True, kw_only=True)
class _PlannedCase:
    trials: Sequence[Trial]
    n_trials: int
    case_hashes: Sequence[str]


class _Planner:
    """Plans cases one after the other and remembers rooms and entries."""

    def __init__(self, sources: tuple[Path, ...], wants: Callable[[TrialSlot], bool]) -> None:
        self.entries: dict[str, PlannedEntry] = {}
        self._sources = sources
        self._wants = wants
        self.moved: list[MovedStart] = []
        self._rooms: dict[str, str] = {}

    def trials_of(
        self, loaded: LoadedSuite, owner: LoadedSuite, case: Case, *, first_index: int
    ) -> "_PlannedCase | DroppedCase":
        giver = loaded if loaded.suite.entries or owner is loaded else owner
        entries = [self._entry(spec, giver) for spec in giver.suite.entries_with_anchors]
        trials: list[Trial] = []
        case_hashes: list[str] = []
        n_trials = 0
        resolved: _Resolved | None = None
        for repetition in range(case.repetitions):
            seed, gas_seed = case.run_seed(repetition), case.plume_seed(repetition)
            if resolved is None or resolved.has_random_places:
                scenario, directory = _load(case, seed)
                scenario = self._with_free_starts(case, scenario, directory, owner.suite.move_starts_up_to_m)
                if problems := find_position_problems(scenario, scenario_dir=directory):
                    if owner.suite.when == "places_are_free":
                        return DroppedCase(case=case.name, reason=_text_of(problems[0]))
                    raise _located_in(case.set_in, problems)
                # Where places are drawn they are drawn for each repetition.
                is_drawn = _has_random_places(case, scenario) if resolved is None else resolved.has_random_places
                room = self._room_key(scenario, directory)
                resolved = _Resolved(case, scenario, directory, room, has_random_places=is_drawn)
            for is_control in (False, True) if repetition < case.n_controls else (False,):
                wanted = [
                    (n_trials + i, entry)
                    for i, entry in enumerate(entries)
                    if self._wants(
                        TrialSlot(case.scenario, case.family, case.name, repetition, is_control, entry.spec.name)
                    )
                    or not n_trials + i
                ]
                n_trials += len(entries)
                resolved.check([entry for _, entry in wanted], is_control=is_control)
                shared = case_hash(
                    _with_seeds(resolved.scenario, seed, gas_seed), resolved.room,
                    is_control=is_control, repetition=repetition,
                )  # fmt: skip
                case_hashes.append(shared)
                trials += [
                    self._trial(
                        resolved, entry, _with_seeds(resolved.flown(entry, is_control=is_control), seed, gas_seed),
                        shared, repetition=repetition, is_control=is_control, index=first_index + i,
                    )
                    for i, entry in wanted
                ]  # fmt: skip
        return _PlannedCase(trials=trials, n_trials=n_trials, case_hashes=case_hashes)

    def _trial(
        self,
        resolved: "_Resolved",
        entry: PlannedEntry,
        flown: Scenario,
        shared: str,
        *,
        repetition: int,
        is_control: bool,
        index: int,
    ) -> Trial:
        case = resolved.case
        return Trial(
            id=trial_id(flown, resolved.room, entry.spec.name, entry.agent_hash),
            index=index,
            case=case.name,
            scenario=case.scenario,
            family=case.family,
            varied=json.dumps(dict(case.varied)),
            repetition=repetition,
            entry=entry.spec.name,
            is_control=is_control,
            scenario_json=json.dumps(plain_values(flown)),
            directory=resolved.directory,
            room=resolved.room,
            tape=_tape_key(flown, resolved.room) if flown.gas.tape else None,
            case_hash=shared,
            sources=self._sources,
        )

    def _entry(self, spec: EntrySpec, giver: LoadedSuite) -> PlannedEntry:
        planned = self.entries.get(spec.name)
        if planned is None:
            planned = PlannedEntry(
                spec=spec,
                directory=giver.directory,
                agent_hash=agent_hash(spec, giver.directory),
                card=find_card(spec, giver.directory),
            )
            self.entries[spec.name] = planned
        elif planned.spec != spec:
            raise ScenarioError(
                f"{giver.shown_path}: entries: expected one meaning of {spec.name} in all suites that are included, "
                "was several. List the entries in the outer suite."
            )
        return planned

    def _with_free_starts(self, case: Case, scenario: Scenario, directory: Path, up_to_m: float) -> Scenario:
        if not up_to_m:
            return scenario
        room, agents = build_environment(scenario, directory), list(scenario.agents)
        for i, agent in enumerate(agents):
            start_m = agent.vehicle.start_m
            if can_start_at(start_m, agent.vehicle, room):
                continue
            to_m = nearest_start_m(agent.vehicle, room)
            if to_m is not None and math.dist(start_m, to_m) <= up_to_m:
                vehicle = agent.vehicle.model_copy(update={"start_m": to_m})
                agents[i] = agent.model_copy(update={"vehicle": vehicle})
                self.moved.append(MovedStart(case=case.name, agent=agent.name, from_m=start_m, to_m=to_m))
        return scenario.model_copy(update={"agents": tuple(agents)})

    def _room_key(self, scenario: Scenario, directory: Path) -> str:
        environment, wind = scenario.environment, scenario.wind
        text = f"{directory}\n{environment.model_dump_json()}\n{wind.model_dump_json()}"
        if text not in self._rooms:
            self._rooms[text] = (
                load_environment(find_folder(environment, directory)).content_hash
                if environment.path is not None
                else recipe_hash(environment, wind, scenario_dir=directory)
            )
        return self._rooms[text]


class _Resolved:
    """A case as resolved, and what each entry flies in it; seeds are put in afterwards."""

    def __init__(self, case: Case, scenario: Scenario, directory: Path, room: str, *, has_random_places: bool) -> None:
        self.case = case
        self.scenario = scenario
        self.directory = directory
        self.room = room
        self.has_random_places = has_random_places
        self._flown: dict[tuple[str, bool], Scenario] = {}

    def check(self, entries: Sequence[PlannedEntry], *, is_control: bool) -> None:
        """Raise the problems of all entries in this case as one error; do nothing when there are none."""
        problems: list[LocatedProblem] = []
        for entry in entries:
            try:
                self.flown(entry, is_control=is_control)
            except InvalidScenarioError as error:
                problems += error.problems
        if problems:
            raise InvalidScenarioError(problems, name=self.case.set_in)

    def flown(self, entry: PlannedEntry, *, is_control: bool) -> Scenario:
        """Return what an entry flies."""
        key = (entry.spec.name, is_control)
        if key not in self._flown:
            self._flown[key] = self._flown_by(entry, is_control=is_control)
        return self._flown[key]

    def _flown_by(self, entry: PlannedEntry, *, is_control: bool) -> Scenario:
        where = f"{self.case.set_in}: entry {entry.spec.name}"
        try:
            values = apply_entry(
                self.scenario,
                self.case.scenario,
                entry.spec,
                card=entry.card,
                directory=entry.directory,
                scenario_dir=self.directory,
                is_sandboxed=self.case.is_sandboxed,
                has_sensor_holds=self.case.has_sensor_holds,
            )
            if is_control:
                close_sources(values)
        except ProblemsError as error:
            raise _located_in(where, error.problems) from error
        values["recording"]["enabled"] = False
        for key in list_live_keys():
            values.pop(key.name, None)
        return resolve_values(values, self.directory, source=where, checks=list_scenario_checks("agents", "services"))


def _located_in(source: str, problems: Sequence[Problem]) -> InvalidScenarioError:
    return InvalidScenarioError(locate(problems, TextLocations(TextLocation(source=source))), name=source)


def _text_of(problem: Problem) -> str:
    return f"{problem.where}: expected {problem.expected}, was {problem.found}."


def _load(case: Case, seed: int) -> tuple[Scenario, Path]:
    placer = draw_positions if case.source_height_m is None else partial(_draw_at_height, case.source_height_m)
    loaded = load_scenario(case.source, overrides=case.overrides, seed=seed, placer=placer, set_in=case.set_in)
    scenario = with_sensor_holds(loaded.scenario) if case.has_sensor_holds else loaded.scenario
    return scenario, loaded.directory


# Draws places anew, from a stream of the seed's own, until all sources are in air at their height.
def _draw_at_height(
    height_m: float,
    spec: EnvironmentSpec,
    wind: SolverSpec,
    scenario_dir: Path,
    seed: int,
    wanted: Sequence[RandomPosition],
) -> Mapping[str, Vec3]:
    room = read_room(spec, wind, scenario_dir)
    if room is None:
        return {}
    for i in range(MAX_DRAWS):
        places = draw_positions(spec, wind, scenario_dir, derive_seed(seed, "height", i) if i else seed, wanted)
        found = {
            each.path: (*places[each.path][:2], round(float(room.grid.origin_m[2]) + height_m, 6))
            for each in wanted
            if each.vehicle is None and each.path in places
        }
        if not find_point_problems(list(found.items()), room):
            return {**places, **found}
    return {}


# Drawn places differ from seed to seed.
def _has_random_places(case: Case, scenario: Scenario) -> bool:
    return "random" in f"{case.source.read_text()}{case.overrides}" and _places(_load(case, scenario.seed ^ 1)[0]) != (
        _places(scenario)
    )


def _places(scenario: Scenario) -> list[Any]:
    return [*(s.position_m for s in scenario.gas.sources), *(agent.vehicle.start_m for agent in scenario.agents)]


def _with_seeds(scenario: Scenario, seed: int, gas_seed: int) -> Scenario:
    gas = scenario.gas.model_copy(update={"seed": gas_seed})
    return scenario.model_copy(update={"seed": seed, "gas": gas})


def _tape_key(scenario: Scenario, room: str) -> str:
    gas = scenario.gas.model_dump_json()
    return _hash_of_texts([room, gas, f"{scenario.tick_ms}/{scenario.referee.stop.time_limit_s}"])


def combine_hashes(case_hashes: Sequence[str]) -> str:
    """Return the hash of a suite from those of its cases and repetitions, in whatever order and number."""
    return _hash_of_texts(sorted(set(case_hashes)))


def _hash_of_texts(texts: Sequence[str]) -> str:
    return hashlib.blake2b("\n".join(texts).encode(), digest_size=12).hexdigest()
