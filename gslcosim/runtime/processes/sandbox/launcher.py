"""Launcher, a small process between the supervisor and an agent: confines it, watches its limits, ends all of it.

It starts the agent, or the sandbox with the agent in it, as its child, and gets by a file that it inherits what to
do. It adopts whatever the agent leaves behind, counts what all of it uses, and kills all of it when the agent's
own process has ended, when a limit is reached, when it is asked to end, and when the supervisor is gone. It ends as
the agent has ended. Only Python's own modules are imported, so that it starts within milliseconds.
"""

import ctypes
import fcntl
import json
import os
import resource
import signal
import sys
import time
from typing import Any

from gslcosim.runtime.processes.sandbox import confinement
from gslcosim.runtime.processes.sandbox.confinement import PIPES_AT

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
POLL_PERIOD_S = 0.05
# Shorter than the supervisor's wait before it kills the launcher and loses track of the adopted descendants.
TERM_TIMEOUT_S = 1.0
EXIT_CODE_NOT_STARTED = 127
_WATCHED = (signal.SIGCHLD, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Execute the plan in the file whose descriptor is the last argument; does not return."""
    with os.fdopen(int(sys.argv[-1]), "rb") as file:
        plan: dict[str, Any] = json.loads(file.read())
    supervisor = plan["supervisor"]
    library = ctypes.CDLL(None)
    library.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    library.prctl(_PR_SET_CHILD_SUBREAPER, 1)
    signal.pthread_sigmask(signal.SIG_BLOCK, _WATCHED)
    if os.getppid() != supervisor:
        os._exit(EXIT_CODE_NOT_STARTED)
    fcntl.fcntl(plan["status"], fcntl.F_SETFD, fcntl.FD_CLOEXEC)
    child = os.fork()
    if child == 0:
        _exec_command(plan)
    # Only the agent holds the ends of its streams, so that their closing is noticed outside.
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    for descriptor in plan["keep"]:
        os.close(descriptor)
    _ProcessTreeMonitor(plan, child, supervisor).wait_for_end()


def _exec_command(plan: dict[str, Any]) -> None:
    try:
        os.setsid()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _WATCHED)
        _apply_limits(plan["limits"])
        # Moved away from the descriptors of the pipes, and not passed to the agent.
        plan["status"] = fcntl.fcntl(plan["status"], fcntl.F_DUPFD_CLOEXEC, 20)
        if plan["pipes_apart"]:
            for old, new in enumerate(PIPES_AT):
                os.dup2(old, new)
            nothing = os.open(os.devnull, os.O_RDWR)
            os.dup2(nothing, 0)
            os.dup2(nothing, 1)
        if (confined := plan["landlock"]) is not None:
            if confined["is_about_files"]:
                confined["reads"].append(f"/proc/{os.getpid()}")
            confinement.confine(**confined)
            if confined["is_about_files"]:
                confinement.give_up_capabilities()
        if (calls := plan["seccomp"]) is not None:
            confinement.filter_calls(**calls)
        # The agent's variables and folder can name libraries: they are set only after the confinement.
        os.chdir(plan["directory"])
        variables = os.environ if plan["environment"] is None else plan["environment"]
        os.execvpe(plan["command"][0], plan["command"], variables)
    except OSError as error:
        _report_failure(plan, could_not_start=str(error))
    finally:
        os._exit(EXIT_CODE_NOT_STARTED)


def _apply_limits(limits: dict[str, float | None]) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (cpu_s := limits["cpu_s"]) is not None:
        # The total usage is counted below; this limit is for the case that counting comes late.
        whole_s = int(cpu_s) + 2
        _lower_limit(resource.RLIMIT_CPU, whole_s, whole_s + 1)
    if (memory_mb := limits["memory_mb"]) is not None:
        n_bytes = int(2e6 * memory_mb) + (64 << 20)
        _lower_limit(resource.RLIMIT_DATA, n_bytes, n_bytes)
    if (n_files := limits["n_files"]) is not None:
        _lower_limit(resource.RLIMIT_NOFILE, int(n_files), int(n_files))


def _lower_limit(kind: int, soft: int, hard: int) -> None:
    allowed = resource.getrlimit(kind)[1]
    if allowed != resource.RLIM_INFINITY:
        soft, hard = min(soft, allowed), min(hard, allowed)
    resource.setrlimit(kind, (soft, hard))


def _report_failure(plan: dict[str, Any], **words: Any) -> None:
    os.write(plan["status"], json.dumps(words).encode() + b"\n")


class _ProcessTreeMonitor:
    # Watches the agent and its descendants until the agent has ended, and ends them all.

    def __init__(self, plan: dict[str, Any], child: int, supervisor: int) -> None:
        self._plan = plan
        self._child = child
        self._supervisor = supervisor
        self._limits: dict[str, float | None] = plan["limits"]
        self._is_counting = any(self._limits[key] is not None for key in ("cpu_s", "memory_mb", "n_processes"))
        self._ended_as: int | None = None
        self._killed_at_s: float | None = None
        self._reaped_cpu_s = 0.0

    def wait_for_end(self) -> None:
        wait_s = POLL_PERIOD_S if self._is_counting else 3600.0
        while self._ended_as is None:
            got = signal.sigtimedwait(_WATCHED, wait_s)
            number = got.si_signo if got is not None else 0
            if number == signal.SIGCHLD:
                self._reap()
            elif number:
                self._ask_to_end(number)
                wait_s = POLL_PERIOD_S
            if self._ended_as is None and self._is_counting:
                self._count()
            if self._killed_at_s is not None and time.monotonic() > self._killed_at_s:
                break
        self._kill_all()
        _exit_like(self._ended_as if self._ended_as is not None else signal.SIGKILL, self._plan["is_bubblewrap"])

    # Returns whether any child is left.
    def _reap(self) -> bool:
        while True:
            try:
                pid, status, used = os.wait4(-1, os.WNOHANG)
            except ChildProcessError:
                return False
            if pid == 0:
                return True
            self._reaped_cpu_s += used.ru_utime + used.ru_stime
            if pid == self._child:
                self._ended_as = status

    # The supervisor sends SIGTERM; if the supervisor has ended, there is no reason to wait.
    def _ask_to_end(self, number: int) -> None:
        if self._killed_at_s is not None:
            return
        is_alone = os.getppid() != self._supervisor
        self._killed_at_s = time.monotonic() + (0.0 if is_alone else TERM_TIMEOUT_S)
        # A sandbox would end at once, together with its agent, and leave the agent no time to end in order.
        for pid in _list_descendants(os.getpid(), leave_out=2 if self._plan["is_bubblewrap"] else 0):
            _send_signal(pid, number)

    def _count(self) -> None:
        cpu_s, memory_bytes = self._reaped_cpu_s, 0
        # The two processes of bubblewrap itself hold the CPU time of processes that have ended within it.
        n_processes = -2 if self._plan["is_bubblewrap"] else 0
        for pid in _list_descendants(os.getpid()):
            usage = _read_usage(pid)
            if usage is not None:
                n_processes += 1
                cpu_s += usage[0]
                memory_bytes += usage[1]
        used = {"cpu_s": cpu_s, "memory_mb": memory_bytes / 1e6, "n_processes": float(n_processes)}
        for key, value in used.items():
            limit = self._limits[key]
            if limit is not None and value > limit:
                _report_failure(self._plan, reached=key)
                self._killed_at_s = 0.0
                return

    def _kill_all(self) -> None:
        give_up_at_s = time.monotonic() + TERM_TIMEOUT_S
        while time.monotonic() < give_up_at_s:
            # Stop them first, so that none of them starts another process meanwhile.
            for number in (signal.SIGSTOP, signal.SIGKILL):
                for pid in _list_descendants(os.getpid()):
                    _send_signal(pid, number)
            if not self._reap():
                return
            signal.sigtimedwait((signal.SIGCHLD,), 0.01)


def _exit_like(status: int, is_bubblewrap: bool) -> None:  # noqa: FBT001 - two callers' facts in one line
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    code = os.WEXITSTATUS(status) if os.WIFEXITED(status) else 0
    # Bubblewrap, like a shell, reports a signal as exit code 128 plus its number.
    if is_bubblewrap and code > 128 and code - 128 in signal.valid_signals():
        number = code - 128
    if number:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _WATCHED)
        if number not in (signal.SIGKILL, signal.SIGSTOP):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.kill(os.getpid(), number)
    os._exit(code)


def _send_signal(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except OSError:
        return


def _list_descendants(root: int, leave_out: int = 0) -> list[int]:
    # Leaves out the first `leave_out` generations.
    children: dict[int, list[int]] = {}
    for name in os.listdir("/proc"):  # noqa: PTH208 - pathlib would double the launcher's start
        if name.isdigit() and (parent := _read_parent(name)):
            children.setdefault(parent, []).append(int(name))
    found: list[int] = []
    generation, depth = children.get(root, []), 0
    while generation:
        if depth >= leave_out:
            found += generation
        generation, depth = [pid for parent in generation for pid in children.get(parent, ())], depth + 1
    return found


def _read_parent(pid: str) -> int:
    fields = _read_stat(pid)
    return int(fields[1]) if fields else 0


def _read_usage(pid: int) -> tuple[float, int] | None:
    fields = _read_stat(str(pid))
    if not fields or fields[0] == "Z":
        return None
    # CPU time of the process and of the children that it has waited for; memory in pages.
    return sum(int(field) for field in fields[11:15]) / _TICKS_PER_S, int(fields[21]) * _PAGE_BYTES


# The fields after the name of the program, which may contain any characters.
def _read_stat(pid: str) -> list[str]:
    try:
        with open(f"/proc/{pid}/stat") as file:  # noqa: PTH123 - as above
            return file.read().rpartition(")")[2].split()
    except OSError:
        return []
