"""Whatever the files of a run, of results or of an environment hold, commands say what is wrong in one sentence.

Files are damaged in the ways of hosts that lie, disks that lose bytes and people who edit. Each command of the command
line that reads folders is called with each of them, and none ends in a traceback.
"""

import contextlib
import copy
import io
import json
import os
import re
import shutil
import socket
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gslcosim.base.errors import ExitCode
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.cli.arguments import iterate_commands
from gslcosim.cli.main import list_groups, main
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.runtime.status import get_status_folder
from gslcosim.scenario import load_scenario
from gslcosim_archive.signing.keys import write_key
from gslcosim_archive.signing.signed_results import sign_results
from gslcosim_archive.signing.submission_log import add_submission
from gslcosim_bench.store import Journal, ResultsFolder

GROUPS = list_groups()

RUN_FILES = (
    "manifest.json", "result.json", "setup.json", "digest.json", "inputs.log", "machine.log", "scenario.yaml",
    "recording.rrd",
)  # fmt: skip
RESULT_FILES = ("manifest.json", "maps.json", "rows.jsonl", "suite.yaml", "trials.parquet", "tracks.parquet")
ENVIRONMENT_FILES = ("environment.yaml", "occupancy.npy", "wind.npy")
SIGNED_FILES = (
    "manifest.json", "maps.json", "suite.yaml", "trials.parquet", "tracks.parquet", "signed.json", "signed.json.sig",
    "recordings/key", "recordings/log.jsonl",
)  # fmt: skip
SWEEP_FILES = (*RESULT_FILES, "sweep.json", "sweep.csv")
TUNING_FILES = (
    "study.log", "tuning.json", "tuning.csv",
    *(f"{part}/{name}" for part in ("training", "validation") for name in RESULT_FILES),
)  # fmt: skip
TRAINING_FILES = ("checkpoint.npz", "curves.json", "policy.npz")
VARIED = ["tiny_room", "--entry", "dung_beetle", "--jobs", "1", "--json"]
# How commands that read folders are called: RUN is the damaged run, OTHER a whole one beside it.
CALLS = {
    "runs": ["runs", "RUNS"],
    "runs --json": ["runs", "RUNS", "--json"],
    "runs of results": ["runs", "RESULTS", "RUNS"],
    "runs remove": ["runs", "remove", "RUNS", "--where", "state=broken"],
    "runs repair": ["runs", "repair", "RUNS"],
    "compare": ["compare", "RUN", "OTHER"],
    "replay": ["replay", "RUN", "--until", "0.1", "--quiet", "--runs-dir", "OUT"],
    "fork": ["fork", "RUN", "--at", "0.2", "--in-process", "--quiet", "--runs-dir", "OUT"],
    "extract": ["extract", "RUN", "--to", "csv", "--out", "OUT"],
    "film": ["film", "RUN", "--out", "OUT.gif", "--plan-only", "--size", "320x240"],
    "plot": ["plot", "RUN", "--out", "OUT", "--figure", "distance"],
    "plot of results": ["plot", "RESULTS", "--out", "OUT"],
    "view": ["view", "RUN", "--at", "0.2"],
    "view of several": ["view", "RUN", "OTHER"],
    "view of an environment": ["view", "ENVIRONMENT"],
    "sample": ["environment", "sample", "RUN", "--time", "0.2", "--grid", "1.0", "--out", "OUT.csv"],
    "sample of an environment": ["environment", "sample", "ENVIRONMENT", "--quantity", "wind", "--time", "0",
                                 "--grid", "1.0", "--out", "OUT.csv"],
    "export": ["environment", "export", "ENVIRONMENT", "--to", "stl", "--out", "OUT"],
    "bench report": ["bench", "report", "RESULTS"],
    "bench status": ["bench", "status", "RESULTS"],
    "bench show": ["bench", "show", "RESULTS", "--trial", "TRIAL", "--no-view", "--trusted"],
    "bench verify": ["bench", "verify", "RESULTS", "--sample", "1", "--jobs", "1", "--trusted"],
    "bench verify of a signature": ["bench", "verify", "SIGNED", "--signature-only"],
    "bench sign": ["bench", "sign", "SIGNED", "--key", "SIGNED/recordings/key"],
    "bench rank": ["bench", "rank", "RESULTS"],
    "bench site": ["bench", "site", "RESULTS", "--out", "OUT"],
    "bench rank of signed results": ["bench", "rank", "SIGNED", "--log", "SIGNED/recordings/log.jsonl"],
    "bench log": ["bench", "log", "SIGNED/recordings/log.jsonl"],
    "bench audit": ["bench", "audit", "SIGNED", "--log", "SIGNED/recordings/log.jsonl", "--beacon", "x",
                    "--sample", "1", "--jobs", "1", "--trusted"],
    "bench merge": ["bench", "merge", "SHARD", "--out", "OUT"],
    "bench run": ["bench", "run", "smoke", "--results", "RESULTS", "--only", "trial=none"],
    "import": ["environment", "import", "ENVIRONMENT", "--out", "OUT"],
    "import-flight": ["runs", "import", "RUN", "--scenario", "tiny_room", "--runs-dir", "OUT"],
    "join": ["join", "JOIN/fields.json", "--quiet"],
    "join as an agent": ["join", "--quiet", "JOIN/beetle.json", "agent", "true"],
    "join at the gateway": ["join", "--quiet", "JOIN/ant.json", "agent", "true"],
    "sweep": ["bench", "sweep", *VARIED, "--repetitions", "1", "--vary", "leg_m=0.4,0.8", "--results", "SWEEP"],
    "tune": ["bench", "tune", *VARIED, "--range", "leg_m=0.2:2.0", "--budget", "4", "--flights-per-setting", "1",
             "--results", "TUNING"],
    "train --resume": ["train", "TRAIN_FILE", "--out", "TRAINING", "--resume", "--record", "0", "--json"],
}  # fmt: skip
# As `gslcosim up` writes them, of a run that is over.
JOIN_FILES = {
    "fields.json": {"name": "fields", "endpoint": "tcp/127.0.0.1:9", "namespace": "gsl/x", "user": "service",
                    "password": "p", "run_dir": "/nowhere/x", "lease_s": 15.0, "window_ticks": 256,
                    "mesh": {"listen": "tcp/127.0.0.1:9", "connect": []}},
    "beetle.json": {"name": "beetle", "endpoint": "tcp/127.0.0.1:9", "namespace": "gsl/x", "user": "agent_beetle",
                    "password": "p", "agents": ["beetle", "ant"], "tls_root_ca": "PEM", "needs_tls_client": False},
    "ant.json": {"name": "ant", "gateway": "tcp:127.0.0.1:9", "token": "t", "format": "json", "agents": ["ant"]},
}  # fmt: skip
# A learner that needs no package of its own, and next to no budget.
TRAIN_FILE = """schema: gslcosim/train/1
name: small
family: open_halls
trainer: {kind: table, rounds: 2, searches: 4, steps_per_round: 4, gas_cuts: [0.1], since_cuts: [1]}
action: {kind: heading, step_m: 2, hold_s: 0}
seed: 1
cases: {training: 2, validation: 2}
validate_every: 1
"""
# Optuna comes with the extra `tune`.
ALL_CALLS = [pytest.param(call, marks=pytest.mark.extras) if call == "tune" else call for call in CALLS]
# Each other command, and why no foreign folder makes it fail.
OTHERS = {
    "up": "reads a scenario: tests/properties/test_scenario_problems.py",
    "fly": "the same, and demands a terminal",
    "step": "the same",
    "validate": "the same",
    "environment generate": "the same",
    "bench dataset": "reads rows as bench report does, of finished results: extensions/archive/tests/unit/dataset",
    "bench place": "reads rows as bench report does, and flies for each damage",
    "bench failures": "reads rows as bench run and tune do, and flies too much for each damage",
    "list": "reads what is installed",
    "schema": "writes files of the contract",
    "doctor": "looks at the machine",
    "completion": "prints a script",
    "cache": "lists a folder of our own by names and sizes",
    "agent check": "starts a program",
    "agent new": "writes a folder",
    "participant check": "starts a program",
    "participant new": "writes a folder",
    "runs active": "asks sockets: test_active_runs_report_anything",
    "runs top": "the same",
    "runs stop": "the same",
    "bench list": "reads what is installed",
    "bench keygen": "writes two files",
    "bench seal": "reads a suite and writes two files",
    "bench reveal": "reads two small files: extensions/archive/tests/unit/test_sealing.py",
    "bench pack": "reads a folder of one's own: extensions/bench/tests/unit/cases/test_submission_bundles.py",
    "reality": "reads measured data: extensions/validation/tests/unit/test_readers.py",
    "bench plan": "reads a suite",
}
# What stops a call on a machine without a screen, and those that name a folder of another kind; its files are read
# before.
REFUSED = {
    "view": "viewer: expected a screen", "view of several": "viewer: expected a screen",
    "view of an environment": "viewer: expected a screen", "import": "expected", "import-flight": "expected",
    "join": "expected the run's router",
}  # fmt: skip

