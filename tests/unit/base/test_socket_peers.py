"""Peers of unix sockets: processes that really are confined, have ended, or are of another user."""

import contextlib
import os
import socket
import subprocess
import sys

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.base.sockets import check_peer, read_peer_pid, short_socket_address

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="peers are looked at on Linux only")

CALL = """
import os, socket, sys, threading, time
from gslcosim.runtime.processes.sandbox import confinement
def confine():
    confinement.filter_calls(allows_unix=True, allows_tcp=False)
def call():
    caller = socket.socket(socket.AF_UNIX)
    caller.connect(sys.argv[1])
    return caller
"""
FILTERED = "confine()\ncaller = call()\ncaller.recv(1)"
PLAIN = "caller = call()\ncaller.recv(1)"
WITHOUT_NEW_PRIVILEGES = "confinement.give_up_new_privileges()\ncaller = call()\ncaller.recv(1)"
# The one who calls is gone, another has its connection.
BY_A_CHILD_THAT_ENDS = """
confine()
caller = socket.socket(socket.AF_UNIX)
if os.fork() == 0:
    caller.connect(sys.argv[1])
    os._exit(0)
os.wait()
print("ended", flush=True)
caller.recv(1)
"""
# Its own thread has ended, so that its number shows a zombie.
BY_A_SECOND_THREAD = """
confine()
import ctypes
def later():
    while open(f"/proc/{os.getpid()}/stat").read().rpartition(")")[2].split()[0] != "Z":
        time.sleep(0.01)
    caller = call()
    print("ended", flush=True)
    caller.recv(1)
threading.Thread(target=later).start()
ctypes.CDLL(None).syscall(60 if os.uname().machine == "x86_64" else 93, 0)
"""
FORKED_TWICE = """
confine()
if os.fork():
    sys.stdin.read()
    os._exit(0)
os.setsid()
if os.fork():
    os._exit(0)
caller = call()
caller.recv(1)
"""
# Itself confined, as everything is in a container.
SERVER = """
import sys, socket
from gslcosim.base.errors import UsageError
from gslcosim.runtime.processes.sandbox import confinement
from gslcosim.base.sockets import check_peer
confinement.filter_calls(allows_unix=True, allows_tcp=False)
listener = socket.socket(socket.AF_UNIX)
listener.bind(sys.argv[1])
listener.listen()
print("listens", flush=True)
connection, _ = listener.accept()
try:
    check_peer(connection, place="server")
    print("let in", flush=True)
except UsageError as error:
    print(error, flush=True)
"""


@pytest.fixture
def listener(tmp_path):
    with socket.socket(socket.AF_UNIX) as listener, short_socket_address(tmp_path / "s") as address:
        listener.bind(address)
        listener.listen()
        listener.settimeout(20)
        yield listener


@contextlib.contextmanager
def caller(path, program, **options):
    call = [sys.executable, "-c", CALL + program, str(path)]
    process = subprocess.Popen(
        call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True, **options
    )
    try:
        yield process
    finally:
        process.stdin.close()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        process.stdout.close()
        process.wait()


def refusal(listener, path, program, *, waits=False, **options):
    """Return what a caller gets."""
    with caller(path, program, **options) as process:
        if waits:
            assert process.stdout.readline() == "ended\n"
        connection, _ = listener.accept()
        with connection, pytest.raises(UsageError) as refused:
            check_peer(connection, place="here")
    return str(refused.value)


def test_a_process_of_this_user_that_is_confined_alike_is_let_in(listener, tmp_path):
    with caller(tmp_path / "s", PLAIN) as process:
        connection, _ = listener.accept()
        with connection:
            check_peer(connection, place="here")
            assert read_peer_pid(connection) == process.pid


@pytest.mark.parametrize("program", [FILTERED, FORKED_TWICE], ids=["itself", "by a grandchild in a session of its own"])
def test_a_process_with_a_filter_more_is_refused(listener, tmp_path, program):
    refused = refusal(listener, tmp_path / "s", program)
    assert refused.startswith("here: expected a process that is confined no more than this one, process")
    assert "filters of system calls (Seccomp_filters), where this one has" in refused


def test_a_process_that_may_get_no_privileges_is_refused(listener, tmp_path):
    assert "has NoNewPrivs set, which this one has not" in refusal(listener, tmp_path / "s", WITHOUT_NEW_PRIVILEGES)


def test_a_process_that_has_called_and_ended_is_refused(listener, tmp_path):
    """Its number may be that of another by now, and its connection in the hands of who has a filter."""
    refused = refusal(listener, tmp_path / "s", BY_A_CHILD_THAT_ENDS, waits=True)
    assert "expected a process that can be looked at" in refused or "has ended" in refused


def test_a_process_whose_first_thread_has_ended_is_refused(listener, tmp_path):
    refused = refusal(listener, tmp_path / "s", BY_A_SECOND_THREAD, waits=True)
    assert "expected a process that can be looked at" in refused


@pytest.mark.skipif(os.geteuid() != 0, reason="only root becomes another user")
def test_a_process_of_another_user_is_refused(listener, tmp_path):
    for folder in (tmp_path, *tmp_path.parents):
        if folder.owner() == "root" and folder != folder.parent and "pytest" in str(folder):
            folder.chmod(0o755)
    (tmp_path / "s").chmod(0o777)
    program = f"os.setuid(65534)\n{PLAIN}"
    assert "expected a process of user 0 at the other end, found one of 65534" in refusal(
        listener, tmp_path / "s", program
    )


@pytest.mark.parametrize(("program", "is_let_in"), [(FILTERED, True), (f"confine()\n{FILTERED}", False), (PLAIN, True)])
def test_filters_that_everything_here_has_count_for_nobody(tmp_path, program, is_let_in):
    """In a container all processes have one; a sandbox adds another."""
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER, str(tmp_path / "s")], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        assert server.stdout.readline() == "listens\n"
        with caller(tmp_path / "s", program):
            answer = server.stdout.readline()
    finally:
        server.kill()
        server.communicate()
    assert (answer == "let in\n") is is_let_in
    if not is_let_in:
        assert "2 filters of system calls (Seccomp_filters), where this one has 1" in answer
