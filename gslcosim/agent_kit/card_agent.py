"""Agents that are a class that their method card names: `python -m gslcosim.agent_kit.card_agent CARD` runs one."""

import inspect
import sys
from importlib import import_module
from pathlib import Path

from gslcosim.agent_kit.agent import Agent, run
from gslcosim.base.errors import GslCosimError, UsageError
from gslcosim.methods.card import load_card


def is_agent_class(item: object) -> bool:
    """Return whether something is a class of agents of which one can be made."""
    return inspect.isclass(item) and issubclass(item, Agent) and not inspect.isabstract(item)


def load_card_agent(path: Path) -> type[Agent]:
    """Return the agent class that a card's `program` names, with the card's path as its attribute `program`.

    Raises:
        MethodError: the card cannot be read, or is wrong.
        UsageError: the card names no program, or one that is no class of an agent.
    """
    program = load_card(path).program
    if program is None:
        raise UsageError(f"program: expected module:Class in a card that is started, was missing.\nFile: {path}")
    module, _, name = program.partition(":")
    try:
        found = getattr(import_module(module), name)
    except Exception as error:
        raise UsageError(
            f"program: expected an agent that can be imported, got {error!r}. Install its package, or write the class "
            f"in agent.py beside the card, without program.\nFile: {path}"
        ) from error
    if not is_agent_class(found):
        raise UsageError(f"program: expected a class of gslcosim.agent_kit.Agent, was {program}.\nFile: {path}")
    return type(found.__name__, (found,), {"__doc__": found.__doc__, "program": str(path)})


if __name__ == "__main__":
    try:
        agent_type = load_card_agent(Path(sys.argv[1]))
    except GslCosimError as error:
        sys.exit(str(error))
    run(agent_type)
