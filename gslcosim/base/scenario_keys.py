"""Keys that extensions add to scenarios: values of blocks, and starts of agents and participants.

An entry point in `gslcosim.starts` is a tuple of keys. Its module is imported with the models of scenarios, so it
contains the keys and their blocks alone, imports nothing of `gslcosim.scenario`, and leaves slow imports to its
functions.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, Literal, TypeVar, cast

from pydantic import BaseModel

from gslcosim.base.extensions import STARTS_GROUP, list_registered, load_registered

Value = TypeVar("Value")
ENVIRONMENT = "environment"
AGENT_START = "agents[].start"
PARTICIPANT = "participants[]"
PARTICIPANT_START = "participants[].start"
PARTICIPANT_READ = "participants[].reads[]"
# Blocks to which extensions may add keys; the first is the whole file.
PLACES = ("", ENVIRONMENT, AGENT_START, PARTICIPANT, PARTICIPANT_START, PARTICIPANT_READ)


def _accept(block: Any) -> None:
    del block


@dataclass(frozen=True, kw_only=True)
class InputPath:
    """A place in scenarios whose texts name input files or folders, relative to the scenario's folder.

    Attributes:
        place: The place, such as `environment.geometry.files[]`.
        expected: Words for the file or folder, `a file of geometry`.
        kind: Kind of file or folder; for a `series` of files with a common beginning, their folder has to exist.
    """

    place: str
    expected: str
    kind: Literal["file", "folder", "file or folder", "series"]


_OWN_INPUTS = (InputPath(place=f"{ENVIRONMENT}.path", expected="the folder of an environment", kind="folder"),)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioKey(Generic[Value]):
    """A key that an extension adds to a block of scenarios.

    Attributes:
        place: The block, one of `PLACES`.
        name: The key.
        annotation: The type of its value, as of a field of a pydantic model.
        description: Its meaning.
        default: Its value where it is absent.
        block: The model of its value, where that is a block.
        after: The key that it follows in lists of keys; empty: it is the last.
        file: Words for the file that its text names, `an FMU`; empty if it names none.
        inputs: Files and folders of the run that it names, in `environment`, `wind` or `gas`.
        is_live: Whether it shows a run in progress and never changes results. Replays, suites and trainings omit it,
            and forks may change it.
    """

    place: str
    name: str
    annotation: Any
    description: str
    default: Any = None
    block: Any = None
    after: str = ""
    file: str = ""
    inputs: tuple[InputPath, ...] = ()
    is_live: bool = False

    def get(self, block: BaseModel) -> Value:
        """Return the value in a block of its place."""
        return getattr(block, self.name)


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentStart(ScenarioKey[Value]):
    """A key of `agents[].start` that determines how an agent is started, in place of `python` or `command`.

    Attributes:
        build_command: Returns the command line from the value and the agent's block.
        check_start: Raises a `broken_rule_error` for incompatible keys in the block `start`.
        check_agent: The same for the agent's whole block.
        is_confinable: Whether its process can be started in a sandbox.
    """

    place: str = AGENT_START
    build_command: Callable[[Any, Any], list[str]]
    check_start: Callable[[Any], None] = _accept
    check_agent: Callable[[Any], None] = _accept
    is_confinable: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class ParticipantStart(ScenarioKey[Value]):
    """A key of `participants[].start` that determines how a participant is started, in place of `command`.

    Attributes:
        build_words: Returns program and arguments from the value.
        build_core: Returns the core in place of the participant, from its block, the setup of the run, and the types of
            the messages on each port.
        check_start: Raises a `broken_rule_error` for incompatible keys in the block `start`.
        check_participant: The same for the block of any participant, whatever its start.
        unpacks_files: Whether its process leaves temporary files behind when it is killed.
    """

    place: str = PARTICIPANT_START
    build_words: Callable[[Any], tuple[str, ...]]
    build_core: Callable[[Any, Any, Any], Any]
    check_start: Callable[[Any], None] = _accept
    check_participant: Callable[[Any], None] = _accept
    unpacks_files: bool = False


@cache
def list_scenario_keys(place: str) -> tuple[ScenarioKey[Any], ...]:
    """Return the keys that installed extensions add to a block.

    Raises:
        UsageError: an extension registers something else, or cannot be imported.
    """
    return tuple(key for key in _load_all() if isinstance(key, ScenarioKey) and key.place == place)


@cache
def _load_all() -> tuple[ScenarioKey[Any] | InputPath, ...]:
    what = "a tuple of ScenarioKey and InputPath"
    return tuple(key for keys in load_registered(STARTS_GROUP, _as_keys, what) for key in keys)


def find_registering_packages(key: ScenarioKey[Any]) -> str:
    """Return the packages that register a key of this place and name."""
    offers = [(point, other) for point in list_registered(STARTS_GROUP) for other in point.load()]
    packages = [
        p.distribution for p, o in offers if isinstance(o, ScenarioKey) and (o.place, o.name) == (key.place, key.name)
    ]
    return " and ".join(packages)


def _as_keys(offered: object) -> tuple[ScenarioKey[Any] | InputPath, ...] | None:
    if not isinstance(offered, tuple):
        return None
    keys = cast("tuple[object, ...]", offered)
    found = tuple(
        key for key in keys if isinstance(key, InputPath) or (isinstance(key, ScenarioKey) and key.place in PLACES)
    )
    return found if len(found) == len(keys) else None


@cache
def list_inputs() -> tuple[InputPath, ...]:
    """Return all places of scenarios that name files and folders of rooms, winds and gas."""
    registered = (each.inputs if isinstance(each, ScenarioKey) else (each,) for each in _load_all())
    return (*_OWN_INPUTS, *(path for paths in registered for path in paths))


def find_inputs(values: dict[str, Any]) -> Iterator[tuple[InputPath, str, str]]:
    """Yield the inputs in a scenario's plain values, each with its place, such as `environment.geometry.files[0]`."""
    for path in list_inputs():
        yield from ((path, place, text) for place, text in _find_texts(values, path.place.split("."), ""))


