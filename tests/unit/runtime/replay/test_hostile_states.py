"""A state of a stranger is data: of each kind of node, what is none is refused, and nothing is run or imported."""

import builtins
import copy
import os
import random
import subprocess
import sys
from array import array
from collections import OrderedDict, deque
from enum import Enum
from functools import partial
from typing import NamedTuple

import msgpack
import msgspec
import numpy as np
import pytest

from gslcosim.base.errors import SnapshotError
from gslcosim.runtime.replay.object_state import ObjectState
from gslcosim.runtime.replay.snapshot import read_observations

CALLS = []


class Colour(Enum):
    RED = 1

    @classmethod
    def _missing_(cls, value):
        CALLS.append(("enum", value))


class Pair(NamedTuple):
    left: object
    right: object


class Fact(msgspec.Struct, frozen=True):
    n: int


class OurError(Exception):
    def __init__(self, *args):
        CALLS.append(("error", args))
        super().__init__(*args)


class Slotted:
    __slots__ = ("kept",)

    def __init__(self):
        self.kept = 1


class Leaf:
    def __init__(self):
        CALLS.append("init")
        self.n = 0

    def __setstate__(self, state):
        CALLS.append(("setstate", state))

    def __reduce__(self):
        CALLS.append("reduce")
        return os.system, ("true",)

    def __setattr__(self, name, value):
        CALLS.append((name, value))
        object.__setattr__(self, name, value)

    @property
    def asked(self):
        CALLS.append("asked")
        return os.system

    @asked.setter
    def asked(self, value):
        CALLS.append(("property", value))

    def work(self):
        return "work"

    def __getattr__(self, name):
        CALLS.append(("getattr", name))
        raise AttributeError(name)


class Core:
    """Holds something of each kind."""

    def __init__(self):
        self.leaf = Leaf()
        self.slotted = Slotted()
        self.values = np.arange(4.0)
        self.view = self.values[1:3]
        self.rng = np.random.default_rng(1)
        self.numbers = array("d", [1.0])
        self.items = [1]
        self.table = {"a": 1}
        self.ordered = OrderedDict(a=1)
        self.queue = deque([1], maxlen=3)
        self.names = {"a"}
        self.made = partial(Leaf)
        self.free = None
        self.big = np.zeros(1 << 12)

    def change(self):
        self.free = [Leaf(), Pair(1, 2), Fact(n=3), OurError("x"), Colour.RED, np.float32(1.5), Leaf, self.leaf.work]
        self.items += [frozenset({1}), np.arange(6).reshape(2, 3)[:, 1:], 1 << 80, ValueError("late"), Slotted()]
        self.values[0] = 9.0
        self.rng.random()


PACKAGES = frozenset({Core.__module__.partition(".")[0]})


def build_adapter():
    core = Core()
    return core, ObjectState(core, packages=PACKAGES)


@pytest.fixture
def state():
    core, adapter = build_adapter()
    core.change()
    kept = msgpack.unpackb(msgpack.packb(adapter.state()), strict_map_key=False)
    CALLS.clear()
    return kept


def restore(state):
    core, adapter = build_adapter()
    CALLS.clear()
    adapter.restore(state)
    return core


def refusal(state, *nodes):
    changed = copy.deepcopy(state)
    changed["nodes"] += nodes
    with pytest.raises(SnapshotError) as error:
        restore(changed)
    assert "\n" not in str(error.value)
    assert CALLS == []
    return str(error.value)


def test_all_that_is_kept_comes_back_without_a_call(state):
    core = restore(state)
    assert CALLS == []
    leaf, pair, fact, fault, colour, number, type_, method = core.free
    assert (type(leaf), pair, fact, colour, number, type_) == (Leaf, Pair(1, 2), Fact(n=3), Colour.RED, 1.5, Leaf)
    assert (type(fault), fault.args, method()) == (OurError, ("x",), "work")
    assert core.items[2].tolist() == [[1, 2], [4, 5]]
    assert (type(core.items[4]), core.items[4].args, core.items[5].kept) == (ValueError, ("late",), 1)


NAMES = (
    "os:system", "builtins:eval", "builtins:exec", "posix:system", "subprocess:Popen", "importlib:import_module",
    "gslcosim.base.spawn:os.system", "gslcosim.base.spawn:os", "gslcosim.base.spawn:spawn",
    "gslcosim.runtime.replay.object_state:importlib.import_module", "gslcosim.base.files:shutil.rmtree", "numpy:load",
    "numpy:fromfile", "numpy:object_", "numpy:void", "gslcosim.__main__:main", "gslcosim:nothing",
    "gslcosim.base.errors:GslCosimError.__init__", "gslcosim.base.errors:GslCosimError.__class__", "", ":", "gslcosim",
    "gslcosim.base.files:Path", "gslcosim.contract.messages:Any", "gslcosim.base.files:ScratchFolder.close",
    f"{Core.__module__}:os.system", f"{Core.__module__}:subprocess.Popen", f"{Core.__module__}:Leaf.work",
    f"{Core.__module__}:CALLS.append", f"{Core.__module__}:np.load",
)  # fmt: skip


