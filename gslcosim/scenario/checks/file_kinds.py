"""Kinds of files that a user writes, recognised by the schema in the file, else by its name."""

import re
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.base.extensions import find_remedy
from gslcosim.base.files import read_regular_file
from gslcosim.scenario.checks.registry import FileKind, find_kind, list_file_kinds

# `schema: gslcosim/suite/1`, also where the file has mistakes for which it cannot be read as YAML.
_SCHEMA = re.compile(rb"^\s*\{?\s*[\"']?schema[\"']?\s*:\s*[\"']?gslcosim/(\w+)/", re.MULTILINE)
_MAX_BYTES = 2_000_000


def find_file_kind(source: str) -> tuple[FileKind, str]:
    """Return the kind and the location of a file given by its path or by the name of a bundled one.

    A file that is neither recognised nor found counts as a scenario, whose loader reports the problem. A bundled
    scenario precedes another bundled file of its name.

    Args:
        source: A file, a folder with a file of a kind's usual name, or a bundled name.

    Returns:
        The kind, and the file; the source itself if its own loader finds it by name.
    """
    scenario, *others = list_file_kinds()
    path = Path(source)
    if path.is_dir():
        inside = ((kind, path / kind.ending) for kind in others if not kind.ending.startswith("."))
        return next(((kind, str(file)) for kind, file in inside if file.is_file()), (scenario, source))
    if path.is_file():
        return _find_kind_of(path, (scenario, *others)), source
    if source in scenario.list_bundled():
        return scenario, source
    if len(path.parts) == 1:
        bundled = ((kind, kind.list_bundled().get(source)) for kind in others)
        if found := next(((kind, str(file)) for kind, file in bundled if file is not None and file.is_file()), None):
            return found
    return scenario, source


def _find_kind_of(path: Path, kinds: tuple[FileKind, ...]) -> FileKind:
    try:
        said = _SCHEMA.search(read_regular_file(path, max_bytes=_MAX_BYTES))
    except OSError:
        said = None
    word = said[1].decode() if said is not None else ""
    if kind := find_kind(word):
        return kind
    if remedy := find_remedy("files", word):
        raise UsageError(f"{path}: expected a kind of file that is installed, was gslcosim/{word}. {remedy}")
    scenario, *others = kinds
    for kind in others:
        if path.name == kind.ending or (kind.ending.startswith(".") and path.name.endswith(kind.ending)):
            return kind
    return scenario
