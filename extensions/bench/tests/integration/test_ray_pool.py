"""A suite on a Ray cluster of two nodes that share no files; the nodes are network namespaces of this machine.

Each has a cache of its own, and from the second one the folder of the suite and the first one's cache are hidden.
"""

import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from deadlines import PROCESS_S

from gslcosim.base import kernel_cache
from gslcosim.base.bundled import bundled_agents

pytestmark = [
    pytest.mark.slow,
    pytest.mark.end_to_end,
    pytest.mark.extras,
    pytest.mark.debian,
]

ADDRESS = "10.214.9.1:6379"
SUITE = """
schema: gslcosim/suite/1
name: two_nodes
scenarios: [tiny_room]
set: {gas.tape: true}
vary:
  - agents[0].vehicle.start_m: [[4.5, 2.5, 0.2], [4.5, 1.0, 0.2]]
repetitions: 1
anchors: [oracle]
entries:
  - {name: dung_beetle, start: {python: dung_beetle}}
  - {name: mine, start: {python: mine/agent.py}}
  - {name: raises, start: {python: mine/raises.py}}
  - {name: leaves, start: {command: [sh, mine/leaves.sh], door: stdio}}
record: {keep: [slowest]}
"""
N_TRIALS = 10
TOKEN = secrets.token_hex(32)
FLY = """
import json, sys
from pathlib import Path
from gslcosim_bench.execution.pool import LocalPool
from gslcosim_bench.execution.ray_pool import RayPool
from gslcosim_bench.execution.runner import SuiteRun
from gslcosim_bench.cases.models import Selection
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.cases import load_suite, build_plan

def start():
    return LocalPool(2, limits) if sys.argv[3] == "here" else RayPool(sys.argv[3], limits)

loaded = load_suite(sys.argv[1])
limits = loaded.suite.limits
try:
    summary = SuiteRun(build_plan(loaded), ResultsFolder(Path(sys.argv[2])), start, selection=Selection.of([])).fly()
except Exception as error:
    sys.exit(f"{type(error).__name__}: {error}")
print(json.dumps([summary.n_flown, summary.n_without_result, summary.is_interrupted]))
"""


