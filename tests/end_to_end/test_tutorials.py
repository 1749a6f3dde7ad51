"""The tutorials are true: who saves their files and types their commands in an empty folder gets what they say."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from deadlines import PROCESS_S
from page_commands import type_block

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "docs" / "tutorials"
REFERENCE = Path(os.environ.get("GSLCOSIM_REFERENCE", ROOT.parent / "shared" / "reference"))
SAVED_AS = re.compile(r"[Ss]ave (?:\w+ ){1,2}as `([^`]+)`[^\n]*\n\n```\w+\n(.*?)```", re.DOTALL)
COMMANDS = re.compile(r"```sh\n(.*?)```", re.DOTALL)

pytestmark = [pytest.mark.end_to_end, pytest.mark.slow]


def read_page(name: str, **shortened: str) -> str:
    """Return a page with values replaced that make its runs long."""
    page = (TUTORIALS / name).read_text()
    for key, value in shortened.items():
        page, n_found = re.subn(rf"\b{key}: [^\s,}}\]]+", f"{key}: {value}", page)
        assert n_found, f"{name} has no {key}"
    return page


def save_files(page: str, folder: Path) -> list[str]:
    found = SAVED_AS.findall(page)
    for name, text in found:
        (folder / name).write_text(text)
    return [name for name, _ in found]


def type_commands(page: str, folder: Path, *, without: str = "", may_miss: bool = False) -> str:
    """Run the page's blocks of commands, but for those with a text, and return what they printed.

    `up` ends with 1 where the source was not found, as in a search that was shortened (`may_miss`).
    """
    printed = ""
    for block in COMMANDS.findall(page):
        if without and without in block:
            continue
        ended = type_block(block, folder)
        is_miss = may_miss and "gslcosim up" in block and ended.returncode == 1 and "The time was up" in ended.stdout
        assert ended.returncode == 0 or is_miss, f"{block}\n{ended.stdout}\n{ended.stderr}"
        printed += ended.stdout
    return printed


@pytest.mark.timeout(4 * PROCESS_S)
def test_a_room_and_a_method_become_a_figure(tmp_path):
    page = read_page("from-nothing-to-a-figure.md", end_time_s="1", warm_up_s="10", time_limit_s="20", repetitions="1")
    save_files(page, tmp_path)
    type_commands(page, tmp_path, may_miss=True)
    results = tmp_path / "results" / "my_study"
    entries = set(pq.read_table(results / "trials.parquet").column("entry").to_pylist())
    assert {"upwind_zigzag", "surge_cast", "oracle", "random_walker"} < entries
    assert len(entries) == 8
    named = set(re.findall(r"`(\w+\.pdf)`", page))
    assert named
    assert named <= {path.name for path in (results / "figures").iterdir()}


def test_a_room_of_gaden_is_flown_and_goes_back(tmp_path):
    page = read_page("coming-from-gaden-or-gsl-bench.md")
    save_files(page, tmp_path)
    assert "The source was found" in type_commands(page, tmp_path, without="gsl_bench_room.yaml")
    assert (tmp_path / "gaden_again" / "OccupancyGrid3D.csv").read_bytes() == (
        tmp_path / "gaden_room" / "OccupancyGrid3D.csv"
    ).read_bytes()
    assert list((tmp_path / "gsl_bench_again").rglob("*_grid.npy"))


def test_stored_gas_of_gsl_bench_is_flown(tmp_path):
    environments = REFERENCE / "gsl-bench" / "environments"
    if not environments.is_dir():
        pytest.skip(f"there is no {environments}")
    page = read_page("coming-from-gaden-or-gsl-bench.md", time_limit_s="20")
    save_files(page, tmp_path)
    (tmp_path / "environments").symlink_to(environments)
    (block,) = [block for block in COMMANDS.findall(page) if "gsl_bench_room.yaml" in block]
    assert "speed" in type_commands(f"```sh\n{block}```", tmp_path, may_miss=True)


@pytest.mark.extras
def test_searches_are_stepped_and_a_model_in_onnx_flies(tmp_path):
    """A model of the same inputs and outputs stands for the trained one: tests have no Stable-Baselines3."""
    onnx = pytest.importorskip("onnx")
    page = read_page("train-with-gymnasium.md")
    names = save_files(page, tmp_path)
    assert names == ["task.py", "one_search.py", "loop.py", "batch_vec_env.py", "train_sb3.py"]
    for name in names:
        compile((tmp_path / name).read_text(), name, "exec")
    assert "8192 steps" in type_commands(page, tmp_path, without="learned")
    n_names, numbers = 15, onnx.TensorProto.FLOAT
    helper = onnx.helper
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observation", "matrix"], ["action"])],
        "actor",
        [helper.make_tensor_value_info("observation", numbers, ["n", n_names])],
        [helper.make_tensor_value_info("action", numbers, ["n", 2])],
        [helper.make_tensor("matrix", numbers, (n_names, 2), [0.1] * 2 * n_names)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    (tmp_path / "leak_seeker.onnx").write_bytes(model.SerializeToString())
    observed = (
        "x y z yaw_sin yaw_cos vx vy vz time refused nose.log_resistance wind.speed wind.from_sin wind.from_cos "
        "nose_ppm.amount"
    )
    action = "{kind: velocity, speed_m_s: 0.5, hold_s: 0.5}"
    card = f"observation_names: [{observed.replace(' ', ', ')}]\naction: {action}\n"
    (tmp_path / "leak_seeker.yaml").write_text(card)
    (block,) = [block for block in COMMANDS.findall(page) if "learned" in block]
    assert "speed" in type_commands(f"```sh\n{block}```", tmp_path, may_miss=True)


@pytest.mark.extras
def test_a_bag_has_the_topics_that_the_page_names(tmp_path):
    pytest.importorskip("rosbags")
    page = read_page("for-ros-2-users.md")
    save_files(page, tmp_path)
    listening, live = (block for block in COMMANDS.findall(page) if "listen.py" in block or "--ros2" in block)
    assert (listening, live) == ("python listen.py\n", "gslcosim up tiny_room --ros2\n")
    printed = type_commands(page.replace(f"```sh\n{listening}```", "").replace(f"```sh\n{live}```", ""), tmp_path)
    topics = {line.split()[0] for line in printed.splitlines() if line.startswith("/")}
    assert {"/tf", "/map", "/beetle/odom", "/beetle/nose", "/beetle/wind", "/truth/filaments"} <= topics
    shown = set(re.findall(r"^\| (?:Map|PointCloud2|MarkerArray|Marker) \| `(/\S+)`", page, re.MULTILINE))
    assert shown <= topics


@pytest.mark.extras
def test_a_program_without_ros_listens_to_a_run(tmp_path):
    pytest.importorskip("rosbags")
    pytest.importorskip("xxhash")
    page = read_page("for-ros-2-users.md")
    save_files(page, tmp_path)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    program = tmp_path / "listen.py"
    text = program.read_text()
    program.write_text(text.replace('RosTypes("jazzy"))', f'RosTypes("jazzy"), endpoint="{endpoint}")'))
    assert program.read_text() != text
    command = [sys.executable, str(program)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as listener:
        try:
            assert listener.stdout is not None
            assert listener.stdout.readline() == "listening\n"
            type_commands(f"```sh\ngslcosim up tiny_room --ros2 --set ros2.endpoint={endpoint}\n```", tmp_path)
            heard = listener.communicate(timeout=PROCESS_S)[0].splitlines()
        finally:
            listener.kill()
    assert [line.split()[0] for line in heard] == ["/beetle/nose"] * 3