def build_nodes(name):
    """Return a node of each kind that names something."""
    marker = ["touch /tmp/nothing"]
    return (
        {"k": "o", "t": name, "a": {}},
        {"k": "t", "t": name, "v": marker},
        {"k": "c", "t": name, "a": {"n": 1}},
        {"k": "b", "t": name, "v": marker},
        {"k": "list", "v": [["e", name, "RED"]]},
        {"k": "list", "v": [["f", name]]},
        {"k": "list", "v": [["m", ["f", name], "system"]]},
    )


@pytest.mark.parametrize("name", NAMES)
def test_no_kind_of_node_finds_what_is_no_class_of_its_own_module(state, name):
    for node in build_nodes(name):
        assert "expected" in refusal(state, node)


def test_each_kind_of_node_demands_a_class_of_its_kind(state):
    # In the order of `build_nodes`.
    classes = ("Leaf", "Pair", "Fact", "OurError", "Colour")
    for wanted in range(len(classes)):
        for given, kind in enumerate(classes):
            node = build_nodes(f"{Core.__module__}:{kind}")[wanted]
            if given != wanted:
                assert "expected" in refusal(state, node)


@pytest.mark.parametrize(
    "name", ["this:antigravity", "antigravity:x", "gslcosim.cli.commands.up:run", "gslcosim_training:X"]
)
def test_no_module_is_imported_because_a_state_names_it(state, name):
    sys.modules.pop(name.partition(":")[0], None)
    before = set(sys.modules)
    for node in build_nodes(name):
        refusal(state, node)
    assert set(sys.modules) == before


REFERENCES = (
    ["n", -1], ["n", 10**6], ["n", "0"], ["n", None], ["n", 0.5], ["k", ".nowhere"], ["k", []], ["i", "no"], ["i", 5],
    ["s", "O", b"\0" * 8], ["s", "|O", b"\0" * 8], ["s", "<f8", b""], ["s", "<f8", b"12"], ["s", "nothing", b"12"],
    ["e", f"{Core.__module__}:Colour", "BLUE"], ["e", f"{Core.__module__}:Colour", "__class__"],
    ["m", ["k", ".leaf"], "asked"], ["m", ["k", ".leaf"], "__class__"], ["m", ["k", ".leaf"], "nothing"],
    ["m", ["k", ".leaf"], "n"], ["m", ["k", ".table"], "clear"], ["m", ["f", "builtins:dict"], "fromkeys"],
    ["m", ["f", f"{Core.__module__}:Leaf"], "work"], ["m", 5, "bit_length"], ["t"], ["t", 5], [], ["z", 1],
    {"k": "list"}, ["t", [["t", [{"a": 1}]]]],
)  # fmt: skip


@pytest.mark.parametrize("reference", REFERENCES, ids=str)
def test_a_reference_that_is_none_is_refused(state, reference):
    refusal(state, {"k": "list", "v": [reference]})
    refusal(state, {"k": "o", "t": f"{Core.__module__}:Leaf", "a": {"n": reference}})