# What paths, numbers, tables and writers stumble over.
ODD = (
    None, True, -1, 0, 1e308, 10**18, -(10**18), 0.5, "", "x", "\x1b]0;owned\x07", "[red]", "a\0b", "x" * 5000,
    "/dev/zero", "../../..", "\ud800", [], {}, [[]], [None], [{}], {"": None}, ["x"] * 3, {"tick": 1}, {"a": {"b": []}},
)  # fmt: skip
WHOLE = (
    b"", b"null", b"[]", b"{}", b"3", b'"x"', b"[" * 100_000, b'{"a":' * 2000, b"\xff\xfe\x00", b"9" * 5000, b"NaN",
    b"{" + b'"a": 1, ' * 3, b"\x80\x04]q\x00.", b"- " * 3000, b"&a [*a]", b"a: " + b"x" * 100_000,
)  # fmt: skip


def paths_in(value, at=()):
    """Yield the keys and indices that lead to each value of a tree."""
    yield at
    inner = value.items() if isinstance(value, dict) else enumerate(value[:3]) if isinstance(value, list) else ()
    for key, item in inner:
        yield from paths_in(item, (*at, key))


def changed(data, value):
    """Return plain values with one of them replaced or taken away."""
    at = data.draw(st.sampled_from(list(paths_in(value))))
    if not at:
        return data.draw(st.sampled_from(ODD))
    value = copy.deepcopy(value)
    block = value
    for key in at[:-1]:
        block = block[key]
    if data.draw(st.booleans()):
        block[at[-1]] = data.draw(st.sampled_from(ODD))
    else:
        del block[at[-1]]
    return value


