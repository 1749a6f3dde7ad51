"""Target of a study: a method, and the suite or scenario in which it runs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.bench.cases.agent_setup import find_card
from gslcosim.bench.cases.models import SCHEMA, EntrySpec, ScenarioSpec, Suite
from gslcosim.bench.cases.suite_files import LoadedSuite, bundled_suites, find_suite, load_suite
from gslcosim.methods.card import MethodCard
from gslcosim.scenario.bundled import bundled_agents, bundled_scenarios
from gslcosim.scenario.loader import find_scenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.scenario.suggestions import did_you_mean
from gslcosim.scenario.yaml_tree import read_yaml

REPETITIONS = 10
"""Default number of flights of a single scenario; a suite states its own."""

_ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True, kw_only=True)
class StudyTarget:
    """A method under study, its card if it has one, and the cases that it flies in."""

    loaded: LoadedSuite
    entry: EntrySpec
    card: MethodCard | None

    def default_of(self, parameter: str) -> Any:
        """Return the value that the entry flies with when nothing is changed; None where nobody says."""
        if parameter in self.entry.parameters:
            return self.entry.parameters[parameter]
        known = self.card.parameters.get(parameter) if self.card is not None else None
        return known.default if known is not None else None


def find_target(source: str, entry: str, *, repetitions: int | None = None, seed: int | None = None) -> StudyTarget:
    """Return what a command line names.

    Args:
        source: A suite or a scenario: a file, or the name of a bundled one.
        entry: An entry of the suite, a bundled method, or a Python file.
        repetitions: Replaces those of the suite and all that it includes; a scenario has 10.
        seed: Replaces the suite's.

    Raises:
        ScenarioError: the suite or scenario is not there, or is wrong.
        UsageError: there is no such entry.
    """
    if is_scenario(source):
        chosen = _bundled_or_file(entry)
        if chosen is None:
            raise UsageError(
                f"--entry: expected a bundled method or a Python file, was '{entry}'. "
                f"{did_you_mean(entry, list(bundled_agents()))}".rstrip()
            )
        loaded = _suite_around(source, chosen, repetitions=repetitions or REPETITIONS, seed=seed)
    else:
        loaded = load_suite(source, seed=seed)
        if repetitions is not None:
            loaded = with_changed_fields(loaded, repetitions=repetitions)
        chosen = _entry_in(loaded, entry)
    return StudyTarget(loaded=loaded, entry=chosen, card=find_card(chosen, loaded.directory))


def is_scenario(source: str) -> bool:
    """Return whether a name or file is a scenario rather than a suite; a bundled suite goes before a scenario.

    Raises:
        ScenarioError: it is neither.
    """
    path = Path(source)
    if path.is_file():
        return _schema_of(path) != SCHEMA
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
    """Return a suite with other values of its fields, and the suites that it includes with the same."""
    return LoadedSuite(
        suite=loaded.suite.model_copy(update=values),
        path=loaded.path,
        directory=loaded.directory,
        shown_path=loaded.shown_path,
        included=tuple(with_changed_fields(inner, **values) for inner in loaded.included),
    )


def _schema_of(path: Path) -> str:
    try:
        text = read_regular_file(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: expected a file of UTF-8 text, was one that cannot be read.") from error
    return str((read_yaml(text, source=str(path)).block or {}).get("schema", ""))


def _suite_around(source: str, entry: EntrySpec, *, repetitions: int, seed: int | None) -> LoadedSuite:
    path = find_scenario(source).resolve()
    name = str(
        (read_yaml(read_regular_file(path).decode("utf-8-sig"), source=source).block or {}).get("name", path.stem)
    )
    suite = Suite(
        schema=SCHEMA,
        name=name,
        seed=1 if seed is None else seed,
        scenarios=(ScenarioSpec(source=source if source in bundled_scenarios() else str(path)),),
        repetitions=repetitions,
        entries=(entry,),
        anchors=(),
    )
    return LoadedSuite(suite=suite, path=path, directory=path.parent, shown_path=source)


def _entry_in(loaded: LoadedSuite, name: str) -> EntrySpec:
    for giver in _givers(loaded):
        for entry in giver.suite.entries_with_anchors:
            if entry.name == name:
                return entry if giver is loaded else _standing_alone(entry, giver.directory)
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


# Paths of an included suite's entry start at that suite's file.
def _standing_alone(entry: EntrySpec, directory: Path) -> EntrySpec:
    def whole(word: str) -> str:
        return str((directory / word).resolve()) if (directory / word).is_file() else word

    start = entry.start
    if start.python is not None:
        start = start.model_copy(update={"python": whole(start.python)})
    if start.command is not None:
        start = start.model_copy(update={"command": tuple(whole(word) for word in start.command)})
    return entry.model_copy(update={"start": start})


def _bundled_or_file(name: str) -> EntrySpec | None:
    if name in bundled_agents():
        return EntrySpec(name=name, start=StartSpec(python=name))
    path = Path(name)
    if path.suffix != ".py" or not path.is_file():
        return None
    stem = path.resolve().parent.name if path.stem == "agent" else path.stem
    return EntrySpec(name=_as_name(stem), start=StartSpec(python=str(path.resolve())))


def _as_name(text: str) -> str:
    word = "".join(c if c.isascii() and c.isalnum() else "_" for c in text.lower()).strip("_")
    return (word if word[:1].isalpha() else f"entry_{word}")[:40].rstrip("_")
