"""Agents that try to cheat: each attack once in each sandbox, and what remains when there is none.

`make attacks` prints the table of attacks and sandboxes; it stands in docs/reliability.md.
"""

import contextlib
import ctypes
import json
import os
import re
import secrets
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import zipfile
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import yaml
from crowd import OTHER_RUNS, crowded
from fan_units import build_fan
from ordinary_user import run_tests_as_ordinary_user
from real_runs import AGENTS, ROOT, TINY_ROOM, fly_command, fly_here

from gslcosim.base.bundled import bundled_agents
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.runtime.processes.sandbox import selection
from gslcosim.runtime.processes.sandbox.selection import unavailable_reason

REQUIRED, PIPED = "agents[0].sandbox=required", "agents[0].start.door=stdio"
SANDBOXES = ("bubblewrap", "landlock")
BUBBLEWRAP = pytest.param("bubblewrap", marks=pytest.mark.debian)
ATTACKS = re.findall(r"^def ([a-z]\w+)\(\):", (AGENTS / "attacker.py").read_text(), re.MULTILINE)
SECRET, SECRET_ARGUMENT = "GSLCOSIM_JOIN_of_another=password", "gas.sources-are-at-1-2-3"
VICTIM = """
import ctypes, os, sys
kept = ctypes.create_string_buffer(b"password in memory", 64)
print(ctypes.addressof(kept), flush=True)
sys.stdin.read()
"""
CARD = (AGENTS.parents[2] / "agents" / "dung_beetle" / "method.yaml").read_text()
# Landlock knows neither unix sockets that have a path nor how much is written, so docs/reliability.md says it.
# Nor when a file was read, which the system notes where its file system says so.
KNOWN_GAPS = {
    ("landlock", "connect_to_unix_socket_of_others"),
    ("landlock", "fill_the_disk"),
    ("landlock", "leave_times_of_access"),
}
# What others refuse, whatever an agent is started in: the router, the launcher that ends its descendants, and root's
# absence of a mask to take away.
REFUSED_ANYWAY = {
    "join_as_a_service",
    "leave_a_daemon_behind",
    "reopen_inherited_files",
    "read_environment_of_the_user",
}
TOKEN_NAME = "TOKEN_OF_THE_USER"
# What nobody but root may do, or where settings of the kernel say so, so that it proves nothing for others.
ONLY_ROOT = {
    "use_rights_of_root",
    "change_settings_of_the_kernel",
    "read_log_of_the_kernel",
    "read_private_files_of_the_system",
    "watch_others_by_perf",
    "change_rights_of_devices",
}


@dataclass
class Attacked:
    """What is left after a run with the attacker."""

    reached: dict[str, str]
    result: dict
    written: dict
    outside: Path
    was_victim_signalled: bool


