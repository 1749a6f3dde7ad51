"""Commands for authors of agents and participants, and those with which a person searches or steps a run."""

from gslcosim.cli.arguments import CommandGroup
from gslcosim_conformance.commands import agent, fly, participant, schema, step

GROUPS = (
    CommandGroup(title="run", commands=(fly.COMMAND, step.COMMAND)),
    CommandGroup(title="extend", commands=(agent.COMMAND, participant.COMMAND, schema.COMMAND)),
)
