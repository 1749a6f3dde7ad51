"""What kinds of values there are: how an object's attributes are read and set, types by name, and foreign objects."""

import hashlib
import importlib
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, cast

import numpy as np
from msgspec import Struct, StructMeta

from gslcosim.errors import SnapshotError

_FIXED_TYPES = (FunctionType, BuiltinFunctionType, ModuleType, frozenset, Enum, PurePath, re.Pattern, np.dtype, np.void)
# Compiled functions, and models of scenes with what draws them: their data are kept elsewhere.
_FIXED_LIBRARIES = frozenset({"numba", "mujoco"})
PLAIN_TYPES = frozenset({type(None), bool, int, float, str, bytes})
CONTAINERS = (list, deque, dict, set, frozenset, tuple)


@dataclass(frozen=True, kw_only=True)
class ForeignKind:
    """How the state of an object of another library is read, as something that can be walked, and brought back."""

    read: Callable[[Any], Any]
    bring_back: Callable[[Any, Any], None]


_FOREIGN: dict[type, ForeignKind] = {}


def keep_foreign(type_: type, *, read: Callable[[Any], Any], bring_back: Callable[[Any, Any], None]) -> None:
    """Let snapshots hold objects of another library's type.

    Args:
        type_: The type; types below it do not count.
        read: Returns an object's state.
        bring_back: Takes an object that is built alike, and such a state.
    """
    _FOREIGN[type_] = ForeignKind(read=read, bring_back=bring_back)


def foreign_kind(value: Any) -> ForeignKind | None:
    """Return how a value of another library is kept, if anybody has said it."""
    return _FOREIGN.get(type(value))


def is_plain(value: Any) -> bool:
    """Whether a value is written as it is, or is a tuple of such values."""
    return type(value) in PLAIN_TYPES or (type(value) is tuple and all(map(is_plain, cast("tuple[Any, ...]", value))))


def is_walked(value: Any, packages: frozenset[str]) -> bool:
    """Whether a value is an object whose attributes are its state: of one of some packages, and nothing built in."""
    type_ = type(value)
    if issubclass(type_, (type, Enum, BaseException, np.ndarray, Struct, *CONTAINERS)):
        return False
    return type_.__module__.partition(".")[0] in packages


def is_known_to_be_fixed(value: Any) -> bool:
    """Whether a value of another library never changes: only then may its state be left out."""
    if isinstance(value, (type, *_FIXED_TYPES)):
        return True
    return type(value).__module__.partition(".")[0] in _FIXED_LIBRARIES


def record_of(type_: Any, fields: dict[str, Any]) -> Any:
    """Return a frozen record of fields that have been checked when they were first in one."""
    return StructMeta.__call__(type_, **fields)


def name_of(named: Any) -> str:
    """Return the name under which a type or function is found again."""
    return f"{named.__module__}:{named.__qualname__}"


def named_by(name: str, packages: frozenset[str]) -> Any:
    """Return a type or function by its name.

    Args:
        name: As from `name_of`.
        packages: Those it may come from: what a file says is looked up nowhere else.

    Raises:
        SnapshotError: there is none.
    """
    module, _, qualname = name.partition(":")
    if module.partition(".")[0] not in packages:
        raise SnapshotError(f"expected something of {', '.join(sorted(packages))}, was {name}.")
    try:
        found: Any = importlib.import_module(module)
        for part in qualname.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise SnapshotError(f"expected to find {name}, found none.") from error
    return found


def attributes_of(value: Any) -> dict[str, Any]:
    """Return what an object holds, by attribute, in slots and in `__dict__`."""
    held: dict[str, Any] = {}
    for type_ in type(value).__mro__:
        slots: Any = type_.__dict__.get("__slots__", ())
        for name in (slots,) if isinstance(slots, str) else slots:
            if name not in ("__dict__", "__weakref__") and hasattr(value, name):
                held[name] = getattr(value, name)
    held.update(getattr(value, "__dict__", {}))
    return held


def set_attributes(value: Any, held: dict[str, Any]) -> None:
    """Let an object hold these attributes, and nothing else in its `__dict__`, whether it is frozen or not."""
    own: dict[str, Any] | None = getattr(value, "__dict__", None)
    if own is not None:
        own.clear()
    for name, inner in held.items():
        object.__setattr__(value, name, inner)


def parts_of(value: Any, packages: frozenset[str]) -> Iterator[tuple[str, Any]]:
    """Yield what a value is made of, each part with a label that is the same in an object built alike."""
    match value:
        case np.ndarray():
            if isinstance(value.base, np.ndarray):
                yield ".base", value.base
        case dict():
            for i, (key, inner) in enumerate(cast("dict[Any, Any]", value).items()):
                yield f"[{key!r}]" if is_plain(key) else f"[#{i}]", inner
        case list() | tuple() | deque():
            for i, inner in enumerate(cast("Sequence[Any]", value)):
                yield f"[{i}]", inner
        case partial():
            bound = cast("partial[Any]", value)
            yield ".func", bound.func
            yield ".args", bound.args
            yield ".keywords", bound.keywords
        case MethodType():
            yield ".__self__", value.__self__
        case Struct():
            for name in value.__struct_fields__:
                yield f".{name}", getattr(value, name)
        case _:
            if is_walked(value, packages):
                for name, inner in attributes_of(value).items():
                    yield f".{name}", inner


def fingerprint(array: "np.ndarray[Any, Any]") -> bytes:
    """Return a hash of an array's values."""
    return hashlib.blake2b(array.tobytes(), digest_size=16).digest()
