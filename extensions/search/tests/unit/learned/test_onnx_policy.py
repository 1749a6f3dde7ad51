"""A model that another program trained flies without an agent of its own, and whatever does not fit is reported."""

import builtins
import json

import numpy as np
import pytest
import yaml
from policies import NAMES, seen

from gslcosim_search.learned.onnx_policy import METADATA_KEY
from gslcosim_search.learned.policy import PolicyError
from gslcosim_search.learned.policy_files import load_policy

pytestmark = pytest.mark.extras

MEANING = {"observation_names": list(NAMES), "action": {"kind": "velocity", "speed_m_s": 0.5, "hold_s": 1.0}}
RNG = np.random.default_rng(3)
W = RNG.normal(size=(4, 2)).astype(np.float32)


def tensor(name, shape, dtype="FLOAT"):
    from onnx import TensorProto, helper

    return helper.make_tensor_value_info(name, getattr(TensorProto, dtype), shape)


def node(*words, **settings):
    from onnx import helper

    return helper.make_node(*words, **settings)


def model_of(nodes, inputs, outputs, constants, metadata=None):
    from onnx import helper, numpy_helper

    fixed = [numpy_helper.from_array(array, name) for name, array in constants.items()]
    graph = helper.make_graph(nodes, "policy", inputs, outputs, fixed)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if metadata is not None:
        helper.set_model_props(model, {METADATA_KEY: metadata})
    return model.SerializeToString()


def linear(*, n="n", k=4, metadata=None):
    """The action is W observation."""
    return model_of(
        [node("MatMul", ["obs", "w"], ["action"])],
        [tensor("obs", [n, k])], [tensor("action", [n, 2])], {"w": W[:k]}, metadata,
    )  # fmt: skip


def remembering(n="n"):
    """The action is the sum of all W observations so far, kept in a memory of shape (1, n, 2) as PyTorch has it."""
    nodes = [
        node("MatMul", ["obs", "w"], ["fed"]),
        node("Unsqueeze", ["fed", "axis"], ["fed_1"]),
        node("Add", ["fed_1", "h"], ["h_next"]),
        node("Squeeze", ["h_next", "axis"], ["action"]),
    ]
    inputs, outputs = (
        [tensor("obs", [n, 4]), tensor("h", [1, n, 2])],
        [tensor("action", [n, 2]), tensor("h_next", [1, n, 2])],
    )
    return model_of(nodes, inputs, outputs, {"w": W, "axis": np.array([0], np.int64)})


def choosing(*, as_index):
    """The values of nine choices, or the best one of them as some libraries export it."""
    w = RNG.normal(size=(4, 9)).astype(np.float32)
    nodes = [node("MatMul", ["obs", "w"], ["values"])]
    outputs = [tensor("values", ["n", 9])]
    if as_index:
        nodes.append(node("ArgMax", ["values"], ["choice"], axis=1, keepdims=0))
        outputs = [tensor("choice", ["n"], "INT64")]
    return model_of(nodes, [tensor("obs", ["n", 4])], outputs, {"w": w}), w


@pytest.fixture
def written(tmp_path):
    """Write a model, and beside it what its numbers mean; return the policy."""

    def load(model, *, suffix=".yaml", text=None, **meaning):
        (tmp_path / "theirs.onnx").write_bytes(model)
        plain = {**MEANING, **meaning}
        dumped = yaml.safe_dump(plain) if suffix == ".yaml" else json.dumps(plain)
        (tmp_path / f"theirs{suffix}").write_text(dumped if text is None else text)
        return load_policy(tmp_path / "theirs.onnx")

    return load


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_a_model_acts_on_one_and_on_many(written, suffix):
    policy, (observed,) = written(linear(), suffix=suffix), seen(5, 1)
    actions, memory = policy.act(observed, policy.memory(5))
    np.testing.assert_allclose(actions, np.clip(observed @ W, -1, 1), atol=1e-6)
    assert memory.shape == (5, 0)
    alone, _ = policy.act(observed[2:3], policy.memory(1))
    np.testing.assert_allclose(alone[0], actions[2], atol=1e-6)
    assert policy.action.speed_m_s == 0.5


