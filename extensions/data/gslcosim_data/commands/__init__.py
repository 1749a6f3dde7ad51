"""Commands that read runs back or fork them, and the command that makes a run of a robot's log."""

from gslcosim.cli.arguments import CommandFamily, CommandGroup
from gslcosim_data.commands import extract, film, fork, import_log, plot

GROUPS = (
    CommandGroup(title="run", commands=(fork.COMMAND,)),
    CommandGroup(
        title="look",
        commands=(
            plot.COMMAND,
            film.COMMAND,
            extract.COMMAND,
            CommandFamily(name="runs", summary="", examples="", parts=(import_log.COMMAND,)),
        ),
    ),
)
