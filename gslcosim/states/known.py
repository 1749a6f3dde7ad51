"""What there was when an object had been built: each thing by the way that leads to it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gslcosim.states.state_values import attributes_of, fingerprint, foreign_kind, is_plain, is_walked, parts_of

# From so many bytes on an array that has not changed is left out.
LARGE_BYTES = 1 << 14


@dataclass(frozen=True, kw_only=True)
class Found:
    """A thing that was there: the way to it, and what it held."""

    path: str
    value: Any
    attributes: dict[str, Any] | None = None
    fingerprint: bytes | None = None


class Known:
    """All that an object held when it had been built, by path such as `._crafts[0]._guide` and by identity."""

    def __init__(self, root: object, *, fixed: tuple[type, ...], packages: frozenset[str]) -> None:
        self._fixed = fixed
        self._by_path: dict[str, Found] = {}
        self._by_id: dict[int, Found] = {}
        waiting: list[tuple[str, Any]] = [("", root)]
        while waiting:
            path, value = waiting.pop()
            if is_plain(value) or id(value) in self._by_id:
                continue
            is_fixed = isinstance(value, fixed)
            self._add(path, value, packages, is_fixed=is_fixed)
            if not is_fixed:
                waiting += [(path + label, part) for label, part in parts_of(value, packages)]

    def of(self, value: object) -> Found | None:
        """Return what is known of a thing, if it was there."""
        return self._by_id.get(id(value))

    def at(self, path: str) -> Found | None:
        """Return what was at a place."""
        return self._by_path.get(path)

    def is_fixed(self, value: object) -> bool:
        """Whether a thing is of a type that never changes."""
        return isinstance(value, self._fixed)

    def found(self) -> list[Found]:
        """Return all that was there."""
        return list(self._by_path.values())

    def _add(self, path: str, value: Any, packages: frozenset[str], *, is_fixed: bool) -> None:
        attributes = mark = None
        if isinstance(value, np.ndarray):
            if value.nbytes >= LARGE_BYTES and value.flags.writeable:
                mark = fingerprint(value)
        elif not is_fixed and foreign_kind(value) is None and is_walked(value, packages):
            attributes = attributes_of(value)
        self._by_id[id(value)] = self._by_path[path] = Found(
            path=path, value=value, attributes=attributes, fingerprint=mark
        )
