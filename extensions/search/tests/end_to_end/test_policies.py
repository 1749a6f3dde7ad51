"""A policy's file flies in a sandbox and in this process with one digest, whatever program trained it."""

import numpy as np
import pytest
import yaml
from real_runs import TINY_ROOM, fly, fly_here

from gslcosim_search.learned.policy import ActionSettings
from gslcosim_search.learned.policy_files import save_policy
from gslcosim_search.learned.value_table import SinceFeature, ValueTable

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]
NAMES = ("nose_ppm.amount", "wind.from_sin", "wind.from_cos")
SHORT = ("--set", "referee.stop.time_limit_s=8")


def table_in(folder):
    """Upwind in gas, across the wind without."""
    values = np.zeros((2, 9), np.float32)
    values[0, 0] = values[1, 2] = 1.0
    digits = [SinceFeature(observation="nose_ppm.amount", above=0.05, cuts=(3.0,))]
    action = ActionSettings(kind="heading", step_m=0.5, hold_s=0.0)
    policy = ValueTable(NAMES, action, digits=digits, values=values, turns_with=NAMES[1:])
    save_policy(folder / "mine.npz", policy, {"made_by": "hand"})
    return folder / "mine.npz"


def model_in(folder):
    """Velocities that a matrix makes of what is seen."""
    import onnx

    helper, numbers = onnx.helper, onnx.TensorProto.FLOAT
    matrix = np.array([[0.1, 0.3], [0.2, 0.7], [0.6, -0.2]], np.float32)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["seen", "matrix"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("seen", numbers, ["n", 3])],
        [helper.make_tensor_value_info("action", numbers, ["n", 2])],
        [onnx.numpy_helper.from_array(matrix, "matrix")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    (folder / "theirs.onnx").write_bytes(model.SerializeToString())
    meaning = {"observation_names": list(NAMES), "action": {"kind": "velocity", "speed_m_s": 0.4, "hold_s": 0.5}}
    (folder / "theirs.yaml").write_text(yaml.safe_dump(meaning))
    return folder / "theirs.onnx"


MAKERS = [pytest.param(model_in, marks=pytest.mark.extras), table_in]


@pytest.mark.parametrize("make", MAKERS)
def test_a_file_runs_alike_in_a_sandbox_and_here(tmp_path, make):
    (tmp_path / "mine").mkdir()
    policy = make(tmp_path / "mine")
    change = (
        *SHORT, "--set", "agents[0].start={python: learned}", "--set", f"agents[0].parameters.policy={policy}",
        "--set", f"agents[0].may_read=[{policy.parent}]",
    )  # fmt: skip
    multi = fly(TINY_ROOM, tmp_path / "multi", *change)
    single = fly_here(TINY_ROOM, tmp_path / "single", *change)
    assert multi.result["valid"], multi.errors
    assert multi.result["faults"] == single.result["faults"] == []
    assert multi.result["digest"] == single.result["digest"]
    assert multi.result["agents"][0]["path_length_m"] > 0.5
