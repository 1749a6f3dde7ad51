"""Loading of agents: the command line of a process, or the class of an object in this one."""

import importlib.util
import sys
from collections.abc import Container, Sequence
from pathlib import Path

from gslcosim.agent_kit import Agent
from gslcosim.agent_kit.card_agent import is_agent_class, load_card_agent
from gslcosim.base.bundled import CARD_FILE, bundled_agents
from gslcosim.base.errors import GslCosimError, UsageError
from gslcosim.base.processes import build_python_command
from gslcosim.scenario.models.scenario import AgentSpec, Scenario


def build_start_command(agent: AgentSpec, directory: Path) -> list[str] | None:
    """Return the command line of an agent, or None when it attaches itself."""
    if agent.start.python is not None:
        return build_program_command(find_python_agent(agent.start.python, directory))
    if (start := agent.start.registered) is not None:
        place, maker = f"agents[].start.{start.name}", start.build_command.__module__
        try:
            words = start.build_command(start.get(agent.start), agent)
        except GslCosimError:
            raise
        # A package of another project may raise anything.
        except Exception as error:
            raise UsageError(f"{place}: expected a command line from {maker}, was {error!r}. Correct it.") from error
        if not words:
            raise UsageError(f"{place}: expected a command line from {maker}, was {words!r}. Correct it.")
        return words
    if agent.start.command is not None:
        return resolve_command(agent.start.command, directory)
    return None


def build_program_command(program: Path) -> list[str]:
    """Return the command line of a Python agent: its file, or a card that names its class."""
    kit = ("-m", "gslcosim.agent_kit.card_agent") if program.name == CARD_FILE else ()
    return build_python_command(*kit, str(program))


def load_agent_types(scenario: Scenario, directory: Path, elsewhere: Container[str]) -> dict[str, type[Agent]]:
    """Return the classes of agents that are objects in this process, by process, so that its agents share here, too."""
    types: dict[str, type[Agent]] = {}
    for agent in scenario.agents:
        if agent.name in elsewhere or agent.process != agent.name:
            continue
        if agent.start.python is None:
            raise UsageError(
                f"agents.{agent.name}.start: expected a python agent, or one with door: stdio, tcp or unix, for a run "
                "in one process, was one with door: zenoh. Leave out --in-process."
            )
        types[agent.name] = load_python_agent(find_python_agent(agent.start.python, directory))
    return types


def find_python_agent(name: str, directory: Path) -> Path:
    """Return the program of a Python agent: a path relative to the scenario, or the name of a bundled agent."""
    beside = directory / name
    if beside.is_file():
        return beside.absolute()
    bundled = bundled_agents()
    if name in bundled:
        return bundled[name]
    raise UsageError(f"start.python: expected a .py file or one of {sorted(bundled)}, was {name!r}.\nFile: {beside}")


def load_python_agent(path: Path) -> type[Agent]:
    """Return the one `Agent` that a file defines, or the one that a card names."""
    if path.name == CARD_FILE:
        return load_card_agent(path)
    module_name = f"gslcosim_agent_{path.parent.name}_{path.stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    if spec is None or spec.loader is None:
        raise UsageError(f"expected a Python file.\nFile: {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise UsageError(f"expected an agent that can be imported, got {error!r}.\nFile: {path}") from error
    found = [item for item in vars(module).values() if is_agent_class(item) and item.__module__ == module_name]
    if len(found) != 1:
        names = [item.__name__ for item in found]
        raise UsageError(f"expected one subclass of gslcosim.agent_kit.Agent, found {names}.\nFile: {path}")
    return found[0]


def resolve_command(command: Sequence[str], directory: Path) -> list[str]:
    """Return a command line whose program, where it has a slash, is looked for in a scenario's folder."""
    program, *arguments = command
    beside = directory / program
    return [str(beside.absolute()) if "/" in program and beside.exists() else program, *arguments]
