"""What is known of a run before it begins: the commands of the run that it is a fork of."""

from collections.abc import Mapping
from dataclasses import dataclass

from gslcosim.contract.messages import Command
from gslcosim.errors import RunFolderError


@dataclass(frozen=True, kw_only=True)
class Past:
    """The commands that count at ticks before `until_tick`, by agent and tick, whatever the agents answer there."""

    commands: Mapping[str, Mapping[int, Command]]
    until_tick: int


def past_command(commands: Mapping[int, Command], agent: str, tick: int) -> Command:
    """Return what an agent's command of the past was at a tick.

    Raises:
        RunFolderError: there was none.
    """
    if tick not in commands:
        raise RunFolderError(
            f"inputs.log: expected a command of {agent} for tick {tick}, at which it was asked again, found none. "
            "The run does not repeat: it was flown by other code, or its files were changed."
        )
    return commands[tick]
