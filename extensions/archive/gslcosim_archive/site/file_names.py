"""File names of a site's pages, of names that anybody may have chosen."""

import re
from collections.abc import Iterable, Mapping

_MAX_LETTERS = 60


def assign_file_names(names: Iterable[str]) -> Mapping[str, str]:
    """Return a file name without ending for each name: small letters of ASCII, digits, - and _, and no name twice.

    Nothing of a name can lead to another folder or mean something to a browser, and names that differ in capital
    letters alone get files that differ on every disk.
    """
    found: dict[str, str] = {}
    taken = set[str]()
    for name in dict.fromkeys(names):
        stem = re.sub(r"[^a-z0-9_]+", "-", name.lower()).strip("-")[:_MAX_LETTERS] or "unnamed"
        number, file = 1, stem
        while file in taken:
            number += 1
            file = f"{stem}-{number}"
        taken.add(file)
        found[name] = file
    return found