def attacked(folder: Path, sandbox: str) -> Attacked:
    """Fly with the attacker, its program beside the scenario and the runs: the arrangement that helps it most.

    Two other runs go on beside it, and are as they were in the end.
    """
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    work, outside = folder / "work", folder / "outside"
    work.mkdir(parents=True)
    outside.mkdir()
    for name in ("attacker.py", "raw.py"):
        shutil.copy(AGENTS / name, work)
    scenario = work / "room.yaml"
    shutil.copy(TINY_ROOM, scenario)
    for name in ("victim.txt", "removable.txt"):
        (outside / name).write_text("kept")
    for name in ("results/suite.yaml", "results/manifest.json", "results/rows.jsonl", "hall/environment.yaml",
                 "hall/occupancy.npy"):  # fmt: skip
        (work / name).parent.mkdir(exist_ok=True)
        (work / name).write_text("the source is at 1 2 3")
    for name in ("notes.txt", "room.yaml.orig", "a/b/c/d/e/f/deep.json", "earlier.rrd", ".git/objects/ab/cdef"):
        (work / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(TINY_ROOM, work / name)
    (work / "unread.py").write_text("of nobody")
    (work / "kept_recording").write_bytes(b"RRF2 the source is at 1 2 3")
    (work / "old").mkdir()
    (work / "old" / "lookup.txt").write_text('"tick","time_s","x_m","y_m","z_m","sigma_m"\n1,0.1,1,2,3,0.1\n')
    np.savez(work / "old" / "weights.npz", mixing_ratio_ppm=np.ones(9), x_m=[1], y_m=[2], z_m=[3])
    (work / "dictionary.json").write_text('{\n  "run_id": "tiny_room-seed1",\n  "scenario": "tiny_room",\n  "seed": 1}')
    for name in ("linked", "linked.py"):
        os.link(scenario, work / name)
    (work / "named.py").symlink_to(scenario)
    (work / "package").symlink_to(work / "results")
    with zipfile.ZipFile(work / "old" / "run.zip", "w") as archive:
        archive.write(scenario, "scenario.yaml")
    (work / "plot.png").write_bytes(b"\x89PNG the source is at 1 2 3")
    shutil.copy(TINY_ROOM, work / "renamed.yaml")
    (work / "method.yaml").write_text(CARD)
    with contextlib.ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, {TOKEN_NAME: "secret"}))
        crowd = stack.enter_context(crowded(work))
        victim, address = stack.enter_context(_victim())
        terminal = stack.enter_context(_terminal())
        key = stack.enter_context(_key())
        ports = stack.enter_context(_listening(outside))
        shared = stack.enter_context(_shared_memory())
        attacks = {
            "runs": str(work / "runs"),
            "outside": str(outside),
            "scenario": str(scenario),
            "bundled": str(TINY_ROOM),
            "cache": str(get_cache_root()),
            "kernels": os.environ["NUMBA_CACHE_DIR"],
            "victim": victim.pid,
            "address": address,
            "terminal": terminal,
            "key": key,
            "secret": SECRET.partition("=")[2],
            "tnemugra": SECRET_ARGUMENT[::-1],
            "temporary": tempfile.gettempdir(),
            "token_name": TOKEN_NAME,
            "has_private_folder": sandbox == "bubblewrap",
            "other_runs": crowd.pids,
            "private_files": ["/etc/shadow", "/etc/gshadow", *map(str, Path("/etc/ssl/private").glob("*.key"))],
            "runs_of_others": [str(work / name) for name in OTHER_RUNS],
            **ports,
            **shared,
        }
        # A word that names a bundled agent once made the cache of kernels writable.
        words = [str(bundled_agents()["dung_beetle"])]
        start_by = {"command": [sys.executable, str(work / "attacker.py"), json.dumps(attacks), *words]}
        loader = {"LD_DEBUG": "statistics", "LD_DEBUG_OUTPUT": str(outside / "loader")}
        changes = (
            "--set", f"agents[0].start={json.dumps(start_by)}",
            "--set", f"agents[0].sandbox={sandbox}",
            "--set", f"agents[0].environment={json.dumps(loader)}",
        )  # fmt: skip
        ended = fly_command(scenario, work / "runs", *changes, "--set", "referee.stop.time_limit_s=6")
        was_victim_signalled = victim.poll() is not None
        is_memory_left = ctypes.CDLL(None).shmget(shared["system_v_left"], 64, 0) >= 0
        crowd.end()
    assert ended.result.get("valid") is True, (ended.errors, ended.result)
    lines = (ended.run_dir / "logs" / "agent_beetle.log").read_text().splitlines()
    attacks = [json.loads(line) for line in lines if line.startswith('{"attack"')]
    reached = {line["attack"]: line["reached"] for line in attacks}
    assert "leave_a_daemon_behind" in reached, (sandbox, ended.result, "\n".join(lines)[-1500:])
    # In a namespace of its own it is made, and gone with it.
    reached["leave_system_v_memory_behind"] *= is_memory_left
    reached["write_by_variables_of_the_loader"] *= any(outside.glob("loader.*"))
    return Attacked(
        reached=reached,
        result=ended.result,
        written=json.loads((ended.run_dir / "result.json").read_text()),
        outside=outside,
        was_victim_signalled=was_victim_signalled,
    )