def damaged(data, content, name):
    kinds = ["whole", "cut", "flipped"]
    if name.endswith((".json", ".jsonl", ".log", ".yaml")) or name == "checkpoint.npz":
        kinds += ["values"] * 4
    match data.draw(st.sampled_from(kinds)):
        case "whole":
            return data.draw(st.sampled_from(WHOLE))
        case "cut":
            return content[: data.draw(st.integers(0, max(0, len(content) - 1)))]
        case "flipped":
            at = data.draw(st.integers(0, max(0, len(content) - 1)))
            return content[:at] + data.draw(st.binary(max_size=4)) + content[at + 1 :]
    if name.endswith(".yaml"):
        return json.dumps(changed(data, yaml.load(content, Loader=CoreLoader)), default=str).encode()
    if name.endswith(".json"):
        return json.dumps(changed(data, json.loads(content))).encode()
    if name == "checkpoint.npz":
        return changed_checkpoint(data, content)
    lines = content.splitlines()
    i = data.draw(st.integers(0, len(lines) - 1))
    lines[i] = json.dumps(changed(data, json.loads(lines[i]))).encode()
    return b"\n".join(lines) + b"\n"


def changed_checkpoint(data, content):
    """Return a checkpoint with another array, or with other words about it; whole as a file."""
    arrays = dict(np.load(io.BytesIO(content)))
    name = data.draw(st.sampled_from(["about"] * len(arrays) + list(arrays)))
    if name == "about":
        told = json.loads(str(arrays[name][()]))
        told["about"] = changed(data, told["about"])
        arrays[name] = np.array(json.dumps(told))
    elif data.draw(st.booleans()):
        arrays[name] = data.draw(st.sampled_from([np.array("x"), np.zeros(0), np.full((2, 2), np.nan), np.array(-1)]))
    else:
        del arrays[name]
    written = io.BytesIO()
    np.savez_compressed(written, **arrays)
    return written.getvalue()


def damage(data, path):
    """Change a file, or put something in its place that is none."""
    match data.draw(st.sampled_from(["bytes"] * 8 + ["gone", "folder", "pipe", "loop"])):
        case "bytes":
            path.write_bytes(damaged(data, path.read_bytes(), path.name))
            return
        case kind:
            path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "loop":
        path.symlink_to(path.name)


