"""Keys that extensions add to scenarios: values of blocks, and starts of agents and participants.

An entry point in `gslcosim.starts` is a tuple of keys. Its module is imported with the models of scenarios, so it holds
the keys and their blocks alone, imports nothing of `gslcosim.scenario`, and leaves what is slow to its functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic, TypeVar, cast

from pydantic import BaseModel

from gslcosim.base.errors import UsageError
from gslcosim.base.extensions import STARTS_GROUP, find_remedy, list_registered, load_registered

Value = TypeVar("Value")
AGENT_START = "agents[].start"
PARTICIPANT = "participants[]"
PARTICIPANT_START = "participants[].start"
PARTICIPANT_READ = "participants[].reads[]"
# The blocks that extensions may add keys to; the first is the whole file.
PLACES = ("", AGENT_START, PARTICIPANT, PARTICIPANT_START, PARTICIPANT_READ)


def _accept(block: Any) -> None:
    del block


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
        file: The words for the file that its text names, `an FMU`; empty where it names none.
        is_live: Whether it shows a run while it goes on and never changes results. Replays, suites and trainings leave
            it out, and forks may change it.
    """

    place: str
    name: str
    annotation: Any
    description: str
    default: Any = None
    block: Any = None
    after: str = ""
    file: str = ""
    is_live: bool = False

    def get(self, block: BaseModel) -> Value:
        """Return the value in a block of its place."""
        return getattr(block, self.name)


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentStart(ScenarioKey[Value]):
    """A key of `agents[].start` that says how an agent is started, in place of `python` or `command`.

    Attributes:
        build_command: Returns the command line from the value and the agent's block.
        check_start: Raises a `broken_rule_error` where the block `start` has keys that do not go with it.
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
    """A key of `participants[].start` that says how a participant is started, in place of `command`.

    Attributes:
        build_words: Returns program and arguments from the value.
        build_core: Returns the core that stands for the participant, from its block, the setup of the run, and the
            types of the messages on each port.
        check_start: Raises a `broken_rule_error` where the block `start` has keys that do not go with it.
        check_participant: The same for the block of any participant, however it is started.
        unpacks_files: Whether its process leaves files in the folder for temporary files when it is killed.
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
    return tuple(key for key in _load_all() if key.place == place)


@cache
def _load_all() -> tuple[ScenarioKey[Any], ...]:
    return tuple(key for keys in load_registered(STARTS_GROUP, _as_keys, "a tuple of ScenarioKey") for key in keys)


def name_makers(key: ScenarioKey[Any]) -> str:
    """Return the packages that register a key of this place and name."""
    points = [(point, (other.place, other.name)) for point in list_registered(STARTS_GROUP) for other in point.load()]
    return " and ".join(point.distribution for point, found in points if found == (key.place, key.name))


def _as_keys(offered: object) -> tuple[ScenarioKey[Any], ...] | None:
    if not isinstance(offered, tuple):
        return None
    keys = cast("tuple[object, ...]", offered)
    found = tuple(key for key in keys if isinstance(key, ScenarioKey) and key.place in PLACES)
    return found if len(found) == len(keys) else None


def list_agent_starts() -> tuple[AgentStart[Any], ...]:
    """Return the starts of agents that installed extensions register."""
    return tuple(key for key in list_scenario_keys(AGENT_START) if isinstance(key, AgentStart))


def list_participant_starts() -> tuple[ParticipantStart[Any], ...]:
    """Return the starts of participants that installed extensions register."""
    return tuple(key for key in list_scenario_keys(PARTICIPANT_START) if isinstance(key, ParticipantStart))


def list_live_keys() -> tuple[ScenarioKey[Any], ...]:
    """Return the keys of the whole file that show a run while it goes on."""
    return tuple(key for key in list_scenario_keys("") if key.is_live)


def list_file_keys() -> tuple[str, ...]:
    """Return the names of all keys whose texts are files."""
    return tuple(key.name for key in _load_all() if key.file)


def get_scenario_key(place: str, name: str) -> ScenarioKey[Any]:
    """Return a key of an extension.

    Raises:
        UsageError: no installed extension adds it; the text names the extension that does.
    """
    for key in list_scenario_keys(place):
        if key.name == name:
            return key
    path = f"{place}.{name}".lstrip(".")
    raise UsageError(
        f"{path}: expected an extension that adds it, found none. {find_remedy('keys', path) or ''}".rstrip()
    )
