"""Suggestions for unknown words: the nearest known one, for "Did you mean …?"."""

import difflib
from collections.abc import Iterable

from gslcosim.scenario.units import UNIT_OF_ENDING, unit_suffix


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that somebody most likely meant, or nothing when none is near."""
    by_folded = {name.lower().replace("-", "_"): name for name in known}
    folded = word.lower().replace("-", "_").replace(" ", "_")
    if folded in by_folded:
        return by_folded[folded]
    matches = difflib.get_close_matches(folded, by_folded, n=1, cutoff=0.6)
    return by_folded[matches[0]] if matches else None


def nearest_key(word: str, known: Iterable[str]) -> str | None:
    """Return the key that somebody most likely meant: `hold` and `hold_ms` both mean `hold_s`."""
    keys = list(known)
    stem = word.removesuffix(unit_suffix(word)).lower()
    for key in keys:
        if unit_suffix(key) and key.removesuffix(unit_suffix(key)) == stem:
            return key
    for key in keys:
        if stem and any(key == f"{stem}{ending}" for ending in UNIT_OF_ENDING):
            return key
    return nearest(word, keys)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `Did you mean x?` for the nearest known word, or an empty text."""
    match = nearest(word, known)
    return f"Did you mean {match}?" if match else ""