@contextlib.contextmanager
def _shared_memory():
    """Memory, a queue and a semaphore of System V, a queue of POSIX and a socket of netlink of other programs."""
    library, key, left = ctypes.CDLL(None, use_errno=True), *(secrets.randbelow(1 << 30) + 1 for _ in range(2))
    library.shmat.restype = ctypes.c_void_p
    make, remove, set_value = 0o1600, 0, 16
    memory, queue, semaphore = library.shmget(key, 64, make), library.msgget(key, make), library.semget(key, 1, make)
    place = library.shmat(memory, None, 0)
    ctypes.memmove(place, SECRET.encode(), 32)
    library.shmdt(ctypes.c_void_p(place))
    text = struct.pack("l32s", 1, SECRET.encode())
    for _ in range(2):
        library.msgsnd(queue, text, 32, 0)
    library.semctl(semaphore, 0, set_value, 7)
    name = f"/gslcosim-test-{key}"
    posix = library.mq_open(name.encode(), os.O_CREAT | os.O_RDWR, 0o600, None)
    try:
        with socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, socket.NETLINK_USERSOCK) as netlink:
            netlink.bind((0, 0))
            yield {
                "system_v_key": key, "system_v_left": left, "posix_queue": name, "netlink": netlink.getsockname()[0],
            }  # fmt: skip
    finally:
        os.close(posix)
        library.mq_unlink(name.encode())
        library.msgctl(queue, remove, None)
        library.semctl(semaphore, 0, remove)
        for found in (memory, library.shmget(left, 64, 0)):
            library.shmctl(found, remove, None)


