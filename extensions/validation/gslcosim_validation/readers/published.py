"""Published figures: `published.json`, a list of entries with author, year, place and values."""

from pathlib import Path
from typing import Any

from gslcosim_validation.readers.columns import build_error
from gslcosim_validation.readers.documents import read_document


def read_published(path: Path, entry_id: str) -> dict[str, Any]:
    """Return the values of one entry."""
    entries = read_document(path).get("entries")
    ids = [each.get("id") for each in entries if isinstance(each, dict)] if isinstance(entries, list) else []
    if entry_id not in ids:
        remedy = "Take the file that belongs to this version."
        raise build_error(path, "entries", expected=f"an entry {entry_id}", found=f"{len(ids)} others", remedy=remedy)
    values = entries[ids.index(entry_id)].get("values")
    if not isinstance(values, dict):
        raise build_error(path, entry_id, expected="values", found="none")
    return values
