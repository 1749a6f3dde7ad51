"""State of an object and of all that it holds, as plain values and arrays, and back into one built alike.

A reference to a value is the value itself where it is plain, or a list with a letter in front: `n` a node by its index,
`k` a thing that is known by its path, `t` a tuple of plain values, `i` a large integer, `s` a numpy scalar, `e` a
member of an enumeration, `f` a type by name, `m` a method of something.

A state may come from a file. A name in it stands for a class of the kind that its node needs, defined in the module
that it names, which is loaded already: nothing is imported, no attribute is looked up, and nothing is called but what
makes empty objects, tuples, records and errors.
"""

# pyright: basic

import builtins
import hashlib
import operator
import re
import sys
from array import array
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MemberDescriptorType, MethodType, ModuleType, NoneType
from typing import Any, cast

import msgspec
import numpy as np
from msgspec import Struct, StructMeta

from gslcosim.base.errors import SnapshotError
from gslcosim.base.rng import RandomStream

_IMMUTABLE_TYPES = (
    FunctionType,
    BuiltinFunctionType,
    ModuleType,
    frozenset,
    Enum,
    PurePath,
    re.Pattern,
    np.dtype,
    np.void,
)
# Compiled functions, and models of scenes with what draws them: their data are kept elsewhere.
_IMMUTABLE_LIBRARIES = frozenset({"numba", "mujoco"})
PLAIN_TYPES = frozenset({type(None), bool, int, float, str, bytes})
CONTAINERS = (list, deque, dict, set, frozenset, tuple)
# An unchanged array of at least this many bytes is left out.
MIN_HASHED_BYTES = 1 << 14
_MAX_PLAIN_INT = 1 << 63
Node = dict[str, Any]
_BIT_GENERATORS = ("PCG64", "PCG64DXSM", "Philox", "SFC64", "MT19937")
_CONTAINER_TYPES_BY_NAME: dict[str, type] = {
    "list": list, "dict": dict, "odict": OrderedDict, "set": set, "deque": deque
}  # fmt: skip
# Errors that a value causes if its type, size or depth is not that of a state.
_WRONG_VALUES = (
    ArithmeticError, AttributeError, BufferError, LookupError, MemoryError, RecursionError, TypeError, ValueError,
    msgspec.MsgspecError,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ExternalTypeAdapter:
    """Adapter that reads the state of an object of another library as something that can be walked, and restores it."""

    read: Callable[[Any], Any]
    restore: Callable[[Any, Any], None]


_EXTERNAL_TYPES: dict[type, ExternalTypeAdapter] = {}


def register_external_type(type_: type, *, read: Callable[[Any], Any], bring_back: Callable[[Any, Any], None]) -> None:
    """Let snapshots hold objects of another library's type.

    Args:
        type_: The type; types below it do not count.
        read: Returns an object's state.
        bring_back: Takes an object that is built alike, and such a state.
    """
    _EXTERNAL_TYPES[type_] = ExternalTypeAdapter(read=read, restore=bring_back)


def find_external_adapter(value: Any) -> ExternalTypeAdapter | None:
    """Return the registered adapter for a value of another library, or None."""
    return _EXTERNAL_TYPES.get(type(value))


def is_plain(value: Any) -> bool:
    """Return whether a value is written as it is, or is a tuple of such values."""
    return type(value) in PLAIN_TYPES or (type(value) is tuple and all(map(is_plain, cast("tuple[Any, ...]", value))))


def is_walkable(value: Any, packages: frozenset[str]) -> bool:
    """Return whether a value is an object of one of some packages, whose attributes are its state."""
    return _is_walkable_type(type(value)) and type(value).__module__.partition(".")[0] in packages


def _is_walkable_type(type_: type) -> bool:
    return not issubclass(type_, (type, Enum, BaseException, np.ndarray, Struct, *CONTAINERS))


def get_import_name(type_: type) -> str:
    """Return the name under which a type is found again."""
    return f"{type_.__module__}:{type_.__qualname__}"


# Types of packages outside the core.
_KNOWN_TYPES = {
    get_import_name(type_): type_
    for type_ in (
        *PLAIN_TYPES, *CONTAINERS, NoneType, complex, OrderedDict, np.ndarray, np.random.Generator,
        *(type_ for type_ in np.sctypeDict.values() if type_ not in (np.object_, np.void)),
        *(type_ for type_ in vars(builtins).values() if isinstance(type_, type) and issubclass(type_, Exception)),
    )
}  # fmt: skip
# By the letter of a node: what its class is, for errors, and whether one is.
_KINDS: dict[str, tuple[str, Callable[[type], bool]]] = {
    "o": ("a class with attributes", _is_walkable_type),
    "t": ("a named tuple", lambda type_: issubclass(type_, tuple) and hasattr(type_, "_fields")),
    "c": ("a record", lambda type_: issubclass(type_, Struct)),
    "b": ("an exception", lambda type_: issubclass(type_, BaseException)),
    "e": ("an enumeration", lambda type_: issubclass(type_, Enum)),
    "f": ("a class", lambda _: True),
}


def find_type(name: Any, kind: str, packages: frozenset[str]) -> Any:
    """Return the class that a name in a state stands for.

    Args:
        name: As from `get_import_name`.
        kind: The letter of its node.
        packages: Those it may come from, beside known types of Python and numpy; its module has been imported.
    """
    wanted, is_kind = _KINDS[kind]
    module, _, qualname = str(name).partition(":")
    found: Any = _KNOWN_TYPES.get(str(name))
    if found is None and module.partition(".")[0] in packages:
        found = sys.modules.get(module)
        for part in qualname.split("."):
            # Looked up in `vars`, so that no `__getattr__` of a module and no descriptor of a class runs.
            found = vars(found).get(part) if isinstance(found, (ModuleType, type)) else None
    if not isinstance(found, type) or get_import_name(found) != name or not is_kind(found):
        raise SnapshotError(f"expected {wanted} of {' or '.join(sorted(packages))}, was {str(name)[:80]!r}.")
    return found


def get_attributes(value: Any) -> dict[str, Any]:
    """Return the values that an object holds in slots and in `__dict__`, by attribute."""
    held: dict[str, Any] = {}
    for type_ in type(value).__mro__:
        slots: Any = type_.__dict__.get("__slots__", ())
        for name in (slots,) if isinstance(slots, str) else slots:
            if name not in ("__dict__", "__weakref__") and hasattr(value, name):
                held[name] = getattr(value, name)
    held.update(getattr(value, "__dict__", {}))
    return held


def set_attributes(value: Any, held: Mapping[str, Any]) -> None:
    """Let an object hold these attributes, and nothing else in its `__dict__`, whether it is frozen or not."""
    own: dict[str, Any] | None = getattr(value, "__dict__", None)
    if own is not None:
        own.clear()
    for name, inner in held.items():
        set_attribute(value, name, inner)


def set_attribute(value: Any, name: str, inner: Any) -> None:
    """Let an object hold an attribute, in its slot or `__dict__`: no property and no `__setattr__` is called."""
    of_type = _find_in_type(value, name)
    if isinstance(of_type, MemberDescriptorType):
        of_type.__set__(value, inner)
    elif isinstance(of_type, (FunctionType, property, classmethod, staticmethod)) or not hasattr(value, "__dict__"):
        raise SnapshotError(f"expected an attribute of {type(value).__qualname__}, was {str(name)[:80]!r}.")
    else:
        value.__dict__[name] = inner


def _find_in_type(value: Any, name: str) -> Any:
    mro = value.__mro__ if isinstance(value, type) else type(value).__mro__
    return next((vars(type_)[name] for type_ in mro if name in vars(type_)), None)


def iter_parts(value: Any, packages: frozenset[str]) -> Iterator[tuple[str, Any]]:
    """Yield the parts of a value, each with a label that is the same in an object built alike."""
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
            if is_walkable(value, packages):
                for name, inner in get_attributes(value).items():
                    yield f".{name}", inner


def hash_array(array: "np.ndarray[Any, Any]") -> bytes:
    """Return a hash of an array's values."""
    return hashlib.blake2b(array.tobytes(), digest_size=16).digest()


@dataclass(frozen=True, kw_only=True)
class BaselineEntry:
    """Entry of a baseline: the path of a thing, and its content."""

    path: str
    value: Any
    attributes: dict[str, Any] | None = None
    fingerprint: bytes | None = None


class Baseline:
    """Baseline of an object: all that it held when built, by path such as `._crafts[0]._guide` and by identity.

    Things of the types in `fixed` never change.
    """

    def __init__(self, root: object, *, fixed: tuple[type, ...], packages: frozenset[str]) -> None:
        self.fixed = fixed
        self.by_path: dict[str, BaselineEntry] = {}
        self.by_id: dict[int, BaselineEntry] = {}
        waiting: list[tuple[str, Any]] = [("", root)]
        while waiting:
            path, value = waiting.pop()
            if is_plain(value) or id(value) in self.by_id:
                continue
            is_fixed = isinstance(value, fixed)
            self._add(path, value, packages, is_fixed=is_fixed)
            if not is_fixed:
                waiting += [(path + label, part) for label, part in iter_parts(value, packages)]

    def _add(self, path: str, value: Any, packages: frozenset[str], *, is_fixed: bool) -> None:
        attributes = mark = None
        if isinstance(value, np.ndarray):
            if value.nbytes >= MIN_HASHED_BYTES and value.flags.writeable:
                mark = hash_array(value)
        elif not is_fixed and find_external_adapter(value) is None and is_walkable(value, packages):
            attributes = get_attributes(value)
        self.by_id[id(value)] = self.by_path[path] = BaselineEntry(
            path=path, value=value, attributes=attributes, fingerprint=mark
        )


class StateReader:
    """Reads one state; see `ObjectState`."""

    def __init__(self, known: Baseline, packages: frozenset[str]) -> None:
        self._known = known
        self._packages = packages
        self._nodes: list[Node] = []
        self._index: dict[int, int] = {}
        # Kept alive, so that no identity is assigned twice.
        self._alive: list[Any] = []
        self._path: list[str] = []

    def read(self, root: object) -> dict[str, Any]:
        """Return the state of an object."""
        self._reference(root, "")
        return {"nodes": self._nodes}

    def _reference(self, value: Any, label: str) -> Any:
        if type(value) in PLAIN_TYPES:
            return ["i", hex(value)] if type(value) is int and not -_MAX_PLAIN_INT <= value < _MAX_PLAIN_INT else value
        if is_plain(value):
            return ["t", [self._reference(inner, "") for inner in value]]
        if isinstance(value, Enum):
            return ["e", get_import_name(type(value)), value.name]
        if isinstance(value, np.generic) and not isinstance(value, np.void):
            return ["s", value.dtype.str, value.tobytes()]
        if id(value) in self._index:
            return ["n", self._index[id(value)]]
        self._path.append(label)
        try:
            return self._reference_to_thing(value)
        finally:
            self._path.pop()

    def _reference_to_thing(self, value: Any) -> Any:
        found = self._known.by_id.get(id(value))
        if found is not None and self._is_unchanging(value):
            return ["k", found.path]
        if isinstance(value, MethodType):
            return ["m", self._reference(value.__self__, ".__self__"), value.__func__.__name__]
        if isinstance(value, type) and "<" not in value.__qualname__:
            return ["f", get_import_name(value)]
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

    # A function built again in the same place, from settings alone, is equivalent.
    def _known_function(self, value: FunctionType) -> str | None:
        found = self._known.by_path.get("".join(self._path))
        if found is None or getattr(found.value, "__code__", None) is not value.__code__:
            return None
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        are_settings = all(is_plain(held) or isinstance(held, self._known.fixed) or _is_frozen(held) for held in cells)
        return found.path if are_settings else None

    def _is_unchanging(self, value: Any) -> bool:
        if isinstance(value, np.ndarray):
            return not value.flags.writeable
        if isinstance(value, self._known.fixed):
            return True
        if find_external_adapter(value) is not None or is_walkable(value, self._packages):
            return False
        # A value of another library: only where it never changes may its state be left out.
        is_immutable = isinstance(value, (type, *_IMMUTABLE_TYPES))
        return is_immutable or type(value).__module__.partition(".")[0] in _IMMUTABLE_LIBRARIES

    def _fill(self, node: Node, value: Any, found: BaselineEntry | None) -> None:
        foreign = find_external_adapter(value)
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
            node |= {"k": "b", "t": get_import_name(type(value)), "v": self._items(value.args)}
        elif isinstance(value, Struct):
            fields = {name: self._reference(getattr(value, name), f".{name}") for name in value.__struct_fields__}
            # It is frozen: one that was there before still holds the same values.
            node |= {"k": "c", "t": get_import_name(type(value)), "a": fields if found is None else None}
        elif isinstance(value, partial):
            if found is None:
                raise self._cannot_keep(value)
            bound = cast("partial[Any]", value)
            self._items([bound.args, bound.keywords])
            node |= {"k": "p"}
        elif is_walkable(value, self._packages):
            self._fill_object(node, value, found)
        else:
            self._fill_container(node, value, found)

    def _fill_container(self, node: Node, value: Any, found: BaselineEntry | None) -> None:
        type_: type = type(value)
        if isinstance(value, tuple):
            fields = cast("Any", value)
            # A tuple that was there before still holds the same objects; only their content can have changed.
            items = self._items(fields)
            node |= {
                "k": "t",
                "t": None if type_ is tuple else get_import_name(type_),
                "v": items if found is None else None,
            }
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

    def _fill_object(self, node: Node, value: Any, found: BaselineEntry | None) -> None:
        before = found.attributes if found is not None else None
        attributes = get_attributes(value)
        node |= {"k": "o", "t": get_import_name(type(value)), "a": {}}
        for name, inner in attributes.items():
            reference = self._reference(inner, f".{name}")
            if before is None or name not in before or not _is_same(inner, before[name]):
                node["a"][name] = reference
        if before is not None and (gone := [name for name in before if name not in attributes]):
            node["g"] = gone

    # Views are stored as such: shared memory stays shared, and kernels are compiled for a memory layout.
    def _fill_array(self, node: Node, value: "np.ndarray[Any, Any]", found: BaselineEntry | None) -> None:
        if value.dtype.hasobject:
            raise self._cannot_keep(value)
        if found is not None and found.fingerprint is not None and found.fingerprint == hash_array(value):
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
            f"{''.join(self._path) or 'the core'}: expected something whose state can be kept, was a "
            f"{kind.__module__}.{kind.__qualname__}."
        )


