"""Plain values of a scenario, read with care: a wrong kind is for the models to report."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, cast

from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.scenario.models.base import Spec
from gslcosim.scenario.problems import Problem, child_path
from gslcosim.scenario.suggestions import did_you_mean

NS_PER_MS = 1_000_000
MAX_NUMBER = 1e15
"""The largest number of any use, in whatever unit."""

MAX_DURATION_S = 1e9
"""Longer than any run; ticks of it still fit into 64 bits of nanoseconds."""


def find_numbers_too_large(values: object, path: str = "") -> Iterator[Problem]:
    """Yield the problem of each number beyond `MAX_NUMBER`: checks and services may multiply what they are given.

    Args:
        values: The scenario, or a part of it.
        path: The place of the part.
    """
    if isinstance(values, dict):
        for key, value in cast("dict[str, object]", values).items():
            # What an agent's parameters mean is the agent's.
            if key != "parameters":
                yield from find_numbers_too_large(value, child_path(path, key))
    elif isinstance(values, list):
        for i, value in enumerate(cast("list[object]", values)):
            yield from find_numbers_too_large(value, child_path(path, i))
    elif isinstance(values, int | float) and MAX_NUMBER < abs(values) < math.inf:
        yield Problem(path=path, expected=f"a number of at most {MAX_NUMBER:g}", found=_shown_number(values))


def _shown_number(number: float) -> str:
    """Return a number in a few characters."""
    return f"{number:g}" if isinstance(number, float) else f"a whole number of {len(str(abs(number)))} digits"


def find_partial_ticks(path: str, duration_s: float | None, tick_ns: int) -> Iterator[Problem]:
    """Yield a problem where a duration [s], if it is one, is no whole number of ticks."""
    if duration_s is None or not duration_s > 0:
        return
    if duration_s > MAX_DURATION_S:
        yield Problem(path=path, expected=f"at most {MAX_DURATION_S:g} s", found=f"{duration_s:g} s")
        return
    if is_whole(duration_s, tick_ns):
        return
    below = int(duration_s * NS_PER_S // tick_ns)
    nearest = [f"{seconds_from_ticks(n, tick_ns):g}" for n in (below, below + 1) if n >= 1]
    yield Problem(
        path=path,
        expected=f"a whole number of {tick_ns / NS_PER_MS:g} ms ticks",
        found=f"{duration_s:g} s",
        remedy=f"Nearest: {' or '.join(nearest)}.",
    )


def is_whole(duration_s: float, part_ns: int) -> bool:
    """Return whether a duration is a whole number of parts, at least one, to half a nanosecond."""
    n = round(duration_s * NS_PER_S / part_ns)
    return n >= 1 and abs(n * part_ns - duration_s * NS_PER_S) <= 0.5


def block_in(values: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Return the block at a path of keys, an empty one where none is."""
    for key in keys:
        inner = values.get(key)
        values = cast("dict[str, Any]", inner) if isinstance(inner, dict) else {}
    return values


def blocks_in(values: dict[str, Any], key: str) -> list[tuple[int, dict[str, Any]]]:
    """Return the blocks of a list with their places in it; what is no block is left out."""
    items = values.get(key)
    if not isinstance(items, list):
        return []
    return [(i, item) for i, item in enumerate(cast("list[Any]", items)) if isinstance(item, dict)]


def words_in(value: Any) -> tuple[str, ...]:
    """Return the texts of a list, nothing where it is no list of texts."""
    if not isinstance(value, list):
        return ()
    words = cast("list[Any]", value)
    return tuple(words) if all(isinstance(word, str) for word in words) else ()


def number_in(block: dict[str, Any], key: str, model: type[Spec]) -> float | None:
    """Return the number of a key, its default where it is absent, nothing where it is no number."""
    value = block[key] if key in block else model.model_fields[key].default
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def build_unknown_name_problem(path: str, name: str, known: Sequence[str]) -> Problem:
    """Return the problem of a name that is none of the known ones."""
    return Problem(
        path=path,
        expected=f"one of {', '.join(known[:-1])} or {known[-1]}",
        found=f"'{name}'",
        remedy=did_you_mean(name, known),
    )
