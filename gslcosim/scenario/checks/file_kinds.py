"""Kinds of files that a user writes, recognised by what a file says of itself, else by its name."""

import re
from collections.abc import Iterator
from pathlib import Path

from gslcosim.base.bundled import (
    FAMILY_FILE,
    SUITE_FILE,
    bundled_agents,
    bundled_families,
    bundled_scenarios,
    bundled_suites,
    bundled_train_files,
)
from gslcosim.base.files import read_regular_file
from gslcosim.methods.card import CARD_FILE
from gslcosim.scenario.checks.registry import FileKind

# `schema: gslcosim/suite/1`, also where the file has mistakes for which it cannot be read as YAML.
_SCHEMA = re.compile(rb"^\s*\{?\s*[\"']?schema[\"']?\s*:\s*[\"']?gslcosim/(\w+)/", re.MULTILINE)
_KIND_OF_SCHEMA: dict[str, FileKind] = {
    "scenario": "scenario",
    "suite": "suite",
    "method": "card",
    "family": "family",
    "train": "train",
}
_KIND_OF_NAME: dict[str, FileKind] = {SUITE_FILE: "suite", CARD_FILE: "card", FAMILY_FILE: "family"}
_TRAIN_ENDING = ".train.yaml"
_MAX_BYTES = 2_000_000


def find_file_kind(source: str) -> tuple[FileKind, str]:
    """Return what kind of file a path or the name of something bundled stands for, and where it is.

    What is neither recognised nor there is taken for a scenario, whose loader says what is wrong.
    A bundled scenario comes before a suite, family, train file or method of its name.

    Args:
        source: A file, the folder of a suite or method, or a bundled name.

    Returns:
        The kind, and the file; the source itself where its own loader finds it by name.
    """
    path = Path(source)
    if path.is_dir():
        name = next((name for name in _KIND_OF_NAME if (path / name).is_file()), None)
        return (_KIND_OF_NAME[name], str(path / name)) if name is not None else ("scenario", source)
    if path.is_file():
        return _kind_of_file(path), source
    if source in bundled_scenarios():
        return "scenario", source
    if len(path.parts) == 1:
        for kind, file in _bundled_files(source):
            if file.is_file():
                return kind, str(file)
    return "scenario", source


def _kind_of_file(path: Path) -> FileKind:
    try:
        said = _SCHEMA.search(read_regular_file(path, max_bytes=_MAX_BYTES))
    except OSError:
        said = None
    kind = _KIND_OF_SCHEMA.get(said[1].decode()) if said is not None else None
    return kind or _KIND_OF_NAME.get(path.name) or ("train" if path.name.endswith(_TRAIN_ENDING) else "scenario")


def _bundled_files(name: str) -> Iterator[tuple[FileKind, Path]]:
    listed: tuple[tuple[FileKind, dict[str, Path]], ...] = (
        ("suite", bundled_suites()),
        ("family", bundled_families()),
        ("train", bundled_train_files()),
        ("card", {name: program.with_name(CARD_FILE) for name, program in bundled_agents().items()}),
    )
    return ((kind, files[name]) for kind, files in listed if name in files)