def replace_inputs(values: dict[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """Return a scenario's plain values, or some blocks of them, with all inputs that `find_inputs` yields changed."""
    places = {path.place for path in list_inputs()}
    blocks = {place.partition(".")[0] for place in places}

    def visit(value: Any, place: str) -> Any:
        if isinstance(value, dict):
            return {key: visit(inner, f"{place}.{key}") for key, inner in cast("dict[str, Any]", value).items()}
        if isinstance(value, list):
            return [visit(item, f"{place}[]") for item in cast("list[Any]", value)]
        return change(value) if isinstance(value, str) and place in places else value

    return {key: visit(value, key) if key in blocks else value for key, value in values.items()}


def _find_texts(value: Any, keys: list[str], place: str) -> Iterator[tuple[str, str]]:
    if not keys:
        if isinstance(value, str):
            yield place, value
        return
    name = keys[0].removesuffix("[]")
    inner = cast("dict[str, Any]", value).get(name) if isinstance(value, dict) else None
    place = f"{place}.{name}".lstrip(".")
    if not keys[0].endswith("[]"):
        yield from _find_texts(inner, keys[1:], place)
    elif isinstance(inner, list):
        for i, item in enumerate(cast("list[Any]", inner)):
            yield from _find_texts(item, keys[1:], f"{place}[{i}]")


def list_agent_starts() -> tuple[AgentStart[Any], ...]:
    """Return the starts of agents that installed extensions register."""
    return tuple(key for key in list_scenario_keys(AGENT_START) if isinstance(key, AgentStart))


def list_participant_starts() -> tuple[ParticipantStart[Any], ...]:
    """Return the starts of participants that installed extensions register."""
    return tuple(key for key in list_scenario_keys(PARTICIPANT_START) if isinstance(key, ParticipantStart))


def list_live_keys() -> tuple[ScenarioKey[Any], ...]:
    """Return the keys of the whole file that show a run in progress."""
    return tuple(key for key in list_scenario_keys("") if key.is_live)


@cache
def list_file_keys() -> frozenset[str]:
    """Return the names of all keys whose texts, alone or in a list, name files or folders."""
    names = {path.place.rpartition(".")[2].removesuffix("[]") for path in list_inputs()}
    return frozenset(names | {key.name for key in _load_all() if isinstance(key, ScenarioKey) and key.file})