def answer_to(words):
    """Return the exit code of a command, and what it wrote to stdout and stderr."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    return code, out.getvalue(), err.getvalue()


def check_answer(words, code, out, err):
    """Hold what a command has answered to a damaged file against what every command promises."""
    text = f"{' '.join(words)} returned {code}:\n{err[-3000:]}"
    assert code in set(ExitCode) - {ExitCode.INTERRUPTED}, text
    assert "Traceback" not in out + err, text
    assert "the machine: expected it to do what was asked" not in err, text
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", out + err), text
    if code == ExitCode.USAGE:
        assert "expected" in err or err.startswith("No single active run"), text
        assert len(err) < 3000, text


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a short run, another that is the same, results of a suite, an environment, and join files."""
    root = tmp_path_factory.mktemp("whole")
    limit = ["--set", "referee.stop.time_limit_s=1", "--set", "agents[0].vehicle.start_m=[5.5,4.5,1]"]
    with contextlib.chdir(root):
        assert main(["up", "tiny_room", "--in-process", "--quiet", *limit]) in (0, 1)
        (run,) = Path("runs").iterdir()
        run.rename("runs/damaged")
        shutil.copytree("runs/damaged", "runs/other")
        assert main(["bench", "run", "smoke", "--jobs", "1", "--only", "entry=oracle", "--only", "repetition=0"]) == 0
        assert main(["bench", "run", "smoke", "--shard", "1/1", "--jobs", "1", "--only", "entry=oracle"]) == 0
    signed = shutil.copytree(root / "results" / "smoke", root / "results" / "signed")
    # Not part of what is signed, so that whole ones are.
    write_key(signed / "recordings" / "key", "")
    add_submission(
        signed / "recordings" / "log.jsonl",
        sign_results(signed, signed / "recordings" / "key", author="", signed_at=""),
    )
    for name in ("smoke", "smoke-1-of-1"):
        _write_rows(root / "results" / name)
    environment = prepare_environment(load_scenario("tiny_room").scenario, scenario_dir=root)
    shutil.copytree(environment, root / "environment")
    (root / "join").mkdir()
    for name, fields in JOIN_FILES.items():
        (root / "join" / name).write_text(json.dumps(fields))
    (root / "small.train.yaml").write_text(TRAIN_FILE)
    return root


MADE_BY_ITSELF = {"sweep": "swept", "tune": "tuned", "train --resume": "trained"}


def with_own_folder(call, whole):
    """Return the folder with what a command has left that goes on from it, made at its first use."""
    if call in MADE_BY_ITSELF and not (whole / MADE_BY_ITSELF[call]).exists():
        words = [word for word in words_of(call, whole) if word != "--resume"]
        assert main(words) in (0, 1)
        if call != "train --resume":
            for folder in (whole / MADE_BY_ITSELF[call]).rglob("trials.parquet"):
                _write_rows(folder.parent)
    return whole


# As they stand while a suite is flown.
def _write_rows(folder):
    results = ResultsFolder(folder)
    entries = results.entries()
    with Journal(results.journal) as journal:
        for entry in entries.values():
            journal.append(entry)


def words_of(call, root):
    """Return the words of a call with the folders below a root in place of their names."""
    places = {
        "RUNS": root / "runs", "RUN": root / "runs" / "damaged", "OTHER": root / "runs" / "other",
        "RESULTS": root / "results" / "smoke", "ENVIRONMENT": root / "environment", "OUT": root / "out",
        "JOIN": root / "join", "SWEEP": root / "swept", "TUNING": root / "tuned", "TRAINING": root / "trained",
        "TRAIN_FILE": root / "small.train.yaml", "SHARD": root / "results" / "smoke-1-of-1",
        "SIGNED": root / "results" / "signed",
    }  # fmt: skip
    recorded = [path.name for path in (root / "results" / "smoke" / "recordings").iterdir()]
    places |= {"TRIAL": recorded[0]}
    return [re.sub("^[A-Z_]{3,}", lambda found: str(places[found[0]]), word) for word in CALLS[call]]


