"""Commands of the archive, actions of `gslcosim bench`: check, rank, sign, log, seal and publish results."""

from gslcosim.cli.arguments import CommandFamily, CommandGroup
from gslcosim_archive.commands import dataset, rankings, sealing, submission

GROUPS = (
    CommandGroup(
        title="compare methods",
        commands=(
            CommandFamily(
                name="bench",
                summary="",
                examples="",
                is_computing=True,
                parts=(*rankings.COMMANDS, *submission.COMMANDS, *sealing.COMMANDS, dataset.COMMAND),
            ),
        ),
    ),
)
