"""The state of an object comes back, in another that is built alike, with all that is shared in it."""

import io
from collections import deque
from dataclasses import dataclass, field
from functools import partial

import msgpack
import numpy as np
import pytest

from gslcosim.base.errors import SnapshotError
from gslcosim.runtime.replay.object_state import ObjectState


def are_states_equal(a, b):
    """Return whether two states are the same; NaN is NaN."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(are_states_equal(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(are_states_equal, a, b))
    return a == b or (isinstance(a, float) and np.isnan(a) and np.isnan(b))


@dataclass(frozen=True)
class Setting:
    limit: int


@dataclass
class Leaf:
    values: np.ndarray
    seen: deque = field(default_factory=lambda: deque(maxlen=3))


class Tree:
    """Something with a state of every kind."""

    def __init__(self, limit=3):
        self.limit = limit
        self.setting = Setting(limit)
        self.table = np.zeros(4)
        self.rows = (self.table[1:3], "address", 17)
        self.leaf = Leaf(np.arange(3.0))
        self.also = self.leaf
        self.rng = np.random.default_rng(5)
        self.new_leaf = partial(Leaf, np.zeros(2))
        self.kept = {"a": [1, 2], (1, 2): {"x"}}
        self.huge = 1
        self.maybe = None

    def grow(self):
        self.table[:] = (1.0, 2.0, 3.0, 4.0)
        self.leaf = Leaf(np.arange(6.0).reshape(2, 3)[:, :2])
        self.leaf.seen.extend([1, 2, 3, 4])
        self.kept["a"].append(3)
        self.kept["new"] = (self.leaf, self.setting, np.float32(0.1), Leaf)
        self.huge = 1 << 100
        self.maybe = Setting(9)
        self.rng.random(3)


def restored(tree, **settings):
    other = Tree(**settings)
    adapter = ObjectState(other, packages=frozenset({Tree.__module__.partition(".")[0]}))
    adapter.restore(msgpack.unpackb(msgpack.packb(tree), strict_map_key=False))
    return other


@pytest.fixture
def grown():
    tree = Tree()
    adapter = ObjectState(tree, packages=frozenset({Tree.__module__.partition(".")[0]}))
    tree.grow()
    return tree, adapter


def test_values_come_back_and_what_was_shared_is_shared(grown):
    tree, adapter = grown
    other = restored(adapter.state())
    assert other.table.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert other.rows[0].tolist() == [2.0, 3.0]
    other.table[1] = 7.0
    assert other.rows[0][0] == 7.0
    assert other.kept["new"][0] is other.leaf
    assert other.kept["new"][1] is other.setting
    assert other.kept["a"] == [1, 2, 3]
    assert other.leaf.seen == deque([2, 3, 4])
    assert other.leaf.seen.maxlen == 3
    assert (other.huge, other.maybe) == (1 << 100, Setting(9))
    assert other.also is not other.leaf
    assert other.also.values.tolist() == [0.0, 1.0, 2.0]
    assert other.rng.random() == tree.rng.random()


def test_arrays_lie_as_they_lay(grown):
    other = restored(grown[1].state())
    assert other.leaf.values.tolist() == [[0.0, 1.0], [3.0, 4.0]]
    assert other.leaf.values.strides == grown[0].leaf.values.strides
    assert not other.leaf.values.flags.c_contiguous


def test_a_setting_that_is_another_stays_another(grown):
    """What has not changed since the object was built is not part of its state."""
    assert restored(grown[1].state(), limit=8).limit == 8


def test_a_state_is_read_without_changing_anything(grown):
    _, adapter = grown
    assert are_states_equal(adapter.state(), adapter.state())


def test_it_can_be_brought_back_again(grown):
    tree, adapter = grown
    state = adapter.state()
    tree.grow()
    adapter.restore(state)
    assert are_states_equal(adapter.state()["nodes"][0], state["nodes"][0])
    assert tree.kept["a"] == [1, 2, 3]


def test_what_cannot_be_kept_is_named_with_its_place(grown):
    tree, adapter = grown
    tree.leaf.values = (number for number in range(3))
    with pytest.raises(
        SnapshotError, match=r"^\.leaf\.values: expected something whose state can be kept, was a .*generator"
    ):
        adapter.state()


def test_what_another_library_holds_is_not_taken_for_fixed():
    """Its state would be lost without a word."""
    tree = Tree()
    tree.maybe = io.BytesIO(b"x")
    adapter = ObjectState(tree, packages=frozenset({Tree.__module__.partition(".")[0]}))
    with pytest.raises(SnapshotError, match=r"^\.maybe: expected something .*, was a _io\.BytesIO"):
        adapter.state()


def test_an_object_that_was_built_otherwise_refuses(grown):
    state = grown[1].state()
    nodes = state["nodes"]
    next(node for node in nodes if node.get("p") == ".leaf" or node["k"] == "r")["p"] = ".nowhere"
    with pytest.raises(SnapshotError, match=r"^\.nowhere: expected it as in the run, found none\."):
        restored(state)
