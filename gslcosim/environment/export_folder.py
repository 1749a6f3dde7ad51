"""Folder of an export: target of the exporters of environments, their result, and names of files."""

import re
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import EnvironmentDataError


@dataclass(frozen=True, kw_only=True)
class ExportResult:
    """Result of an export: the files written, and sentences about content that the format cannot hold."""

    files: tuple[Path, ...]
    notices: tuple[str, ...] = ()


def create_export_folder(folder: Path) -> None:
    """Create the folder for exported files; refuse one that holds files."""
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise EnvironmentDataError(
            f"The folder is not empty: {folder}. Choose a new or empty folder, so that files do not mix."
        )


def build_file_name(name: str) -> str:
    """Return the name of a room in file names, without blanks and separators."""
    return re.sub(r"[^\w.-]+", "_", name)
