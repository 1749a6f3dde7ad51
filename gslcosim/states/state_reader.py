"""Reads the state of an object as a list of nodes; see `StateKeeper`.

A reference to a value is the value itself where it is plain, or a list with a letter in front: `n` a node by its index,
`k` a thing that is known by its path, `t` a tuple of plain values, `i` a large integer, `s` a numpy scalar, `e` a
member of an enumeration, `f` a type or function by name, `m` a method of something.
"""

from array import array
from collections import OrderedDict, deque
from collections.abc import Sequence
from enum import Enum
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, cast

import numpy as np
from msgspec import Struct

from gslcosim.errors import SnapshotError
from gslcosim.states.known import Found, Known
from gslcosim.states.state_values import (
    PLAIN_TYPES,
    attributes_of,
    fingerprint,
    foreign_kind,
    is_known_to_be_fixed,
    is_plain,
    is_walked,
    name_of,
)

_LARGEST_INT = 1 << 63
Node = dict[str, Any]


class StateReader:
    """Reads one state; see `StateKeeper`."""

    def __init__(self, known: Known, packages: frozenset[str]) -> None:
        self._known = known
        self._packages = packages
        self._nodes: list[Node] = []
        self._index: dict[int, int] = {}
        # So that no identity is given away twice.
        self._alive: list[Any] = []
        self._way: list[str] = []

    def read(self, root: object) -> dict[str, Any]:
        """Return the state of an object."""
        self._reference(root, "")
        return {"nodes": self._nodes}

    def _reference(self, value: Any, label: str) -> Any:
        if type(value) in PLAIN_TYPES:
            return ["i", hex(value)] if type(value) is int and not -_LARGEST_INT <= value < _LARGEST_INT else value
        if is_plain(value):
            return ["t", [self._reference(inner, "") for inner in value]]
        if isinstance(value, Enum):
            return ["e", name_of(type(value)), value.name]
        if isinstance(value, np.generic) and not isinstance(value, np.void):
            return ["s", value.dtype.str, value.tobytes()]
        if id(value) in self._index:
            return ["n", self._index[id(value)]]
        self._way.append(label)
        try:
            return self._reference_to_thing(value)
        finally:
            self._way.pop()

    def _reference_to_thing(self, value: Any) -> Any:
        found = self._known.of(value)
        if found is not None and self._is_unchanging(value):
            return ["k", found.path]
        if isinstance(value, MethodType):
            return ["m", self._reference(value.__self__, ".__self__"), value.__func__.__name__]
        if isinstance(value, (type, FunctionType, BuiltinFunctionType)) and _can_be_named(value):
            return ["f", name_of(value)]
        if isinstance(value, FunctionType) and (path := self._known_function(value)) is not None:
            return ["k", path]
        if hasattr(value, "__next__"):
            raise self._cannot_keep(value)
        index = self._index[id(value)] = len(self._nodes)
        self._alive.append(value)
        node: Node = {} if found is None else {"p": found.path}
        self._nodes.append(node)
        self._fill(node, value, found)
        return ["n", index]

    # One that was made anew in the same place, of settings alone, does the same.
    def _known_function(self, value: FunctionType) -> str | None:
        found = self._known.at("".join(self._way))
        if found is None or getattr(found.value, "__code__", None) is not value.__code__:
            return None
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        are_settings = all(is_plain(held) or self._known.is_fixed(held) or _is_frozen(held) for held in cells)
        return found.path if are_settings else None

    def _is_unchanging(self, value: Any) -> bool:
        if isinstance(value, np.ndarray):
            return not value.flags.writeable
        if self._known.is_fixed(value):
            return True
        if foreign_kind(value) is not None or is_walked(value, self._packages):
            return False
        return is_known_to_be_fixed(value)

    def _fill(self, node: Node, value: Any, found: Found | None) -> None:
        foreign = foreign_kind(value)
        if foreign is not None and found is not None:
            node |= {"k": "x", "v": self._reference(foreign.read(value), "")}
        elif isinstance(value, np.ndarray):
            self._fill_array(node, cast("np.ndarray[Any, Any]", value), found)
        elif isinstance(value, np.random.Generator):
            generator: Any = value.bit_generator
            node |= {"k": "r", "v": self._reference(generator.state, "")}
        elif isinstance(value, array):
            numbers = cast("array[Any]", value)
            node |= {"k": "y", "c": numbers.typecode, "v": numbers.tobytes()}
        elif isinstance(value, BaseException):
            node |= {"k": "b", "t": name_of(type(value)), "v": self._items(value.args)}
        elif isinstance(value, Struct):
            fields = {name: self._reference(getattr(value, name), f".{name}") for name in value.__struct_fields__}
            # It is frozen: one that was there holds what it held.
            node |= {"k": "c", "t": name_of(type(value)), "a": fields if found is None else None}
        elif isinstance(value, partial):
            if found is None:
                raise self._cannot_keep(value)
            bound = cast("partial[Any]", value)
            self._items([bound.args, bound.keywords])
            node |= {"k": "p"}
        elif is_walked(value, self._packages):
            self._fill_object(node, value, found)
        else:
            self._fill_container(node, value, found)

    def _fill_container(self, node: Node, value: Any, found: Found | None) -> None:
        type_: type = type(value)
        if isinstance(value, tuple):
            fields = cast("Any", value)
            # One that was there holds what it held; only what is in it can have changed.
            items = self._items(fields)
            node |= {"k": "t", "t": None if type_ is tuple else name_of(type_), "v": items if found is None else None}
        elif type_ in (list, set, frozenset):
            node |= {"k": type_.__name__, "v": self._items(list(value))}
        elif type_ is deque:
            queue = cast("deque[Any]", value)
            node |= {"k": "deque", "v": self._items(queue), "n": queue.maxlen}
        elif isinstance(value, dict) and (found is not None or type_ in (dict, OrderedDict)):
            pairs = cast("dict[Any, Any]", value)
            items = [[self._reference(key, "{}"), self._reference(pairs[key], f"[{key!r}]")] for key in pairs]
            node |= {"k": "dict" if type_ is dict else "odict", "v": items}
        else:
            raise self._cannot_keep(value)

    def _fill_object(self, node: Node, value: Any, found: Found | None) -> None:
        before = found.attributes if found is not None else None
        attributes = attributes_of(value)
        node |= {"k": "o", "t": name_of(type(value)), "a": {}}
        for name, inner in attributes.items():
            reference = self._reference(inner, f".{name}")
            if before is None or name not in before or not _is_same(inner, before[name]):
                node["a"][name] = reference
        if before is not None and (gone := [name for name in before if name not in attributes]):
            node["g"] = gone

    # Views are told as such: what they share goes on being shared, and kernels are compiled for how they lie.
    def _fill_array(self, node: Node, value: "np.ndarray[Any, Any]", found: Found | None) -> None:
        if value.dtype.hasobject:
            raise self._cannot_keep(value)
        if found is not None and found.fingerprint is not None and found.fingerprint == fingerprint(value):
            node |= {"k": "u", "v": found.fingerprint}
            return
        node |= {"d": np.lib.format.dtype_to_descr(value.dtype), "s": list(value.shape)}
        if not value.flags.writeable:
            node["r"] = True
        base = value.base
        if found is None and isinstance(base, np.ndarray):
            offset = value.__array_interface__["data"][0] - base.__array_interface__["data"][0]
            node |= {"k": "v", "b": self._reference(base, ".base"), "o": offset, "t": list(value.strides)}
            return
        is_fortran = value.flags.f_contiguous and not value.flags.c_contiguous
        node |= {"k": "a", "f": is_fortran, "v": value.tobytes("F" if is_fortran else "C")}

    def _items(self, values: Sequence[Any] | Any) -> list[Any]:
        return [self._reference(value, f"[{i}]") for i, value in enumerate(values)]

    def _cannot_keep(self, value: Any) -> SnapshotError:
        kind = type(value)
        return SnapshotError(
            f"{''.join(self._way) or 'the core'}: expected something whose state can be kept, was a "
            f"{kind.__module__}.{kind.__qualname__}."
        )


def _is_frozen(value: Any) -> bool:
    parameters: Any = getattr(type(value), "__dataclass_params__", None)
    return parameters is not None and parameters.frozen


def _can_be_named(value: Any) -> bool:
    return bool(value.__module__) and "<" not in value.__qualname__


def _is_same(value: Any, before: Any) -> bool:
    return value is before or (type(value) is type(before) and is_plain(value) and repr(value) == repr(before))