@contextlib.contextmanager
def _victim():
    environment = os.environ | dict([SECRET.split("=")])
    program = [sys.executable, "-c", VICTIM, SECRET_ARGUMENT]
    memory = os.memfd_create("secret", 0)
    os.write(memory, SECRET.encode())
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    process = subprocess.Popen(program, **pipes, env=environment, pass_fds=(memory,), start_new_session=True)
    os.close(memory)
    try:
        yield process, int(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()


@contextlib.contextmanager
def _terminal():
    ours, theirs = os.openpty()
    try:
        yield os.ttyname(theirs)
    finally:
        os.close(ours)
        os.close(theirs)


@contextlib.contextmanager
def _key():
    """A key of the user in the kernel, as tickets and passwords of disks are."""
    add_key, keyctl = (217, 219) if os.uname().machine == "aarch64" else (248, 250)
    invalidate, user_keyring = 21, ctypes.c_long(-4)
    library = ctypes.CDLL(None)
    name = f"gslcosim-test-{os.getpid()}"
    key = library.syscall(add_key, b"user", name.encode(), SECRET.encode(), ctypes.c_long(len(SECRET)), user_keyring)
    try:
        yield name
    finally:
        library.syscall(keyctl, ctypes.c_long(invalidate), ctypes.c_long(key))


@contextlib.contextmanager
def _listening(folder: Path):
    name = f"gslcosim-test-{os.getpid()}-{folder.parent.name}"
    with (
        socket.create_server(("127.0.0.1", 0)) as tcp,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
        socket.socket(socket.AF_UNIX) as abstract,
        socket.socket(socket.AF_UNIX) as unix,
    ):
        udp.bind(("127.0.0.1", 0))
        abstract.bind("\0" + name)
        abstract.listen()
        unix.bind(str(folder / "s"))
        unix.listen()

        def answer():
            with contextlib.suppress(OSError):
                _, sender = udp.recvfrom(1)
                udp.sendto(b"!", sender)

        answering = threading.Thread(target=answer)
        answering.start()
        port = udp.getsockname()[1]
        try:
            yield {
                "tcp_port": tcp.getsockname()[1], "udp_port": port, "abstract": name, "unix": str(folder / "s"),
            }  # fmt: skip
        finally:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
                last.sendto(b".", ("127.0.0.1", port))
            answering.join()


@pytest.fixture(scope="module", params=[BUBBLEWRAP, "landlock"])
def in_sandbox(request, tmp_path_factory):
    return request.param, attacked(tmp_path_factory.mktemp(request.param) / "x", request.param)


@pytest.mark.parametrize("attack", ATTACKS)
def test_an_attack_does_not_get_through(in_sandbox, attack):
    sandbox, after = in_sandbox
    if (sandbox, attack) in KNOWN_GAPS:
        assert attack.replace("_", " ") in (ROOT / "docs" / "reliability.md").read_text()
    else:
        assert after.reached[attack] == ""


def test_the_run_is_as_if_nothing_had_been_tried(in_sandbox):
    """The result says the sandbox, stays as it was written, and what belongs to others is whole."""
    sandbox, after = in_sandbox
    assert after.result["sandboxes"]["beetle"].startswith(sandbox)
    assert after.result["end_reason"] == "time_limit"
    assert after.result["faults"] == []
    assert after.written == after.result
    assert sorted(path.name for path in after.outside.iterdir()) == ["removable.txt", "s", "victim.txt"]
    assert not after.was_victim_signalled


def test_without_a_sandbox_the_same_attacks_do_get_through(tmp_path):
    """Otherwise the attacks would prove nothing; the result says that there was none."""
    after = attacked(tmp_path / "x", "none")
    refused = {name for name, evidence in after.reached.items() if not evidence}
    assert refused - (ONLY_ROOT if os.geteuid() else set()) == REFUSED_ANYWAY
    assert after.result["sandboxes"] == {"beetle": "none"}
    assert after.written == after.result


@pytest.mark.soak
def test_the_table_of_attacks(tmp_path, capsys):
    """Printed for docs/reliability.md, which has the same rows."""
    after = {sandbox: attacked(tmp_path / sandbox, sandbox) for sandbox in (*SANDBOXES, "none")}
    rows = [
        f"| {attack.replace('_', ' ')} | "
        + " | ".join(_outcome(attack, each.reached[attack], sandbox) for sandbox, each in after.items())
        + " |"
        for attack in ATTACKS
    ]
    table = "\n".join([f"| attack | {' | '.join(after)} |", "|---|---|---|---|", *rows])
    with capsys.disabled():
        sys.stdout.write(f"\n{table}\n")
    assert table in (ROOT / "docs" / "reliability.md").read_text()


# The same words whoever flies it, so that one table holds for root and for others.
def _outcome(attack, evidence, sandbox):
    if attack in ONLY_ROOT and sandbox == "none" and (evidence or os.geteuid() != 0):
        return "got through as root"
    return "got through" if evidence else "refused"


@pytest.mark.soak
@pytest.mark.debian
@pytest.mark.timeout(1800)
def test_the_table_of_attacks_holds_for_an_ordinary_user(capsys):
    ran = run_tests_as_ordinary_user(__file__, "-k", "test_the_table_of_attacks and not ordinary", limit_s=1200)
    with capsys.disabled():
        sys.stdout.write(ran.stdout)
    assert ran.returncode == 0
    assert "1 passed" in ran.stdout


def flown_with(tmp_path, program, sandbox, limits):
    """Fly an agent without Zenoh that runs a program of its own, bounded, and return its faults."""
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    start_by = {"command": [sys.executable, "-c", program], "door": "stdio", "format": "json"}
    ended = fly_here(
        TINY_ROOM,
        tmp_path,
        "--set", f"agents[0].start={json.dumps(start_by)}",
        "--set", f"agents[0].sandbox={sandbox}",
        "--set", f"agents[0].limits={json.dumps(limits)}",
    )  # fmt: skip
    assert ended.result["end_reason"] == "agent_failed", (ended.errors, ended.result)
    assert ended.exit_code == 1
    return " ".join(fault["text"] for fault in ended.result["faults"])


SPINNING = "import os\nos.fork()\nwhile True: pass"
HOARDING = "hoard = []\nwhile True: hoard.append(bytearray(1 << 20))"
MULTIPLYING = "import os, time\nfor _ in range(9):\n  if not os.fork(): break\ntime.sleep(60)"
OPENING = "import sys\nkept = [open('/dev/null') for _ in range(100)]"


@pytest.mark.parametrize("sandbox", [BUBBLEWRAP, "landlock", "none"])
@pytest.mark.parametrize(
    ("program", "limits", "expected"),
    [
        (SPINNING, {"cpu_s": 1}, "used more than its limits.cpu_s of 1 s"),
        (HOARDING, {"memory_mb": 80}, "used more than its limits.memory_mb of 80 MB"),
        (MULTIPLYING, {"n_processes": 5}, "used more than its limits.n_processes of 5"),
        (OPENING, {"n_files": 32}, "Too many open files"),
    ],
    ids=["cpu_s", "memory_mb", "n_processes", "n_files"],
)
def test_to_reach_a_bound_is_the_agents_fault_with_its_number(tmp_path, program, limits, expected, sandbox):
    """All that an agent has started counts together; who opens too many files is stopped by the system."""
    text = flown_with(tmp_path, program, sandbox, limits)
    if "n_files" in limits:
        text = next(tmp_path.glob("*/logs/agent_beetle.log")).read_text()
    assert expected in text


@pytest.mark.parametrize("sandbox", [BUBBLEWRAP, "landlock", "none"])
@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("raise SystemExit(7)", "ended with exit code 7"),
        ("import os; os.kill(os.getpid(), 11)", "was killed by SIGSEGV"),
    ],
    ids=["code", "signal"],
)
def test_an_agents_end_is_reported_in_the_same_words_everywhere(tmp_path, program, expected, sandbox):
    """A signal is a signal, and a code a code, through the sandbox and the launcher."""
    assert expected in flown_with(tmp_path, program, sandbox, {})


