"""Commands for authors of agents and participants, and the one with which a person searches."""

from gslcosim.cli.arguments import CommandGroup
from gslcosim_conformance.commands import agent, fly, participant

GROUPS = (
    CommandGroup(title="run", commands=(fly.COMMAND,)),
    CommandGroup(title="extend", commands=(agent.COMMAND, participant.COMMAND)),
)
