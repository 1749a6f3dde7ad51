"""Which programs a run's participants were: the files of their command lines, by content."""

import hashlib
import shutil
from collections.abc import Iterable
from pathlib import Path

from gslcosim.runtime.agents.starting import resolved_command
from gslcosim.scenario.models.own_models import OwnModelSpec


def program_hashes(participants: Iterable[OwnModelSpec], directory: Path) -> dict[str, dict[str, str]]:
    """Return for each participant the words of its command that are files, with the SHA-256 of what is in them.

    Args:
        participants: Those of a scenario.
        directory: Where their relative paths start.
    """
    return {
        each.name: {
            word: hashlib.sha256(path.read_bytes()).hexdigest()
            for i, word in enumerate(each.start.command)
            if (path := _file_of(each.start.command, i, directory)) is not None
        }
        for each in participants
    }


# The program itself may be one of the system's; its arguments are looked for where it is started.
def _file_of(command: tuple[str, ...], i: int, directory: Path) -> Path | None:
    word = resolved_command(command, directory)[i]
    found = shutil.which(word) if i == 0 else None
    path = Path(found) if found is not None else directory / Path(word).expanduser()
    try:
        return path if path.is_file() else None
    except OSError:
        return None