def test_a_sandbox_that_the_machine_lacks_is_refused_before_the_run(tmp_path, monkeypatch):
    """Exit code 2, with the reason and what to do, and no run directory."""
    monkeypatch.setenv("PATH", str(tmp_path / "nothing_here"))
    ended = fly_command(TINY_ROOM, tmp_path / "runs", "--set", "agents[0].sandbox=bubblewrap")
    assert (ended.exit_code, ended.run_dir) == (2, None)
    expected = (
        "agents[0].sandbox: expected bubblewrap on this machine, was one where it does not work: bubblewrap is not"
    )
    assert expected in ended.errors


def test_a_required_sandbox_is_the_strongest_and_never_none(tmp_path, monkeypatch):
    """Where the machine has none, nothing is started."""
    ended = fly_here(TINY_ROOM, tmp_path / "there", "--set", REQUIRED, "--set", PIPED)
    assert ended.result["sandboxes"]["beetle"].startswith(selection.find_strongest_sandbox())
    monkeypatch.setattr(selection, "unavailable_reason", lambda kind: f"{kind} is away")
    refused = fly_here(TINY_ROOM, tmp_path / "gone", "--set", REQUIRED, "--set", PIPED)
    assert (refused.exit_code, refused.run_dir) == (2, None)
    expected = "agents[0].sandbox: expected a sandbox on this machine, was none. Bubblewrap is away; landlock is away."
    assert expected in refused.errors


def test_a_command_that_names_a_file_of_a_run_is_refused(tmp_path):
    """Files beside what a command names are seen: the truth would be."""
    run = tmp_path / "earlier" / "logs"
    run.mkdir(parents=True)
    for name in ("scenario.yaml", "manifest.json", "logs/world.log"):
        (run.parent / name).touch()
    start_by = {"command": ["cat", str(run / "world.log")], "door": "stdio"}
    words = ("--set", f"agents[0].start={json.dumps(start_by)}")
    ended = fly_here(TINY_ROOM, tmp_path / "runs", *words)
    assert ended.exit_code == 3
    assert "agents.beetle.start: expected a command that names no file of a run" in ended.errors
    allowed = fly_here(TINY_ROOM, tmp_path / "runs", *words, "--set", f"agents[0].may_read=[{run}]")
    assert allowed.exit_code == 1


