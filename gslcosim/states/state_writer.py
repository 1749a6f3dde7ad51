"""Brings an object back to a state that was read from one built alike; see `StateKeeper`."""

from array import array
from collections import OrderedDict, deque
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from gslcosim.errors import SnapshotError
from gslcosim.states.known import Found, Known
from gslcosim.states.state_values import fingerprint, foreign_kind, named_by, record_of, set_attributes

_GENERATORS = ("PCG64", "PCG64DXSM", "Philox", "SFC64", "MT19937")
_EMPTY: dict[str, type] = {"list": list, "dict": dict, "odict": OrderedDict, "set": set}
Node = dict[str, Any]


class StateWriter:
    """Writes one state; see `StateKeeper`."""

    def __init__(self, known: Known, packages: frozenset[str]) -> None:
        self._known = known
        self._packages = packages
        self._nodes: Sequence[Node] = ()
        self._built: dict[int, Any] = {}

    def write(self, nodes: Sequence[Node]) -> None:
        """Bring the known object to the state of these nodes."""
        self._nodes = nodes
        for found in self._known.found():
            if found.attributes is not None:
                set_attributes(found.value, found.attributes)
        for index in range(len(nodes)):
            self._node(index)

    def _value(self, reference: Any) -> Any:
        if not isinstance(reference, list):
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
            case ["s", dtype, data]:
                return np.frombuffer(data, np.dtype(dtype))[0]
            case ["e", name, member]:
                return named_by(name, self._packages)[member]
            case ["f", name]:
                return named_by(name, self._packages | {"builtins", "numpy", "math"})
            case ["m", owner, name]:
                return getattr(self._value(owner), name)
            case other:
                raise SnapshotError(f"expected a reference, was {str(other)[:40]}.")

    def _at(self, path: str) -> Found:
        found = self._known.at(path)
        if found is None:
            raise SnapshotError(f"{path or 'the core'}: expected it as in the run, found none.")
        return found

    def _node(self, index: int) -> Any:
        if index in self._built:
            return self._built[index]
        node = self._nodes[index]
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

    def _object(self, index: int, node: Node, found: Found | None) -> Any:
        type_ = named_by(node["t"], self._packages)
        if found is None:
            value = self._built[index] = object.__new__(type_)
            set_attributes(value, {name: self._value(inner) for name, inner in node["a"].items()})
            return value
        value = self._built[index] = found.value
        if type(value) is not type_:
            raise SnapshotError(f"{found.path}: expected a {node['t']}, was a {type(value).__qualname__}.")
        for name, inner in node["a"].items():
            object.__setattr__(value, name, self._value(inner))
        for name in node.get("g", ()):
            object.__delattr__(value, name)
        return value

    def _container(self, index: int, node: Node, found: Found | None) -> Any:
        kind: str = node["k"]
        value: Any
        if found is not None:
            value = found.value
        else:
            value = deque[Any](maxlen=node["n"]) if kind == "deque" else _EMPTY[kind]()
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

    def _other(self, node: Node, found: Found | None) -> Any:
        match node["k"]:
            case "t":
                if found is not None:
                    return found.value
                items = [self._value(item) for item in node["v"]]
                return tuple(items) if node["t"] is None else named_by(node["t"], self._packages)(*items)
            case "c":
                if found is not None:
                    return found.value
                fields = {name: self._value(inner) for name, inner in node["a"].items()}
                return record_of(named_by(node["t"], self._packages), fields)
            case "frozenset":
                return found.value if found is not None else frozenset(self._value(item) for item in node["v"])
            case "p":
                return found.value if found is not None else None
            case "r":
                return self._generator(self._value(node["v"]), found)
            case "y":
                return self._numbers(node, found)
            case "b":
                return named_by(node["t"], self._packages)(*(self._value(item) for item in node["v"]))
            case "x":
                return self._foreign(node, found)
            case other:
                raise SnapshotError(f"expected a node, was one of kind {other!r}.")

    def _array(self, node: Node, found: Found | None) -> "np.ndarray[Any, Any]":
        if node["k"] == "u":
            assert found is not None
            if fingerprint(found.value) != node["v"]:
                raise SnapshotError(f"{found.path}: expected the array as in the run, was another.")
            return found.value
        dtype, shape = np.lib.format.descr_to_dtype(_with_tuples(node["d"])), tuple(node["s"])
        if node["k"] == "v":
            base = self._value(node["b"])
            value = np.ndarray(shape, dtype, buffer=_buffer_of(base), offset=node["o"], strides=tuple(node["t"]))
        else:
            value = np.frombuffer(node["v"], dtype).reshape(shape, order="F" if node["f"] else "C")
            if found is not None and _fits(found.value, value):
                np.copyto(found.value, value)
                return found.value
            value = value.copy("F" if node["f"] else "C")
        if node.get("r"):
            value.flags.writeable = False
        return value

    def _generator(self, state: Any, found: Found | None) -> np.random.Generator:
        name = str(state.get("bit_generator"))
        if found is None and name not in _GENERATORS:
            raise SnapshotError(f"expected a random generator of numpy, was {name}.")
        generator = np.random.Generator(getattr(np.random, name)()) if found is None else found.value
        generator.bit_generator.state = state
        return generator

    def _numbers(self, node: Node, found: Found | None) -> "array[Any]":
        numbers: array[Any] = found.value if found is not None else array(node["c"])
        del numbers[:]
        numbers.frombytes(node["v"])
        return numbers

    def _foreign(self, node: Node, found: Found | None) -> Any:
        assert found is not None
        foreign = foreign_kind(found.value)
        if foreign is None:
            raise SnapshotError(f"{found.path}: expected something of another library, was {type(found.value)}.")
        foreign.bring_back(found.value, self._value(node["v"]))
        return found.value


def _fits(known: Any, value: "np.ndarray[Any, Any]") -> bool:
    return known.shape == value.shape and known.dtype == value.dtype and known.flags.writeable


# A view of all of it, whatever its order.
def _buffer_of(base: "np.ndarray[Any, Any]") -> Any:
    return base if base.flags.c_contiguous else base.T


# As msgpack has lists only.
def _with_tuples(descr: Any) -> Any:
    if not isinstance(descr, list):
        return descr
    fields = cast("list[list[Any]]", descr)
    return [(f[0], _with_tuples(f[1]), *(tuple(shape) for shape in f[2:])) for f in fields]