def _is_frozen(value: Any) -> bool:
    parameters: Any = getattr(type(value), "__dataclass_params__", None)
    return parameters is not None and parameters.frozen


def _is_same(value: Any, before: Any) -> bool:
    return value is before or (type(value) is type(before) and is_plain(value) and repr(value) == repr(before))


class StateWriter:
    """Writes one state; see `ObjectState`."""

    def __init__(self, known: Baseline, packages: frozenset[str]) -> None:
        self._known = known
        self._packages = packages
        self._nodes: Sequence[Node] = ()
        self._built: dict[int, Any] = {}

    def write(self, nodes: Sequence[Node]) -> None:
        """Bring the known object to the state of these nodes."""
        self._nodes = nodes
        for found in self._known.by_path.values():
            if found.attributes is not None:
                set_attributes(found.value, found.attributes)
        for index in range(len(nodes)):
            self._node(index)

    def _value(self, reference: Any) -> Any:
        if type(reference) in PLAIN_TYPES:
            return reference
        match cast("list[Any]", reference):
            case ["n", index]:
                return self._node(index)
            case ["k", path]:
                return self._at(path).value
            case ["t", items]:
                return tuple(self._value(item) for item in items)
            case ["i", digits]:
                return int(digits, 16)
            case ["s", str(dtype), bytes(data)]:
                return np.frombuffer(data, _read_dtype(dtype))[0]
            case ["e", name, member]:
                return find_type(name, "e", self._packages).__members__[member]
            case ["f", name]:
                return find_type(name, "f", self._packages)
            case ["m", owner, name]:
                return self._method(self._value(owner), name)
            case other:
                raise SnapshotError(f"expected a reference, was {str(other)[:40]}.")

    def _method(self, owner: Any, name: str) -> Any:
        is_type = isinstance(owner, type)
        found = _find_in_type(owner, name)
        if is_type and isinstance(found, classmethod):
            return found.__get__(None, owner)
        if is_type or not isinstance(found, FunctionType) or not is_walkable(owner, self._packages):
            raise SnapshotError(f"expected a method of {type(owner).__qualname__}, was {str(name)[:80]!r}.")
        return MethodType(found, owner)

    def _at(self, path: str) -> BaselineEntry:
        found = self._known.by_path.get(path)
        if found is None:
            raise SnapshotError(f"{path or 'the core'}: expected it as in the run, found none.")
        return found

    def _node(self, index: int) -> Any:
        if index in self._built:
            return self._built[index]
        node = self._nodes[operator.index(index)] if index >= 0 else {}
        found = self._at(node["p"]) if "p" in node else None
        kind: str = node["k"]
        if kind in ("a", "u", "v"):
            value = self._built[index] = self._array(node, found)
            return value
        if kind == "o":
            return self._object(index, node, found)
        if kind in ("list", "dict", "odict", "deque", "set"):
            return self._container(index, node, found)
        value = self._built[index] = self._other(node, found)
        return value

    def _object(self, index: int, node: Node, found: BaselineEntry | None) -> Any:
        type_ = find_type(node["t"], "o", self._packages)
        if found is None:
            value = self._built[index] = object.__new__(type_)
            set_attributes(value, {name: self._value(inner) for name, inner in node["a"].items()})
            return value
        value = self._built[index] = found.value
        if type(value) is not type_:
            raise SnapshotError(f"{found.path}: expected a {node['t']}, was a {type(value).__qualname__}.")
        for name, inner in node["a"].items():
            set_attribute(value, name, self._value(inner))
        for name in node.get("g", ()):
            slot = _find_in_type(value, name)
            slot.__delete__(value) if isinstance(slot, MemberDescriptorType) else value.__dict__.pop(name)
        return value

    def _container(self, index: int, node: Node, found: BaselineEntry | None) -> Any:
        kind: str = node["k"]
        value: Any
        type_ = _CONTAINER_TYPES_BY_NAME[kind]
        if found is None:
            value = deque[Any](maxlen=node["n"]) if kind == "deque" else type_()
        elif type(found.value) is type_ or (kind == "odict" and isinstance(found.value, dict)):
            value = found.value
        else:
            raise _build_kind_error(found, f"a {kind}")
        self._built[index] = value
        if kind in ("dict", "odict"):
            content: Any = [(self._value(key), self._value(inner)) for key, inner in node["v"]]
        else:
            content = [self._value(item) for item in node["v"]]
        value.clear()
        if kind in ("list", "deque"):
            value.extend(content)
        else:
            value.update(content)
        return value

    def _other(self, node: Node, found: BaselineEntry | None) -> Any:
        match node["k"]:
            case "t":
                if found is not None:
                    return found.value
                items = [self._value(item) for item in node["v"]]
                type_: Any = tuple if node["t"] is None else find_type(node["t"], "t", self._packages)
                if type_ is not tuple and len(items) != len(type_._fields):
                    raise SnapshotError(f"expected {len(type_._fields)} items of {node['t']}, was {len(items)}.")
                return tuple.__new__(type_, items)
            case "c":
                if found is not None:
                    return found.value
                fields = {name: self._value(inner) for name, inner in node["a"].items()}
                # They have been checked when they were first in one.
                return StructMeta.__call__(find_type(node["t"], "c", self._packages), **fields)
            case "frozenset":
                return found.value if found is not None else frozenset(self._value(item) for item in node["v"])
            case "p":
                return found.value if found is not None else None
            case "r":
                return self._generator(self._value(node["v"]), found)
            case "y":
                return self._numbers(node, found)
            case "b":
                type_ = find_type(node["t"], "b", self._packages)
                return type_.__new__(type_, *(self._value(item) for item in node["v"]))
            case "x":
                foreign = find_external_adapter(found.value) if found is not None else None
                if found is None or foreign is None:
                    raise _build_kind_error(found, "something of another library")
                foreign.restore(found.value, self._value(node["v"]))
                return found.value
            case other:
                raise SnapshotError(f"expected a node, was one of kind {other!r}.")

    def _array(self, node: Node, found: BaselineEntry | None) -> "np.ndarray[Any, Any]":
        if node["k"] == "u":
            if found is None or not isinstance(found.value, np.ndarray):
                raise _build_kind_error(found, "an array")
            if hash_array(found.value) != node["v"]:
                raise SnapshotError(f"{found.path}: expected the array as in the run, was another.")
            return found.value
        dtype, shape = _read_dtype(_tuples_from_lists(node["d"])), tuple(node["s"])
        if node["k"] == "v":
            base = self._value(node["b"])
            if not isinstance(base, np.ndarray):
                raise SnapshotError(f"expected a view of an array, was one of a {type(base).__qualname__}.")
            # A view of all of it, whatever its order.
            buffer = base if base.flags.c_contiguous else base.T
            value = np.ndarray(shape, dtype, buffer=buffer, offset=node["o"], strides=tuple(node["t"]))
        else:
            value = np.frombuffer(node["v"], dtype).reshape(shape, order="F" if node["f"] else "C")
            if found is not None and not isinstance(found.value, np.ndarray):
                raise _build_kind_error(found, "an array")
            known: Any = None if found is None else found.value
            if found is not None and (known.shape, known.dtype) == (shape, dtype) and known.flags.writeable:
                np.copyto(known, value)
                return known
            value = value.copy("F" if node["f"] else "C")
        if node.get("r"):
            value.flags.writeable = False
        return value

    def _generator(self, state: Any, found: BaselineEntry | None) -> np.random.Generator:
        name = str(state.get("bit_generator"))
        if found is None and name not in _BIT_GENERATORS:
            raise SnapshotError(f"expected a random generator of numpy, was {name}.")
        generator = RandomStream(getattr(np.random, name)()) if found is None else found.value
        if not isinstance(generator, np.random.Generator):
            raise _build_kind_error(found, "a random generator")
        generator.bit_generator.state = state
        return generator

    def _numbers(self, node: Node, found: BaselineEntry | None) -> "array[Any]":
        numbers: array[Any] = found.value if found is not None else array(node["c"])
        if not isinstance(numbers, array):
            raise _build_kind_error(found, "an array of numbers")
        del numbers[:]
        numbers.frombytes(node["v"])
        return numbers