def test_an_agent_that_fails_names_what_its_sandbox_hides(tmp_path):
    if reason := unavailable_reason("bubblewrap"):
        pytest.skip(f"bubblewrap cannot be tested here: {reason}")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "agent.py").write_text("open(__file__[:-8] + 'weights.npz')\n")
    (tmp_path / "mine" / "weights.npz").touch()
    start_by = {"command": [sys.executable, str(tmp_path / "mine" / "agent.py")], "door": "stdio"}
    failed = fly_here(TINY_ROOM, tmp_path / "runs", "--set", f"agents[0].start={json.dumps(start_by)}")
    assert "(its sandbox hides weights.npz beside the program: name what it needs under files" in str(
        failed.result["faults"]
    )


def test_a_program_where_runs_are_made_is_refused(tmp_path):
    """Runs that begin later would be seen by it."""
    (tmp_path / "agent.py").write_text("raise SystemExit(3)\n")
    start_by = {"command": [sys.executable, str(tmp_path / "agent.py")], "door": "stdio"}
    words = ("--set", f"agents[0].start={json.dumps(start_by)}")
    refused = fly_here(TINY_ROOM, tmp_path, *words)
    assert refused.exit_code == 3
    assert "agents.beetle.start: expected a program in a folder of its own" in refused.errors
    assert fly_here(TINY_ROOM, tmp_path / "runs", *words).exit_code == 1


@pytest.mark.parametrize("sandbox", SANDBOXES)
def test_what_the_scenario_was_resolved_from_is_hidden_by_its_path(tmp_path, sandbox):
    """Stored wind shows where obstacles and openings are."""
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    np.save(tmp_path / "wind.npy", np.full((24, 20, 12, 3), 0.1, np.float32))
    program = "try:\n  open('wind.npy', 'rb').read(1) and sys.exit(4)\nexcept OSError:\n  sys.exit(3)\n"
    (tmp_path / "agent.py").write_text(f"import sys\n{program}")
    (tmp_path / "wind.txt").write_text("not the wind")
    values = yaml.safe_load(TINY_ROOM.read_text())
    values["wind"] = {"solver": {"file": "wind.npy"}, "cell_m": 0.25}
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(values))
    start_by = {"command": [sys.executable, str(tmp_path / "agent.py")], "door": "stdio"}
    words = ("--set", f"agents[0].start={json.dumps(start_by)}", "--set", f"agents[0].sandbox={sandbox}")
    ended = fly_here(tmp_path / "room.yaml", tmp_path / "runs", *words)
    assert "ended with exit code" in str(ended.result.get("faults")), ended.errors
    # The file is empty where bubblewrap puts nothing in its place.
    assert "exit code 4" not in str(ended.result["faults"])


@pytest.mark.parametrize("sandbox", [*SANDBOXES, "none"])
def test_only_what_the_scenario_names_of_our_environment_reaches_an_agent(tmp_path, monkeypatch, sandbox):
    """Tokens of the user do not, with or without a sandbox."""
    for name in ("A_TOKEN", "SSH_AUTH_SOCK", "PASSED_ON"):
        monkeypatch.setenv(name, "of the user")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "agent.py").write_text(
        "import os, sys\n"
        "ours = {name for name, value in os.environ.items() if value == 'of the user'}\n"
        "sys.exit(7 if ours == {'PASSED_ON'} and os.environ['NAMED'] == 'x' else 8)\n"
    )
    start_by = {"command": [sys.executable, str(tmp_path / "mine" / "agent.py")], "door": "stdio"}
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    words = ("--set", f"agents[0].start={json.dumps(start_by)}", "--set", f"agents[0].sandbox={sandbox}")
    ended = fly_here(TINY_ROOM, tmp_path / "runs", *words, "--set", "agents[0].environment={PASSED_ON: , NAMED: x}")
    assert "ended with exit code 7" in str(ended.result.get("faults")), ended.errors