def test_the_meaning_may_be_in_the_model(tmp_path):
    (tmp_path / "theirs.onnx").write_bytes(linear(metadata=json.dumps(MEANING)))
    assert load_policy(tmp_path / "theirs.onnx").observation_names == NAMES
    (tmp_path / "theirs.onnx").write_bytes(linear(metadata="{"))
    with pytest.raises(PolicyError, match=r"metadata\.gslcosim: expected JSON"):
        load_policy(tmp_path / "theirs.onnx")


@pytest.mark.parametrize("n", ["n", 1])
def test_a_memory_goes_from_one_question_to_the_next(written, n):
    policy = written(remembering(n), memory={"h": "h_next"})
    memory, total = policy.memory(3), np.zeros((3, 2))
    for observed in seen(3, 4):
        total = total + observed @ W
        actions, memory = policy.act(observed, memory)
        np.testing.assert_allclose(actions, np.clip(total, -1, 1), atol=1e-5)
    assert memory.shape == (3, 2)


@pytest.mark.parametrize("as_index", [False, True])
def test_choices_are_values_or_whole_numbers(written, as_index):
    model, w = choosing(as_index=as_index)
    policy, (observed,) = written(model, action={"kind": "heading"}), seen(6, 1)
    assert policy.act(observed, policy.memory(6))[0].tolist() == np.argmax(observed @ w, axis=1).tolist()


@pytest.mark.parametrize(
    ("meaning", "words"),
    [
        ({"observation_names": ["x", "y"]}, r"obs: expected shape \(n, 2\) for the observation_names, was \('n', 4\)"),
        ({"observation_names": None}, "observation_names: expected a list of names, was None"),
        ({"action": {"kind": "fly"}}, "action.kind: expected one of"),
        ({"output": "velocity"}, "output: expected names among action, was velocity"),
        ({"observation": "image"}, "observation: expected names among obs, was image"),
        ({"memory": {"h": "h_next"}}, "memory: expected names among obs, was h"),
        ({"memory": ["h"]}, "memory: expected a map from inputs to outputs"),
        ({"reward": 1}, "expected observation_names, .* to say what a model's numbers mean, was reward"),
        ({"text": "["}, "theirs.yaml: expected YAML or JSON that can be read"),
        ({"text": "words"}, "expected a map that says what a model's numbers mean, was str"),
    ],
)  # fmt: skip
def test_a_wrong_meaning_is_reported_with_the_file(written, meaning, words):
    with pytest.raises(PolicyError, match=rf"(?s){words}.*File: .*theirs\.onnx"):
        written(linear(), **meaning)


def test_other_inputs_and_outputs_than_the_meaning_names_are_reported(written):
    with pytest.raises(PolicyError, match="inputs: expected observation and memory alone, was h too"):
        written(remembering())
    policy = written(linear(), action={"kind": "velocity_3d"})
    with pytest.raises(PolicyError, match=r"action: expected shape \(2, 3\) for action velocity_3d, was \(2, 2\)"):
        policy.act(seen(2, 1)[0], policy.memory(2))


def test_a_model_without_meaning_and_a_corrupt_one_are_reported(tmp_path):
    path = tmp_path / "theirs.onnx"
    with pytest.raises(PolicyError, match="expected the model of a policy, was none there"):
        load_policy(path)
    path.write_bytes(linear())
    with pytest.raises(PolicyError, match=r"expected theirs\.yaml or theirs\.json beside the model, or gslcosim"):
        load_policy(path)
    path.write_bytes(linear()[:40])
    path.with_suffix(".yaml").write_text(yaml.safe_dump(MEANING))
    with pytest.raises(PolicyError, match="expected a model in ONNX that onnxruntime can read"):
        load_policy(path)


def test_without_onnxruntime_the_command_that_installs_it_is_reported(written, monkeypatch):
    imported = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "onnxruntime":
            raise ModuleNotFoundError("No module named 'onnxruntime'", name="onnxruntime")
        return imported(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(PolicyError, match=r"Install it: pip install 'gslcosim-search\[onnx\]'"):
        written(linear())