@dataclass(frozen=True)
class Node:
    """A network namespace whose programs have a cache of their own, and do not see what `hides` says."""

    name: str
    address: str
    folder: Path
    hides: str = "true"
    started: "list[subprocess.Popen[str]]" = field(default_factory=list)

    @property
    def cache(self) -> Path:
        return self.folder / "cache"

    def start(self, *words: str, **more: Any) -> "subprocess.Popen[str]":
        inherited = {name: value for name, value in os.environ.items() if name != "GSLCOSIM_CACHE"}
        env = {**inherited, "XDG_CACHE_HOME": str(self.cache)}
        env |= {"HOME": str(self.folder), "PYTHONUNBUFFERED": "1", "RAY_USAGE_STATS_ENABLED": "0"}
        env |= {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": TOKEN}
        # Workers are nice otherwise, and wait for whatever else the machine does.
        env |= {"RAY_worker_niceness": "0"}
        call = ["ip", "netns", "exec", self.name, "sh", "-c", f'{self.hides} && exec "$@"', "sh", sys.executable]
        program = subprocess.Popen([*call, *words], env=env, cwd=self.folder, text=True, **more)
        self.started.append(program)
        return program

    def start_ray(self, *words: str, ray: str = "ray") -> None:
        options = [f"--node-ip-address={self.address}", f"--temp-dir={self.folder / ray}", "--num-cpus=1", "--block"]
        options += [f"--object-store-memory={80 << 20}", "--log-color=false"]
        with (self.folder / f"{ray}.log").open("w") as log:
            started = self.start("-m", "ray.scripts.scripts", "start", *options, *words, stdout=log, stderr=log)
        text = (self.folder / f"{ray}.log").read_text
        self.wait_for(lambda: "Ray runtime started" in text() or started.poll() is not None)
        assert started.poll() is None, text()

    def wait_for(self, is_so: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PROCESS_S
        while not is_so():
            assert time.monotonic() < deadline, [log.read_text() for log in self.folder.glob("*.log")]
            time.sleep(0.05)

    def fly(self, suite: Path, results: Path, where: str) -> "subprocess.Popen[str]":
        return self.start("-c", FLY, str(suite), str(results), where, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def pids(self, title: str = "") -> list[int]:
        pids = [int(pid) for pid in ip("netns", "pids", self.name).stdout.split()]
        return [pid for pid in pids if title in _title_of(pid)]

    def end(self) -> None:
        while pids := self.pids():
            for pid in pids:
                kill(pid)
            time.sleep(0.05)
        for program in self.started:
            program.communicate()


def ip(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(["ip", *words], capture_output=True, text=True, check=True)


def _title_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def kill(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """A folder with a short name, for Ray's sockets lie in it."""
    made = Path(tempfile.mkdtemp(prefix="gslcosim-", dir="/tmp"))
    yield made
    shutil.rmtree(made, ignore_errors=True)


@pytest.fixture(scope="module")
def suite(folder: Path) -> Path:
    """A suite with programs of its author's."""
    mine = folder / "suite" / "mine"
    mine.mkdir(parents=True)
    shutil.copy(bundled_agents()["dung_beetle"], mine / "agent.py")
    shutil.copy(Path(__file__).parent / "hostile" / "raises.py", mine)
    (mine / "leaves.sh").write_text("echo bye >&2; exit 3\n")
    (folder / "suite" / "suite.yaml").write_text(SUITE)
    return folder / "suite" / "suite.yaml"


@pytest.fixture(scope="module")
def nodes(folder: Path, suite: Path) -> Iterator[tuple[Node, Node]]:
    """Two namespaces with a cable between them and a Ray node of one CPU in each."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("needs root and `ip` (Debian's iproute2) to make network namespaces")
    here, there = (
        Node(f"gslcosim-ray-{os.getpid()}-{side}", f"10.214.9.{i}", folder / side) for i, side in enumerate("ab", 1)
    )
    there = replace(there, hides=f"mount -t tmpfs none {suite.parent} && mount -t tmpfs none {here.folder}")
    made: list[Node] = []
    try:
        for node in (here, there):
            node.folder.mkdir()
            ip("netns", "add", node.name)
            made.append(node)
        _lay_cable(here, there)
    except subprocess.CalledProcessError as error:
        for node in made:
            ip("netns", "delete", node.name)
        pytest.skip(f"network namespaces cannot be made here: {error.stderr.strip()}")
    try:
        here.start_ray("--head", "--port=6379", "--include-dashboard=false")
        there.start_ray(f"--address={ADDRESS}")
        yield here, there
    finally:
        for node in (here, there):
            node.end()
            ip("netns", "delete", node.name)


def _lay_cable(here: Node, there: Node) -> None:
    ends = [f"gr{os.getpid() % 100000}{side}" for side in "ab"]
    ip("link", "add", ends[0], "netns", here.name, "type", "veth", "peer", "name", ends[1], "netns", there.name)
    for node, end in zip((here, there), ends, strict=True):
        ip("-n", node.name, "address", "add", f"{node.address}/24", "dev", end)
        ip("-n", node.name, "link", "set", end, "up")
        ip("-n", node.name, "link", "set", "lo", "up")


@pytest.fixture(scope="module")
def flown_here(nodes: tuple[Node, Node], suite: Path, folder: Path) -> Path:
    """Results by two workers of one machine."""
    flight = nodes[0].fly(suite, folder / "here", "here")
    assert flown(flight) == [N_TRIALS, 0, False]
    return folder / "here"


def flown(flight: "subprocess.Popen[str]") -> list[Any]:
    """Wait for a run; return what it printed, which is one line: Ray is quiet."""
    text, _ = flight.communicate(timeout=PROCESS_S)
    assert flight.returncode == 0, text
    return json.loads(text)


def rows_of(results: Path) -> list[dict[str, Any]]:
    table = pq.read_table(results / "trials.parquet")
    return table.select([name for name in table.schema.names if not name.startswith("wall_")]).to_pylist()


def workers_of(results: Path) -> set[str]:
    names = pq.read_table(results / "trials.parquet").column("wall_worker").to_pylist()
    return {name.partition("/")[0] for name in names}


def test_two_nodes_bring_the_rows_of_one_machine(
    nodes: tuple[Node, Node], suite: Path, folder: Path, flown_here: Path
) -> None:
    """Digests and tracks are the same; both nodes fly, with rooms and tapes of their own; nothing is left."""
    here, there = nodes
    shutil.rmtree(here.cache, ignore_errors=True)
    assert flown(here.fly(suite, folder / "both", ADDRESS)) == [N_TRIALS, 0, False]
    assert rows_of(folder / "both") == rows_of(flown_here)
    assert (folder / "both" / "tracks.parquet").read_bytes() == (flown_here / "tracks.parquet").read_bytes()
    assert workers_of(folder / "both") == {here.address, there.address}
    for node in nodes:
        assert len(list((node.cache / "gslcosim" / "environments").iterdir())) == 1
        assert any((node.cache / "gslcosim" / "tapes").iterdir())
    assert any((there.cache / "gslcosim" / "shipped").rglob("mine/agent.py"))
    assert not (here.cache / "gslcosim" / "shipped").exists()
    recorded = {path.name for path in (flown_here / "recordings").iterdir()}
    assert {path.parent.name for path in (folder / "both" / "recordings").glob("*/recording.rrd")} == recorded
    for node in nodes:
        node.wait_for(lambda node=node: not node.pids("RayWorker") and not node.pids("bench.execution.worker"))


@pytest.mark.soak
def test_an_interruption_leaves_no_actor(nodes: tuple[Node, Node], suite: Path, folder: Path) -> None:
    """Ctrl-C ends the actors and the workers behind them on all nodes, and leaves whole tables."""
    here, _ = nodes
    flight = here.fly(suite, folder / "interrupted", ADDRESS)
    journal = folder / "interrupted" / "rows.jsonl"
    here.wait_for(lambda: journal.is_file() and journal.stat().st_size > 0)
    flight.send_signal(signal.SIGINT)
    n_flown, _, is_interrupted = flown(flight)
    assert is_interrupted
    assert len(rows_of(folder / "interrupted")) == n_flown
    for node in nodes:
        node.wait_for(lambda node=node: not node.pids("RayWorker") and not node.pids("bench.execution.worker"))


@pytest.mark.soak
def test_a_node_with_other_software_is_refused(nodes: tuple[Node, Node], suite: Path, folder: Path) -> None:
    """The sentence names the node, what is expected, what was found, and what to do."""
    here, there = nodes
    changed = folder / "changed.py"
    original = Path(kernel_cache.__file__)
    changed.write_text(original.read_text() + "\nA_CHANGE = True\n")
    other = replace(there, hides=f"{there.hides} && mount --bind {changed} {original}")
    other.start_ray(f"--address={ADDRESS}", ray="other")
    flight = here.fly(suite, folder / "refused", ADDRESS)
    text, _ = flight.communicate(timeout=PROCESS_S)
    assert flight.returncode == 1
    assert text.startswith(f"UsageError: --ray {ADDRESS}: expected on node {there.address} the same software as here")
    assert "Install there what is installed here" in text


def test_an_address_without_a_cluster_is_reported(nodes: tuple[Node, Node], suite: Path, folder: Path) -> None:
    """One sentence, and no page of Ray's."""
    here, _ = nodes
    flight = here.fly(suite, folder / "nowhere", "10.214.9.1:6399")
    text, _ = flight.communicate(timeout=PROCESS_S)
    assert flight.returncode == 1
    assert text.startswith("UsageError: --ray 10.214.9.1:6399: expected auto, local, or the host:port of a Ray cluster")
    assert "nobody listens there" in text
    assert len(text) < 1000


def test_a_cluster_of_this_machine_alone_begins_and_ends_with_the_pool(
    nodes: tuple[Node, Node], suite: Path, folder: Path, flown_here: Path
) -> None:
    """`local` flies the same, and leaves neither a process nor a file in the home folder."""
    here, _ = nodes
    before = set(here.pids())
    assert flown(here.fly(suite, folder / "local", "local")) == [N_TRIALS, 0, False]
    assert rows_of(folder / "local") == rows_of(flown_here)
    here.wait_for(lambda: set(here.pids()) <= before)
    assert not (here.folder / ".ray").exists()