def flown_with_library(tmp_path, program, *words):
    """Fly a program beside a library that writes to ../reached when it is loaded; return the faults."""
    if (compiler := shutil.which("cc")) is None:
        pytest.skip("there is no compiler of C")
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "room.yaml").write_bytes(TINY_ROOM.read_bytes())
    (mine / "agent.py").write_text(program)
    (mine / "mine.c").write_text(
        "#include <fcntl.h>\n"
        f'__attribute__((constructor)) static void load(void) {{ open("{tmp_path}/reached", O_CREAT | O_WRONLY); }}\n'
    )
    subprocess.run([compiler, "-shared", "-fPIC", "-o", "mine.so", "mine.c"], cwd=mine, check=True)
    start_by = {"command": [sys.executable, str(mine / "agent.py")], "door": "stdio"}
    ended = fly_here(mine / "room.yaml", tmp_path / "runs", "--set", f"agents[0].start={json.dumps(start_by)}", *words)
    return str(ended.result.get("faults")) + ended.errors


@pytest.mark.extras
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can read it at all")
@pytest.mark.parametrize("sandbox", SANDBOXES)
def test_a_unit_of_root_reads_no_private_file_of_the_system(tmp_path, sandbox):
    """Its library runs as it is loaded, in the process that hosts it."""
    if (compiler := shutil.which("cc")) is None or unavailable_reason(sandbox):
        pytest.skip(f"there is no compiler of C, or no {sandbox}")
    (tmp_path / "unit.c").write_text(
        "#include <stdio.h>\n"
        "__attribute__((constructor)) static void load(void) {\n"
        '  fputs(fopen("/etc/passwd", "r") ? "all may read " : "closed ", stderr);\n'
        '  fputs(fopen("/etc/shadow", "r") ? "root may read\\n" : "refused\\n", stderr);\n'
        "}\n"
    )
    subprocess.run([compiler, "-shared", "-fPIC", "-o", "unit.so", "unit.c"], cwd=tmp_path, check=True)
    (tmp_path / "room").mkdir()
    build_fan(tmp_path / "room", 2, binary=(tmp_path / "unit.so").read_bytes())
    values = yaml.safe_load(TINY_ROOM.read_text())
    unit = {"name": "fan", "start": {"fmu": "fan.fmu"}, "writes": ["state"], "sandbox": sandbox}
    values["participants"] = [unit | {"outputs": {"state": {"share": "share"}}}]
    (tmp_path / "room" / "room.yaml").write_text(yaml.safe_dump(values))
    ended = fly_here(tmp_path / "room" / "room.yaml", tmp_path / "runs")
    logs = [path.read_text() for path in tmp_path.glob("runs/*/logs/*fan*")]
    assert "all may read refused" in "".join(logs), (ended.errors, logs)


@pytest.mark.parametrize("name", ["LD_PRELOAD", "LD_AUDIT"])
@pytest.mark.parametrize("sandbox", SANDBOXES)
def test_a_library_that_variables_name_is_loaded_once_the_agent_is_confined(tmp_path, sandbox, name):
    """The launcher and bubblewrap loaded it with all rights of the user; the agent itself has it still."""
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    program = (
        "import os, sys\n"
        f"ours = os.environ[{name!r}] == './mine.so' and (os.getcwd() == {str(tmp_path / 'mine')!r})\n"
        "loaded = os.environ.get('LD_PRELOAD') is None or 'mine.so' in open('/proc/self/maps').read()\n"
        "sys.exit(7 if ours and loaded else 8)\n"
    )
    change = f"agents[0].environment={{{name}: ./mine.so}}"
    faults = flown_with_library(tmp_path, program, "--set", f"agents[0].sandbox={sandbox}", "--set", change)
    assert "ended with exit code 7" in faults
    assert not (tmp_path / "reached").exists()


def test_the_launcher_has_neither_the_variables_nor_the_folder_of_an_agent(tmp_path, monkeypatch):
    """An empty entry in a path of libraries is the folder that a process starts in."""
    monkeypatch.setenv("LD_LIBRARY_PATH", ":/nowhere")
    program = (
        "import os, sys\n"
        "launcher = f'/proc/{os.getppid()}'\n"
        "away = os.readlink(f'{launcher}/cwd') == '/' and b'OF_AGENT' not in open(f'{launcher}/environ', 'rb').read()\n"
        "sys.exit(7 if away and os.environ['OF_AGENT'] == 'x' else 8)\n"
    )
    words = ("--set", "agents[0].sandbox=none", "--set", "agents[0].environment={OF_AGENT: x}")
    assert "ended with exit code 7" in flown_with_library(tmp_path, program, *words)


