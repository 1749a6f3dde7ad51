"""Folder of an export: where exporters of environments write, what they return, and names of files."""

import re
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import EnvironmentDataError


@dataclass(frozen=True, kw_only=True)
class ExportResult:
    """Result of an export: the files written, and sentences on what the format cannot hold."""

    files: tuple[Path, ...]
    notices: tuple[str, ...] = ()


def create_export_folder(folder: Path) -> None:
    """Make a folder for exported files where there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise EnvironmentDataError(
            f"The folder is not empty: {folder}. Choose a new or empty folder, so that files do not mix."
        )


def build_file_name(name: str) -> str:
    """Return the name of a room as files have it, without blanks and separators."""
    return re.sub(r"[^\w.-]+", "_", name)