def _build_kind_error(found: BaselineEntry | None, wanted: str) -> SnapshotError:
    what = "nothing that is known" if found is None else f"a {type(found.value).__qualname__}"
    return SnapshotError(f"{found.path if found else ''}: expected {wanted}, was {what}.")


# Objects in an array would be addresses in memory.
def _read_dtype(descr: Any) -> "np.dtype[Any]":
    dtype = np.lib.format.descr_to_dtype(descr)
    if dtype.hasobject:
        raise SnapshotError(f"expected an array of numbers or texts, was one of {dtype}.")
    return dtype


# As msgpack has lists only.
def _tuples_from_lists(descr: Any) -> Any:
    if not isinstance(descr, list):
        return descr
    fields = cast("list[list[Any]]", descr)
    return [(f[0], _tuples_from_lists(f[1]), *(tuple(shape) for shape in f[2:])) for f in fields]


class ObjectState:
    """State of an object and of all that it holds.

    It is made right after the object has been built, and records all values at that time. A state holds the changes
    since then: attributes, containers, arrays, random streams, and new objects. Fixed things, such as functions and a
    room, are named by the place where they were found first. So the parts of a state need no list, and no attribute can
    be forgotten: a value that cannot be kept is an error.

    A state is plain: dicts, lists, numbers, texts and bytes, as msgpack can carry them. An object that is built alike
    by the same code, from settings that may differ where no state depends on them, takes it with `restore`.

    Args:
        fixed: Types of things that never change, which are not walked through.
        packages: Packages whose objects are walked through, besides that of the root.
    """

    def __init__(
        self, root: object, *, fixed: tuple[type, ...] = (), packages: frozenset[str] = frozenset({"gslcosim"})
    ) -> None:
        self._root = root
        self._packages = packages | {type(root).__module__.partition(".")[0]}
        self._known = Baseline(root, fixed=fixed, packages=self._packages)

    def state(self) -> dict[str, Any]:
        """Return the state of the object now."""
        return StateReader(self._known, self._packages).read(self._root)

    def restore(self, state: Mapping[str, Any]) -> None:
        """Bring the object to a state that was read from one built alike."""
        try:
            StateWriter(self._known, self._packages).write(cast("list[dict[str, Any]]", state["nodes"]))
        except _WRONG_VALUES as error:
            raise SnapshotError(f"expected a state, was something else ({type(error).__name__}: {error}).") from error
