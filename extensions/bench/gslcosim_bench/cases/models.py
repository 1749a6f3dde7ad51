"""Frozen models of a suite file, and the cases and trials of a plan."""

import hashlib
import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self, cast

from pydantic import BeforeValidator, Field, model_validator

from gslcosim.base.errors import UsageError
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import ParameterValue
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.base import Name, NonNegative, Positive, Spec
from gslcosim.scenario.models.scenario import KnowledgeSpec, StartSpec
from gslcosim.scenario.models.sensors import Sensor

SCHEMA = "gslcosim/suite/1"
LOWER_ANCHOR, UPPER_ANCHOR = "oracle", "random_walker"
MAX_NAME_LENGTH = 40
MAX_SETTINGS = 500
"""More combinations of parameters than this are no sweep but a search."""
MAX_COMPARED_SETTINGS = 60
"""Most settings that `bench sweep` writes a report of, and a report compares in each case: more take minutes."""

SMALLEST_DIFFERENCE_POINTS = 10.0
"""Difference below which entries are equally successful, unless a suite gives another [points of success]."""

Values = dict[str, Any]
"""Values of a scenario by their paths, such as `agents[0].vehicle.hold_s`."""

SPLITS = ("training", "validation", "test")
Split = Literal["training", "validation", "test"]


LABELS = "labels."
"""Beginning of paths that set no value of a scenario: `labels.wind: gusting` is the level of a case on an axis."""
START_PATH = "agents[0].vehicle.start_m"
SEED_PATHS = ("seed", "gas.seed")
"""Values that `seeds` of a scenario give to each repetition."""
_BITS = 31
KEYS = ("entry", "scenario", "family", "case", "repetition", "control", "trial")
_NAMES = ("entry", "scenario", "family", "case")
_MAX_LISTED = 40
MOST_SHARDS = 100_000