def files_of(call, root):
    """Return the files that a call may read."""
    words = " ".join(CALLS[call])
    files = [root / "join" / word.partition("/")[2] for word in CALLS[call] if word.startswith("JOIN/")]
    files += [root / "swept" / name for name in SWEEP_FILES if "SWEEP" in words]
    files += [root / "tuned" / name for name in TUNING_FILES if "TUNING" in words]
    files += [root / "trained" / name for name in TRAINING_FILES if "TRAINING" in words]
    files += [root / "runs" / "damaged" / name for name in RUN_FILES if "RUN" in words]
    files += [root / "results" / "smoke" / name for name in RESULT_FILES if "RESULTS" in words]
    files += [root / "results" / "smoke-1-of-1" / name for name in (*RESULT_FILES, "shard.json") if "SHARD" in words]
    files += [root / "results" / "signed" / name for name in SIGNED_FILES if "SIGNED" in words]
    files += [root / "environment" / name for name in ENVIRONMENT_FILES if "ENVIRONMENT" in words]
    return [path for path in files if path.is_file()]


@pytest.mark.slow
@pytest.mark.parametrize("call", ALL_CALLS)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_a_damaged_file_is_reported_in_one_sentence(whole, tmp_path_factory, call, data):
    root = tmp_path_factory.mktemp("damaged")
    shutil.copytree(with_own_folder(call, whole), root, dirs_exist_ok=True)
    path = data.draw(st.sampled_from(files_of(call, root)))
    damage(data, path)
    words = words_of(call, root)
    code, out, err = answer_to(words)
    check_answer(words, code, out, err)
    if words[0] == "runs" and words[1] not in ("remove", "repair", "import"):
        assert code == 0, err
        assert "other" in out
    shutil.rmtree(root)


@pytest.mark.slow
@pytest.mark.parametrize("call", ALL_CALLS)
def test_whole_files_are_read(whole, tmp_path_factory, call):
    """So that none of the calls above is refused for what is the same in all of them."""
    root = tmp_path_factory.mktemp("same")
    shutil.copytree(with_own_folder(call, whole), root, dirs_exist_ok=True)
    words = words_of(call, root)
    code, _, err = answer_to(words)
    if call in REFUSED:
        assert REFUSED[call] in err
    else:
        assert code in (ExitCode.SUCCESS, ExitCode.AGENT_FAILED, ExitCode.DIVERGENCE), err


def test_each_command_reads_no_folder_or_is_called_here():
    """Whoever adds a command says here how it is called with a folder, or why it reads none."""
    paths = dict(iterate_commands(GROUPS))
    leaves = {" ".join(path) for path in paths}
    called = {" ".join(words[:2] if tuple(words[:2]) in paths else words[:1]) for words in CALLS.values()}
    called = {"runs list" if name == "runs" else name for name in called}
    text = called | OTHERS.keys()
    assert leaves == text
    assert not called & OTHERS.keys()


STATUS = {
    **dict.fromkeys(("run_id", "run_dir", "processes", "began_at", "state", "text"), "x"),
    **dict.fromkeys(("wall_s", "sim_time_s", "time_limit_s", "real_time_factor"), 1.0),
    "participants": [
        {"name": "world", "state": "working", "tick": 1, "waits_for": ["x"], "queued_ticks": 0, "pid": None,
         "cpu_s": None, "memory_bytes": 1, "n_resends": 0}
    ],
    "stall": "",
}  # fmt: skip


@pytest.mark.slow
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_active_runs_report_anything(status_socket, data):
    """Whoever of the user listens there is asked; one that answers with something else hides no other."""
    kind = data.draw(st.sampled_from(["values", "values", "values", "whole"]))
    status_socket.answer = (
        data.draw(st.sampled_from(WHOLE)) if kind == "whole" else json.dumps(changed(data, STATUS)).encode()
    )
    for words in (
        ["runs", "active"],
        ["runs", "active", "--json"],
        ["runs", "top", "--once", "--every", "0.1"],
        ["runs", "stop", "none_of_them"],
    ):
        code, out, err = answer_to(words)
        check_answer(words, code, out, err)


class StatusSocket:
    """A socket that answers anyone who connects, where flights are looked for."""

    def __init__(self, path):
        self.answer = b""
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen()
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self):
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _serve(self):
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                with connection, contextlib.suppress(OSError):
                    connection.sendall(self.answer)


@pytest.fixture
def status_socket(monkeypatch):
    # The path of a socket has at most 107 bytes, which folders of tests may have by themselves.
    with tempfile.TemporaryDirectory() as scratch:
        monkeypatch.setattr("tempfile.tempdir", scratch)
        folder = get_status_folder()
        folder.mkdir(mode=0o700)
        opened = StatusSocket(folder / f"{os.getpid()}-a.flight")
        yield opened
        opened.close()
