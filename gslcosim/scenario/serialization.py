"""Serialization of a resolved scenario back to YAML."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, cast

import yaml
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from gslcosim.scenario.models.one_of import KindedSpec
from gslcosim.scenario.models.scenario import AgentSpec, Scenario
from gslcosim.scenario.yaml_tree import CoreLoader


class _Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.1 or 1.2 would take for something else, and keeps short lists on one line."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write values that occur twice in full."""
        return True


for _first, _resolvers in CoreLoader.yaml_implicit_resolvers.items():
    for _tag, _pattern in _resolvers:
        cast("Any", _Dumper).add_implicit_resolver(_tag, _pattern, [_first])


def _represent_list(dumper: Any, items: list[Any]) -> yaml.Node:
    is_flat = not any(isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=is_flat)


cast("Any", _Dumper).add_representer(list, _represent_list)


def dump_resolved(scenario: Scenario, *, directory: Path | None = None) -> str:
    """Return the YAML of a scenario with all defaults and overrides filled in; it loads back equal.

    Args:
        scenario: A valid scenario.
        directory: The scenario's folder. When given, relative paths are written absolute, so that the text may be
            saved in another folder.
    """
    if directory is not None:
        scenario = _with_absolute_paths(scenario, directory)
    return dump_values(plain_values(scenario))


def dump_values(values: Any) -> str:
    """Return plain values as YAML, quoted so that they load back equal."""
    return cast("Any", yaml).dump(values, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def plain_values(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as a file would hold it, with all defaults filled in: dicts, lists and scalars."""
    return _plain(scenario)


# None is left out where it is the default anyway, and so is what means nothing with a block's kind.
def _plain(value: Any, useless: Iterable[str] = ()) -> Any:
    if isinstance(value, BaseModel):
        left_out = {*useless, *(value.useless_keys() if isinstance(value, KindedSpec) else ())}
        return {
            field.alias or name: _plain(getattr(value, name), _inside(name, left_out))
            for name, field in type(value).model_fields.items()
            if name not in left_out
            and (getattr(value, name) is not None or field.default not in (None, PydanticUndefined))
        }
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in cast("dict[str, Any]", value).items()}
    return [_plain(item) for item in cast("tuple[Any, ...]", value)] if isinstance(value, tuple) else value


# Of paths such as `plume.meander_s` those inside `plume`, without it.
def _inside(name: str, paths: Iterable[str]) -> list[str]:
    return [path.removeprefix(f"{name}.") for path in paths if path.startswith(f"{name}.")]


def _with_absolute_paths(scenario: Scenario, directory: Path) -> Scenario:
    environment, wind = scenario.environment, scenario.wind
    if (key := environment.folder_key) is not None:
        environment = environment.model_copy(update={key: _absolute(getattr(environment, key), directory)})
    if (geometry := environment.geometry) is not None:
        files = tuple(_absolute(file, directory) for file in geometry.files)
        environment = environment.model_copy(update={"geometry": geometry.model_copy(update={"files": files})})
    if wind.file is not None:
        wind = wind.model_copy(update={"solver": {"file": _absolute(wind.file, directory)}})
    agents = tuple(_with_absolute_program(agent, directory) for agent in scenario.agents)
    return scenario.model_copy(update={"environment": environment, "wind": wind, "agents": agents})


def _absolute(path: str, directory: Path) -> str:
    return str((directory / Path(path).expanduser()).resolve())


def with_absolute_gas(scenario: Scenario, directory: Path) -> Scenario:
    """Return a scenario whose stored gas, if it plays any, is named absolutely: services know no folder to start from.

    Args:
        scenario: A valid scenario.
        directory: Where its relative paths start.
    """
    playback = scenario.gas.stored
    if playback is None:
        return scenario
    folder = _absolute(playback.folder, directory)
    gas = scenario.gas.model_copy(update={"playback": playback.model_copy(update={"folder": folder})})
    return scenario.model_copy(update={"gas": gas})


def _with_absolute_program(agent: AgentSpec, directory: Path) -> AgentSpec:
    start = agent.start
    if start.python is not None and (directory / start.python).is_file():
        start = start.model_copy(update={"python": str((directory / start.python).resolve())})
    if start.command is not None and "/" in start.command[0]:
        program = str((directory / start.command[0]).resolve())
        start = start.model_copy(update={"command": (program, *start.command[1:])})
    folders = {
        key: tuple(_absolute(path, directory) for path in getattr(agent, key)) for key in ("may_read", "may_write")
    }
    return agent.model_copy(update={"start": start, **folders})