def as_overrides(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Return values of a scenario as `load_scenario` takes them, without labels."""
    return tuple(f"{path}={json.dumps(value)}" for path, value in values.items() if not path.startswith(LABELS))


def select_labels(values: Mapping[str, Any]) -> Values:
    """Return the labels among values, by their paths."""
    return {path: value for path, value in values.items() if path.startswith(LABELS)}


def check_lengths(key: str, lengths: Mapping[str, int], *, remedy: str) -> None:
    """Refuse lists of an item of `vary` that are not of one length."""
    if len(set(lengths.values())) > 1:
        raise broken_rule_error(
            key=key,
            expected="lists of one length: within an item they go together",
            found=", ".join(f"{name} with {n}" for name, n in lengths.items()),
            remedy=remedy,
        )


class DrawSpec(Spec):
    """As many whole numbers as `draw` says, drawn by the suite's seed: for layouts and other seeds."""

    draw: Annotated[int, Field(ge=1, le=10_000)]


Axis = dict[str, DrawSpec | Annotated[tuple[Any, ...], Field(min_length=1)]]
"""Values that vary, by their paths: lists of one item go together."""


class ScenarioSpec(Spec):
    """A scenario of the suite: a file or a bundled name, values that replace its own, and what varies in it alone.

    `name` is what it is called here, its own if absent; `family` is the group of cases that it is counted in, its name
    if absent. With `split` it is a family: its first `cases` cases of that split, each with the seed that it has there.
    `vary` multiplies with the suite's, and replaces its items for the same values; `starts` are starts of the vehicle,
    world frame [m], one case each. `source_height_m` is the height above the floor of all sources whose places are
    drawn; absent: drawn too. `repetitions` and `gas_seeds` replace the suite's. `seeds` are those of the runs:
    one repetition for each, whose run and gas have it.
    """

    source: str
    name: Name | None = None
    family: Name | None = None
    split: Split | None = None
    cases: Annotated[int, Field(ge=1, le=100_000)] | None = None
    set: Values = {}  # noqa: RUF012 - pydantic copies it
    vary: tuple[Axis, ...] = ()
    starts: Annotated[tuple[Vec3, ...], Field(min_length=1)] | None = None
    source_height_m: Positive | None = None
    repetitions: Annotated[int, Field(ge=1, le=100_000)] | None = None
    gas_seeds: Annotated[int, Field(ge=1, le=100_000)] | None = None
    seeds: Annotated[tuple[Annotated[int, Field(ge=0, lt=2**31)], ...], Field(min_length=1)] | None = None

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of this scenario alone, its starts first."""
        return (*([{START_PATH: self.starts}] if self.starts else []), *self.vary)

    @model_validator(mode="after")
    def _check_split(self) -> Self:
        if (self.split is None) != (self.cases is None):
            raise broken_rule_error(
                key="cases" if self.cases is None else "split",
                expected="split and cases together: how many cases of which split of a family",
                found="one of them alone",
                remedy="For example {source: open_halls, split: test, cases: 20}.",
            )
        return self

    @model_validator(mode="after")
    def _check_seeds(self) -> Self:
        if self.seeds is None:
            return self
        other = next((key for key in ("split", "repetitions", "gas_seeds") if getattr(self, key) is not None), None)
        if other is not None:
            found = "cases of a family, which have their own" if other == "split" else f"{other} too"
            raise broken_rule_error(
                key="seeds",
                expected="seeds of a scenario, one for each repetition",
                found=found,
                remedy=f"Leave out seeds or {other}.",
            )
        if twice := next((seed for seed in self.seeds if self.seeds.count(seed) > 1), None):
            raise broken_rule_error(
                key="seeds", expected="each seed once", found=f"{twice} twice", remedy="Leave one out."
            )
        return self

    @model_validator(mode="after")
    def _check_vary(self) -> Self:
        check_axes(self.vary)
        paths = [path for axis in self.axes for path in axis]
        if twice := next((path for path in paths if paths.count(path) > 1), None):
            key = "starts" if twice == START_PATH and self.starts else "vary"
            raise broken_rule_error(
                key=key, expected="each value to vary in one place", found=f"{twice} in two", remedy="Leave one out."
            )
        return self


class EntrySpec(Spec):
    """A method under a name: a program, its parameters, and what it gets.

    What is absent is the scenario's: `sensors` and `mode` of its first agent. `sensors: by_method` gives those that the
    card of the method asks for. `knows` is what the method's card asks for if absent. With several `robots` the first
    stands where the scenario's does and the others around it; a Python program flies all of them as one team. `radio`
    gives them a channel; absent: when the card asks for one. `parameters_in` are parameters for single scenarios.
    `vary` lists values of parameters: the entry then stands for one entry for each combination of them.
    """

    name: Name
    start: StartSpec
    parameters: dict[Name, ParameterValue] = {}  # noqa: RUF012 - as above
    parameters_in: dict[Name, dict[Name, ParameterValue]] = {}  # noqa: RUF012 - as above
    vary: dict[Name, Annotated[tuple[ParameterValue, ...], Field(min_length=1)]] = {}  # noqa: RUF012 - as above
    sensors: Literal["by_method"] | Annotated[tuple[Sensor, ...], Field(min_length=1)] | None = None
    mode: Literal["on_request", "lockstep"] | dict[Literal["latency"], Annotated[int, Field(ge=1, le=1000)]] | None = (
        None
    )
    knows: KnowledgeSpec | None = None
    robots: Annotated[int, Field(ge=1, le=100)] = 1
    radio: bool | None = None

    @model_validator(mode="after")
    def _check_start(self) -> Self:
        others = [key for key in ("process_of", "attach") if getattr(self.start, key)]
        if (registered := self.start.registered) is not None:
            others.append(registered.name)
        if others:
            raise broken_rule_error(
                key="start",
                expected="a program that the benchmark starts: python or command",
                found=others[0],
                remedy="Several robots of one program are robots: N.",
            )
        if self.start.command is not None and not self.start.is_behind_gateway:
            raise broken_rule_error(
                key="start",
                expected="door: stdio, tcp or unix for a program that is started with command",
                found="door: zenoh",
                remedy="Add door: stdio to the start.",
            )
        return self

    @model_validator(mode="after")
    def _check_vary(self) -> Self:
        n_settings = math.prod(len(values) for values in self.vary.values())
        if n_settings > MAX_SETTINGS:
            raise broken_rule_error(
                key="vary",
                expected=f"at most {MAX_SETTINGS} combinations of values",
                found=str(n_settings),
                remedy="Vary less at a time, or search: gslcosim bench tune.",
            )
        for name, values in self.vary.items():
            if twice := [value for i, value in enumerate(values) if value in values[:i]]:
                raise broken_rule_error(
                    key=f"vary.{name}", expected="each value once", found=f"{twice[0]} twice", remedy="Leave one out."
                )
        return self

    @property
    def settings(self) -> "tuple[EntrySpec, ...]":
        """The entries that it stands for: itself, or one for each combination of `vary`, the last parameter fastest.

        Names tell the values, as in `e_coli_step_m_0_5`; where they would be too long or equal they are numbered.
        """
        if not self.vary:
            return (self,)
        combinations = [dict(zip(self.vary, values, strict=True)) for values in itertools.product(*self.vary.values())]
        names = ["_".join([self.name, *(f"{k}_{_name_value(v)}" for k, v in each.items())]) for each in combinations]
        if len(set(names)) < len(names) or max(map(len, names)) > MAX_NAME_LENGTH:
            width = len(str(len(names)))
            stem = self.name[: MAX_NAME_LENGTH - width - 1].rstrip("_")
            names = [f"{stem}_{i + 1:0{width}d}" for i in range(len(names))]
        return tuple(self.with_parameters(name, each) for name, each in zip(names, combinations, strict=True))

    def with_parameters(self, name: str, parameters: Mapping[str, ParameterValue]) -> "EntrySpec":
        """Return the entry under another name with other values of some parameters, in all scenarios."""
        # A parameter for a single scenario would hide the values that are compared.
        kept = {
            scenario: {key: value for key, value in values.items() if key not in parameters}
            for scenario, values in self.parameters_in.items()
        }
        values = {**self.parameters, **parameters}
        return self.model_copy(update={"name": name, "parameters": values, "parameters_in": kept, "vary": {}})


def _name_value(value: ParameterValue) -> str:
    if isinstance(value, tuple):
        return "_".join(_name_value(item) for item in value)
    text = f"{value:g}" if isinstance(value, float) else str(value).lower()
    if isinstance(value, int | float):
        text = text.replace("-", "minus_")
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")


class ControlsSpec(Spec):
    """Runs without gas: how many of them for each run with it."""

    no_source_frac: Annotated[float, Field(ge=0, le=1)] = 0.0


class RecordSpec(Spec):
    """Choice of runs that are repeated with a recording when all have ended."""

    keep: tuple[Literal["first_failure", "median", "slowest"], ...] = ()


class LimitsSpec(Spec):
    """Limits of a trial before it is ended and reported: wall time and memory."""

    wall_s: Positive = 600.0
    memory_mb: Positive = 4096.0


# Strict models take tuples; lists are what JSON has.
def _scenario_of_text(value: Any) -> Any:
    if isinstance(value, dict):
        block = cast("dict[str, Any]", value)
        return {key: inner if key == "set" else _as_tuples(inner) for key, inner in block.items()}
    return {"source": value} if isinstance(value, str) else value


def _as_tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_tuples(inner) for key, inner in cast("dict[str, Any]", value).items()}
    return tuple(map(_as_tuples, cast("list[Any]", value))) if isinstance(value, list) else value


ScenarioEntry = Annotated[ScenarioSpec, BeforeValidator(_scenario_of_text, json_schema_input_type=str | ScenarioSpec)]


class Suite(Spec):
    """A whole suite file.

    Every combination of a scenario with the values of `vary` is a case; each is run `repetitions` times by every
    entry. `vary` multiplies; within one of its items the lists go together. `set` replaces values in all scenarios.
    `when: places_are_free` leaves out cases in which a vehicle or a source would stand in something solid; otherwise
    they are errors. `gas_seeds` is how many plumes each scenario has, as many as repetitions if absent. `include` takes
    the cases of other suites, and their entries where this one has none. `anchors` are run beside the entries.
    `hold_s` makes every vehicle hold so long after each leg, whatever its method asks for; `by_sensor` takes the T90 of
    the slowest gas sensor on board.
    `sandbox: required` flies every agent of these cases as a process in a sandbox, Python agents too, wherever the
    suite is included; `optional` flies Python agents as objects in the worker, which is quicker and for agents one
    trusts.
    `sealed`, in the suite of results, is the commitment to a seed that is secret.
    `smallest_difference_points` is the difference in success that matters: entries are called equally successful whose
    difference is smaller.
    `nulls` are entries that every method has to beat: the report gives each entry's difference to the best of them in
    each case.
    """

    schema_: Literal["gslcosim/suite/1"] = Field(alias="schema")
    name: Name
    title: str = ""
    question: str = ""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    include: tuple[str, ...] = ()
    scenarios: tuple[ScenarioEntry, ...] = ()
    set: Values = {}  # noqa: RUF012 - as above
    vary: tuple[Axis, ...] = ()
    when: Literal["places_are_free"] | None = None
    move_starts_up_to_m: NonNegative = 0.0
    repetitions: Annotated[int, Field(ge=1, le=100_000)] = 1
    gas_seeds: Annotated[int, Field(ge=1, le=100_000)] | None = None
    hold_s: NonNegative | Literal["by_sensor"] | None = None
    entries: tuple[EntrySpec, ...] = ()
    anchors: tuple[Literal["oracle", "random_walker"], ...] = (LOWER_ANCHOR, UPPER_ANCHOR)
    controls: ControlsSpec = ControlsSpec()
    record: RecordSpec = RecordSpec()
    limits: LimitsSpec = LimitsSpec()
    sandbox: Literal["optional", "required"] = "optional"
    sealed: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    smallest_difference_points: Annotated[float, Field(gt=0, lt=100)] = SMALLEST_DIFFERENCE_POINTS
    nulls: tuple[Name, ...] = ()

    @property
    def entries_with_anchors(self) -> tuple[EntrySpec, ...]:
        """The entries with each setting of those that vary, and the anchors that are not among them by name."""
        entries = tuple(setting for entry in self.entries for setting in entry.settings)
        names = {entry.name for entry in entries}
        robots = max((entry.robots for entry in self.entries), default=1)
        least = min((entry.robots for entry in self.entries), default=1)
        anchors = (
            EntrySpec(name=name, start=StartSpec(python=name), robots=robots if robots == least else 1)
            for name in self.anchors
            if name not in names
        )
        return (*entries, *anchors)

    @model_validator(mode="after")
    def _check_cases(self) -> Self:
        if not self.scenarios and not self.include:
            raise broken_rule_error(
                key="scenarios",
                expected="at least one scenario, or include",
                found="none",
                remedy="For example scenarios: [gsl_bench_1].",
            )
        if not self.scenarios and (self.vary or self.set):
            raise broken_rule_error(
                key="vary" if self.vary else "set",
                expected="scenarios that it is about: cases of included suites stay as they are",
                found="none",
                remedy="Leave it out, or list the scenarios.",
            )
        return self

    @model_validator(mode="after")
    def _check_hold(self) -> Self:
        values = (self.set, *self.vary, *(block for spec in self.scenarios for block in (spec.set, *spec.vary)))
        places = (path for block in values for path in block)
        twice = next((path for path in places if path.startswith("agents[0].vehicle.hold_")), None)
        if self.hold_s is not None and twice is not None:
            raise broken_rule_error(
                key="hold_s",
                expected=f"one place that says how long vehicles hold: hold_s, or {twice}",
                found="both",
                remedy=f"Leave {twice} out; hold_s holds for all entries.",
            )
        return self

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        names = [setting.name for entry in self.entries for setting in entry.settings]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise broken_rule_error(
                key="entries", expected="a name of its own for each", found=f"{twice} twice", remedy="Rename one."
            )
        if missing := next((name for name in self.nulls if self.entries and name not in names), None):
            raise broken_rule_error(
                key="nulls",
                expected="names of entries of the suite",
                found=missing,
                remedy="Add it to entries, or leave it out.",
            )
        # Anchors alone would compare nothing; cases of included suites have the entries of those suites.
        if self.scenarios and not self.entries:
            raise broken_rule_error(
                key="entries", expected="at least one entry", found="none",
                remedy="For example entries: [{name: dung_beetle, start: {python: dung_beetle}}].",
            )  # fmt: skip
        return self

    @model_validator(mode="after")
    def _check_vary(self) -> Self:
        check_axes(self.vary)
        for i, spec in enumerate(self.scenarios):
            own = {path for axis in spec.axes for path in axis}
            if part := next((axis for axis in self.vary if own & set(axis) and not own >= set(axis)), None):
                missing = next(path for path in part if path not in own)
                raise broken_rule_error(
                    key=f"scenarios[{i}].vary",
                    expected="all values of an item of the suite's vary, which go together, or none of them",
                    found=f"{next(path for path in part if path in own)} without {missing}",
                    remedy=f"Vary {missing} in this scenario too.",
                )
        return self

    @model_validator(mode="after")
    def _check_seeds(self) -> Self:
        for i, spec in enumerate(self.scenarios):
            varied = {path for axis in self.axes_of(spec) for path in axis}
            places = (("vary", varied), ("set", {*self.set, *spec.set}))
            twice = next(((path, key) for key, paths in places for path in SEED_PATHS if path in paths), None)
            if spec.seeds is not None and twice is not None:
                path, key = twice
                raise broken_rule_error(
                    key=f"scenarios[{i}].seeds",
                    expected="one place that gives the seeds of runs and gas",
                    found=f"{path} in {key} too",
                    remedy=f"Leave out seeds or {path}.",
                )
        return self

    def axes_of(self, spec: ScenarioSpec) -> tuple[Axis, ...]:
        """Return what varies in a scenario: items of the suite that it does not replace, then its own."""
        own = {path for axis in spec.axes for path in axis}
        return (*(axis for axis in self.vary if not own & set(axis)), *spec.axes)


def check_axes(axes: Sequence[Axis]) -> None:
    """Refuse items of `vary` whose lists are not of one length."""
    for i, axis in enumerate(axes):
        lengths = {key: n_values(values) for key, values in axis.items()}
        check_lengths(f"vary[{i}]", lengths, remedy="Write what multiplies as items of its own.")


def n_values(values: "DrawSpec | tuple[Any, ...]") -> int:
    """Return the number of values of an axis."""
    return values.draw if isinstance(values, DrawSpec) else len(values)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One scenario of a suite with one combination of what varies; without entry and repetition.

    `varied` holds values by path, labels first; `set_in` says, for problems, which file sets them. `is_sandboxed` is
    whether its suite, or one that includes it, demands a sandbox for agents.
    """

    name: str
    scenario: str
    family: str
    source: Path
    varied: Mapping[str, Any]
    overrides: tuple[str, ...]
    suite_seed: int
    repetitions: int
    gas_seeds: int
    no_source_frac: float
    is_sandboxed: bool
    set_in: str
    seed: int | None = None
    """That of its family, for cases of one."""
    seeds: tuple[int, ...] = ()
    """Those of its repetitions, where its scenario lists them."""
    has_sensor_holds: bool = False
    """True if vehicles hold as long as their slowest gas sensor takes to respond."""
    source_height_m: float | None = None
    """Height above the floor of sources whose places are drawn [m]; None: drawn too."""

    def run_seed(self, repetition: int) -> int:
        """Return the seed of its runs of a repetition."""
        if self.seeds:
            return self.seeds[repetition]
        if self.seed is None:
            return derive_seed(self.suite_seed, self.name, repetition)
        return derive_seed(self.seed, "run", repetition) if repetition else self.seed

    def plume_seed(self, repetition: int) -> int:
        """Return the seed of the gas of a repetition; scenarios of suites share their plumes between cases."""
        i_plume = repetition % self.gas_seeds
        if self.seeds:
            return self.seeds[i_plume]
        if self.seed is None:
            return derive_seed(self.suite_seed, "gas", self.scenario, i_plume)
        return derive_seed(self.seed, "gas", i_plume) if i_plume else self.seed

    @property
    def n_controls(self) -> int:
        """Number of repetitions that also run without gas."""
        return round(self.no_source_frac * self.repetitions)


@dataclass(frozen=True, kw_only=True)
class DroppedCase:
    """A combination that is no case, and why."""

    case: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class MovedStart:
    """A start that was not free and has been moved, world frame [m]."""

    case: str
    agent: str
    from_m: tuple[float, float, float]
    to_m: tuple[float, float, float]


class TrialSlot(NamedTuple):
    """Place of a trial in a suite: what is known of it before its scenario is resolved."""

    scenario: str
    family: str
    case: str
    repetition: int
    is_control: bool
    entry: str


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of one entry in one case: everything that a worker needs, as plain data.

    `scenario_json` is the scenario as resolved, `directory` where its relative paths start, `room` the key of its
    environment, `tape` that of its gas where it is on tape. `sources` are the suites and scenarios of its plan.
    """

    id: str
    index: int
    case: str
    scenario: str
    family: str
    varied: str
    repetition: int
    entry: str
    is_control: bool
    scenario_json: str
    directory: Path
    room: str
    tape: str | None
    case_hash: str
    sources: tuple[Path, ...] = ()

    @property
    def slot(self) -> TrialSlot:
        """Its place in the suite."""
        return TrialSlot(self.scenario, self.family, self.case, self.repetition, self.is_control, self.entry)

    @cached_property
    def resolved(self) -> Scenario:
        """The scenario that is run."""
        return Scenario.model_validate_json(self.scenario_json)

    @property
    def demands_sandbox(self) -> bool:
        """True where its agents must run in a sandbox."""
        # Most say nothing of it: to read thousands of scenarios takes its time.
        agents = json.loads(self.scenario_json)["agents"] if '"sandbox"' in self.scenario_json else ()
        return any(agent.get("sandbox") == "required" for agent in agents)

    def with_agent_secret(self, secret: str | None) -> "Trial":
        """Return this trial, under its id, with seeds of agents from which trying does not find the run's seed.

        seed of an agent = blake2b(secret / name of the agent), its first 31 bits; a seed that the scenario sets stays

        Args:
            secret: Random text; without any the seeds are those that follow from the run's.
        """
        if not secret:
            return self
        values = json.loads(self.scenario_json)
        for agent in values["agents"]:
            if agent.get("seed") is None:
                digest = hashlib.blake2b(f"{secret}/{agent['name']}".encode(), digest_size=8).digest()
                agent["seed"] = int.from_bytes(digest, "big") >> (64 - _BITS)
        return replace(self, scenario_json=json.dumps(values))


def derive_seed(suite_seed: int, *words: str | int) -> int:
    """Return a seed from 0 to 2^31 - 1 for what the words name, as good as independent of all others.

    seed = blake2b(suite_seed / word / word ...), its first 31 bits

    Args:
        suite_seed: The suite's, which an organiser may keep until the results are in.
        words: What it is for, for example the case and the repetition.
    """
    text = "/".join(str(word) for word in (suite_seed, *words))
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") >> (64 - _BITS)


@dataclass(frozen=True)
class Selection:
    """Patterns by key, as `--only entry=e_*,surge_cast` has them; of one key any may fit, of several keys all must."""

    patterns: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @classmethod
    def of(cls, only: Sequence[str], text: str | None = None) -> "Selection":
        """Return the selection of a command line.

        Args:
            only: Texts like `entry=e_coli,surge_*`.
            text: A pattern for the name of the case, such as `gsl_bench_3/*`.
        """
        patterns: list[tuple[str, tuple[str, ...]]] = []
        for word in only:
            key, equals, values = word.partition("=")
            if not equals or key not in KEYS or not values:
                raise UsageError(
                    f"--only: expected KEY=PATTERN with a key among {', '.join(KEYS)}, was '{word}'. "
                    "For example: --only entry=e_coli,surge_*"
                )
            patterns.append((key, tuple(values.split(","))))
        if text is not None:
            patterns.append(("case", (text if any(c in text for c in "*?[") else f"*{text}*",)))
        return cls(tuple(patterns))

    def takes(self, trial: Trial) -> bool:
        """Return whether a trial is chosen."""
        return self.may_take(trial.slot) and self._fits("trial", trial.id)

    def may_take(self, slot: TrialSlot) -> bool:
        """Return whether a trial in this place can be chosen: whether all keys but `trial` fit."""
        return all(self._fits(key, value) for key, value in _describe_slot(slot).items())

    def check_patterns(self, slots: Iterable[TrialSlot]) -> None:
        """Refuse a pattern that fits nothing in the plan: of an entry, scenario, family or case it is a typo."""
        known: dict[str, dict[str, None]] = {}
        for slot in slots:
            for key, value in _describe_slot(slot).items():
                known.setdefault(key, {})[value] = None
        for key, some in self.patterns:
            if key not in _NAMES:
                continue
            for one in some:
                if known and not any(fnmatchcase(value, one) for value in known[key]):
                    names, n_others = list(known[key])[:_MAX_LISTED], len(known[key]) - _MAX_LISTED
                    listed = ", ".join(names) + (f" and {n_others} others" if n_others > 0 else "")
                    raise UsageError(f"--only {key}={one}: expected a pattern of {listed}, was '{one}'.")

    def _fits(self, key: str, value: str) -> bool:
        return all(any(fnmatchcase(value, one) for one in some) for of, some in self.patterns if of == key)


def _describe_slot(slot: TrialSlot) -> dict[str, str]:
    return {
        "entry": slot.entry,
        "scenario": slot.scenario,
        "family": slot.family,
        "case": slot.case,
        "repetition": str(slot.repetition),
        "control": "yes" if slot.is_control else "no",
    }


@dataclass(frozen=True, kw_only=True)
class Shard:
    """One of `count` parts of a suite, `index` from 1 on: each is run on its own, perhaps on a machine of its own."""

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Return the shard that a command line names, such as `2/8`."""
        index, slash, count = text.partition("/")
        is_number = slash and index.isdecimal() and count.isdecimal() and len(text) < 20
        if not (is_number and 1 <= int(index) <= int(count) <= MOST_SHARDS):
            raise UsageError(
                f"--shard: expected I/N, the I-th of N parts with I from 1 to N and N up to {MOST_SHARDS}, was "
                f"'{text}'. For example: --shard 2/8"
            )
        return cls(index=int(index), count=int(count))

    def __str__(self) -> str:
        """Return it as the command line has it."""
        return f"{self.index}/{self.count}"

    def select(self, trials: Sequence[Trial]) -> list[Trial]:
        """Return the shard's trials, in the order of the suite.

        The trials of a case and repetition, of all entries and with their controls, are in one shard, so that pairs
        are whole. Shards follow from the plan alone: its cases and repetitions are put together by room and tape,
        otherwise in the order of the suite, and cut into `count` pieces whose sizes differ by at most one. So few rooms
        and tapes are made by more than one shard.

        Args:
            trials: Those that all shards fly together, in the order of the suite.
        """
        firsts: dict[tuple[str, int], Trial] = {}
        for trial in trials:
            firsts.setdefault((trial.case, trial.repetition), trial)
        places: dict[str | None, int] = {}
        for trial in firsts.values():
            places.setdefault(trial.room, len(places))
            places.setdefault(trial.tape, len(places))
        ordered = sorted(firsts, key=lambda unit: (places[firsts[unit].room], places[firsts[unit].tape]))
        begin, end = (len(ordered) * i // self.count for i in (self.index - 1, self.index))
        taken = set(ordered[begin:end])
        return [trial for trial in trials if (trial.case, trial.repetition) in taken]


def choose_trials(trials: Sequence[Trial], selection: Selection, shard: Shard | None = None) -> list[Trial]:
    """Return the trials of a plan that a call runs: those of the selection, and of them the shard's."""
    chosen = [trial for trial in trials if selection.takes(trial)]
    return chosen if shard is None else shard.select(chosen)
