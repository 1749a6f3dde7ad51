"""Files and folders given by `--set`: they start at the working directory, as paths on a command line do."""

import re
from pathlib import Path
from typing import Any, cast

from gslcosim.scenario.problems import child_path
from gslcosim.scenario.programs import SCRIPT_ENDINGS

# Places in a scenario that hold files or folders; the first word of a command is a path only with a slash, and the
# second where it is a script.
_FILES = re.compile(
    r"environment\.(path|gsl_bench|gaden)|environment\.geometry\.files\[\d+\]|wind\.solver\.file|gas\.playback\.folder"
)
_PYTHON = re.compile(r"agents\[\d+\]\.start\.python")
_COMMAND = re.compile(r"agents\[\d+\]\.start\.command\[(\d+)\]")


def from_directory(path: str, value: Any, directory: Path) -> Any:
    """Return a value with all relative paths in it made absolute.

    Args:
        path: Where in the scenario the value goes.
        value: A plain value, or a block or list of them; not modified.
        directory: Where relative paths start.
    """
    if isinstance(value, dict):
        return {
            key: from_directory(child_path(path, key), inner, directory)
            for key, inner in cast("dict[str, Any]", value).items()
        }
    if isinstance(value, list):
        items = enumerate(cast("list[Any]", value))
        return [from_directory(child_path(path, i), inner, directory) for i, inner in items]
    if isinstance(value, str) and _is_path(path, value):
        return str(directory / Path(value).expanduser())
    return value


def _is_path(path: str, text: str) -> bool:
    if _FILES.fullmatch(path):
        return True
    if _PYTHON.fullmatch(path):
        return "/" in text or text.endswith(".py")
    if command := _COMMAND.fullmatch(path):
        word = int(command[1])
        return (word == 0 and "/" in text) or (word == 1 and text.endswith(SCRIPT_ENDINGS))
    return False
