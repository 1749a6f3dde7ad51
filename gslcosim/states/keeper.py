"""Keeps the state of one object: what can be told of it later, and brought back into another that is built alike."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from gslcosim.states.known import Known
from gslcosim.states.state_reader import StateReader
from gslcosim.states.state_writer import StateWriter


class StateKeeper:
    """The state of an object and of all that it holds.

    It is made right after the object has been built, and remembers what there is then. A state tells what has changed
    since: attributes, containers, arrays, random streams, and objects that are new. What is fixed, such as functions
    and a room, is named by where it was found at first. So nobody has to list what belongs to a state, and an
    attribute that is forgotten does not exist: what cannot be kept is an error.

    A state is plain: dicts, lists, numbers, texts and bytes, as msgpack can carry them. An object that is built alike
    by the same code, from settings that may differ where no state depends on them, takes it with `bring_back`.

    Args:
        root: The object.
        fixed: Types of things that never change, which are not looked into.
        packages: From which packages objects are walked through, beside that of the root.
    """

    def __init__(
        self, root: object, *, fixed: tuple[type, ...] = (), packages: frozenset[str] = frozenset({"gslcosim"})
    ) -> None:
        self._root = root
        self._packages = packages | {type(root).__module__.partition(".")[0]}
        self._known = Known(root, fixed=fixed, packages=self._packages)

    def state(self) -> dict[str, Any]:
        """Return the state of the object now.

        Raises:
            SnapshotError: something in it cannot be kept; the text says where it is and what.
        """
        return StateReader(self._known, self._packages).read(self._root)

    def bring_back(self, state: Mapping[str, Any]) -> None:
        """Bring the object to a state that was read from one built alike.

        Raises:
            SnapshotError: the state is of an object that was built otherwise; the object is of no use any more.
        """
        StateWriter(self._known, self._packages).write(cast("list[dict[str, Any]]", state["nodes"]))


def equal_states(a: Any, b: Any) -> bool:
    """Return whether two states are the same; NaN is NaN."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal_states(a[key], b[key]) for key in cast("dict[str, Any]", a))
    if isinstance(a, list):
        return len(a) == len(b) and all(map(equal_states, cast("list[Any]", a), b))
    return bool(a == b) or (isinstance(a, float) and np.isnan(a) and np.isnan(b))