NODES = (
    {},
    {"k": "z"},
    {"k": None},
    {"k": "o"},
    {"k": "list"},
    {"k": "list", "v": 5},
    {"k": "set", "v": [["n", 0]], "p": ".leaf"},
    {"k": "list", "v": [], "p": ".table"},
    {"k": "dict", "v": [], "p": ".leaf"},
    {"k": "odict", "v": [], "p": ".leaf"},
    {"k": "deque", "v": [], "n": -1},
    {"k": "deque", "v": [], "p": ".rng"},
    {"k": "dict", "v": [[["n", 0]]]},
    {"k": "x", "v": 1},
    {"k": "x", "v": 1, "p": ".leaf"},
    {"k": "r", "v": 1},
    {"k": "r", "v": 1, "p": ".leaf"},
    {"k": "y", "c": "u", "v": b"1"},
    {"k": "y", "c": "d", "v": b"1"},
    {"k": "y", "c": "d", "v": b"", "p": ".items"},
    {"k": "u", "v": b"1"},
    {"k": "u", "v": b"1", "p": ".big"},
    {"k": "u", "v": b"1", "p": ".items"},
    {"k": "a", "d": "<f8", "s": [1 << 40], "f": False, "v": b""},
    {"k": "a", "d": "|O", "s": [1], "f": False, "v": b"\0" * 8},
    {"k": "a", "d": [["a", "|O"]], "s": [1], "f": False, "v": b"\0" * 8},
    {"k": "a", "d": "<f8", "s": [-1, -1], "f": False, "v": b""},
    {"k": "a", "d": "<f8", "s": [1], "f": False, "v": b"\0" * 8, "p": ".leaf"},
    {"k": "a", "d": 5, "s": [1], "f": False, "v": b""},
    {"k": "v", "d": "<f8", "s": [9], "b": ["k", ".values"], "o": 0, "t": [8]},
    {"k": "v", "d": "<f8", "s": [1], "b": ["k", ".values"], "o": 1 << 40, "t": [8]},
    {"k": "v", "d": "<f8", "s": [3], "b": ["k", ".values"], "o": 0, "t": [-8]},
    {"k": "v", "d": "|O", "s": [1], "b": ["k", ".values"], "o": 0, "t": [8]},
    {"k": "v", "d": "<f8", "s": [1], "b": ["k", ".leaf"], "o": 0, "t": [8]},
    {"k": "v", "d": "<f8", "s": [1], "b": b"12345678", "o": 0, "t": [8]},
    {"k": "t", "t": f"{Core.__module__}:Pair", "v": [1]},
    {"k": "c", "t": f"{Core.__module__}:Fact", "a": {"m": 1}},
    {"k": "o", "t": f"{Core.__module__}:Leaf", "a": {"asked": 1}},
    {"k": "o", "t": f"{Core.__module__}:Leaf", "a": {"work": 1}},
    {"k": "o", "t": f"{Core.__module__}:Slotted", "a": {"other": 1}},
    {"k": "o", "t": f"{Core.__module__}:Leaf", "a": [1]},
    {"k": "o", "t": f"{Core.__module__}:Slotted", "a": {}, "p": ".leaf"},
    {"k": "o", "t": f"{Core.__module__}:Leaf", "a": {}, "p": ".leaf", "g": ["asked"]},
)


@pytest.mark.parametrize("node", NODES, ids=lambda node: str(node)[:60])
def test_a_node_that_is_none_is_refused(state, node):
    refusal(state, node)


def test_names_with_a_meaning_for_python_are_plain_attributes(state):
    """They change neither the class of an object nor what it holds besides."""
    held = {"__class__": ["f", f"{Core.__module__}:Core"], "__dict__": 5, "n": 7}
    changed = copy.deepcopy(state)
    changed["nodes"].append({"k": "o", "t": f"{Core.__module__}:Leaf", "a": held, "p": ".leaf"})
    leaf = restore(changed).leaf
    assert (type(leaf), leaf.n) == (Leaf, 7)


def test_depth_cycles_and_chains_end_in_a_sentence(state):
    n = len(state["nodes"])
    refusal(state, {"k": "t", "t": None, "v": [["n", n]]})
    refusal(state, *({"k": "list", "v": [["n", n + i + 1]]} for i in range(5000)), {"k": "z"})
    deep = 5
    for _ in range(5000):
        deep = ["t", [deep]]
    changed = {"nodes": [*state["nodes"], {"k": "list", "v": [deep]}]}
    with pytest.raises(SnapshotError):
        restore(changed)


@pytest.mark.parametrize("nodes", [None, 5, "x", [5], [None], {"a": 1}, {}])
def test_a_state_of_another_shape_is_refused(nodes):
    with pytest.raises(SnapshotError):
        restore({"nodes": nodes} if nodes != {} else {})


def mutate(value, random_):
    """Return a value with one part of it replaced by something else."""
    strange = (
        None, -1, 1 << 62, 0.5, "os:system", b"\xff", [], ["f", "os:system"], ["n", 3], {"k": "o", "t": "os:system"},
    )  # fmt: skip
    value = copy.deepcopy(value)
    at = value
    while True:
        places = list(at) if isinstance(at, dict) else list(range(len(at))) if isinstance(at, list) else []
        if not places:
            return value
        place = random_.choice(places)
        if not isinstance(at[place], (dict, list)) or random_.random() < 0.2:
            at[place] = random_.choice(strange)
            return value
        at = at[place]


def test_mutated_states_come_back_or_are_refused_and_run_nothing(state, monkeypatch):
    ran = []
    for module, name in ((os, "system"), (subprocess, "Popen"), (builtins, "eval"), (builtins, "exec")):
        monkeypatch.setattr(module, name, lambda *args, **_: ran.append(args))
    random_ = random.Random(46)
    n_refused = 0
    for _ in range(1500):
        try:
            restore(mutate(state, random_))
        except SnapshotError:
            n_refused += 1
        assert CALLS == []
    assert ran == []
    assert n_refused > 300


def test_a_pipe_in_place_of_what_an_agent_was_told_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "beetle.log")
    with pytest.raises(SnapshotError, match="a pipe and no file"):
        next(read_observations(tmp_path, "beetle"))