@pytest.mark.parametrize("folder", ["the cache", "kernels", "this Python", "gslcosim", "the runs", "all", "a link"])
def test_a_folder_with_code_or_runs_is_not_for_writing(tmp_path, folder):
    """Whoever could write there would be run by the next service, or write the result."""
    (tmp_path / "link").symlink_to(get_cache_root())
    place = {
        "the cache": get_cache_root(),
        "kernels": os.environ["NUMBA_CACHE_DIR"],
        "this Python": sys.prefix,
        "gslcosim": ROOT / "gslcosim" / "runtime",
        "the runs": tmp_path / "runs",
        "all": "/",
        "a link": tmp_path / "link",
    }[folder]
    ended = fly_here(TINY_ROOM, tmp_path / "runs", "--set", PIPED, "--set", f"agents[0].may_write=[{place}]")
    assert ended.exit_code == 3
    assert "agents.beetle.may_write: expected a folder from which no other process reads code" in ended.errors


def test_agents_may_share_a_folder_within_that_of_their_programs_but_not_write_that(tmp_path):
    (tmp_path / "mine" / "notes").mkdir(parents=True)
    for name in ("a.py", "b.py"):
        (tmp_path / "mine" / name).write_text("raise SystemExit(3)\n")
    values = yaml.safe_load(TINY_ROOM.read_text())
    agent = values["agents"][0]
    starts_m = ([4.5, 1.5, 0.2], [4.5, 3.5, 0.2])
    values["agents"] = [
        {
            **agent,
            "name": name,
            "start": {"command": [sys.executable, f"mine/{name}.py"], "door": "stdio"},
            "vehicle": {**agent["vehicle"], "start_m": start_m},
        }
        for name, start_m in zip("ab", starts_m, strict=True)
    ]
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(values))
    refused = fly_here(tmp_path / "room.yaml", tmp_path / "r", "--set", "agents[0].may_write=[mine]")
    assert (refused.exit_code, "agents.a.may_write: expected a folder" in refused.errors) == (3, True)
    allowed = fly_here(tmp_path / "room.yaml", tmp_path / "r", "--set", "agents[0].may_write=[mine/notes]")
    assert allowed.exit_code == 1
    assert "ended with exit code 3" in str(allowed.result["faults"])


def test_an_agent_in_this_process_is_in_none_and_the_result_says_so(tmp_path):
    """What was demanded for it is refused."""
    ended = fly_here(TINY_ROOM, tmp_path)
    assert ended.result["sandboxes"] == {"beetle": "none: in this process"}
    for change in (
        "agents[0].sandbox=landlock",
        "agents[0].sandbox=required",
        "agents[0].limits={cpu_s: 9}",
        "agents[0].environment={A: b}",
    ):
        refused = fly_here(TINY_ROOM, tmp_path / "refused", "--set", change)
        assert refused.exit_code == 2
        assert "was an object in this process" in refused.errors


def test_the_digest_is_the_same_in_every_sandbox(tmp_path):
    """With limits too: what watches an agent changes nothing."""
    digests = set()
    for sandbox in ("auto", "bubblewrap", "landlock", "none"):
        if sandbox == "auto" or not unavailable_reason(sandbox):
            limits = "agents[0].limits={cpu_s: 100, memory_mb: 2000, n_processes: 50, n_files: 500}"
            words = ("--set", PIPED, "--set", f"agents[0].sandbox={sandbox}", "--set", limits)
            ended = fly_here(TINY_ROOM, tmp_path / sandbox, *words)
            assert ended.result["valid"], ended.errors
            digests.add(ended.result["digest"])
    assert len(digests) == 1


@pytest.mark.debian
@pytest.mark.soak
def test_an_ordinary_user_is_kept_as_root_is():
    """The attacks, flown by an ordinary user."""
    ran = run_tests_as_ordinary_user(__file__, "-k", "attack_does_not_get_through or as_if_nothing_had_been_tried")
    assert ran.returncode == 0, ran.stdout
    assert "passed" in ran.stdout
