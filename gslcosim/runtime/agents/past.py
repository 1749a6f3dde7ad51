"""What is known of a run before it begins: the commands of the run that it is a fork of."""

from collections.abc import Mapping
from dataclasses import dataclass

from gslcosim.contract.messages import Command


@dataclass(frozen=True, kw_only=True)
class Past:
    """The commands that count at ticks before `until_tick`, by agent and tick, whatever the agents answer there."""

    commands: Mapping[str, Mapping[int, Command]]
    until_tick: int
