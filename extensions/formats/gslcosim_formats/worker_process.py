"""Worker process: one more Python that does a task after the other, over a pipe to the process that has started it.

A module names what it does by a function of one argument, the connection. Python's `multiprocessing` is not used for
the start: it would copy threads of this process, or import its main program again.
"""

import contextlib
import importlib
import multiprocessing.connection
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any, cast

from gslcosim.base.processes import build_python_command, describe_exit
from gslcosim.base.spawn import Streams, spawn

_LOG_BYTES = 8192
_LOG_LINES = 12
_LOG_LINE_LENGTH = 300
_LOG_WAIT_S = 1.0
_EXIT_WAIT_S = 5.0
_MODULE = "gslcosim_formats.worker_process"
_DO_TASKS = f"{_MODULE}:_do_tasks"


class WorkerProcess:
    """A worker that runs; whoever has made it closes it.

    It ends when this process does, however that ends. Ctrl-C reaches this process only.

    Args:
        name: Of the worker, in messages.
        target: `module:function` of what it does.
    """

    def __init__(self, name: str, target: str) -> None:
        self.name = name
        ours, theirs = Pipe()
        self.connection: Connection[Any, Any] = ours
        number = os.dup(theirs.fileno())
        theirs.close()
        command = build_python_command("-u", "-m", _MODULE, target, str(number))
        streams = Streams(stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        # It watches its standard input: Linux would end it with the thread that starts it.
        self._process = spawn(name, command, streams=streams, inherited=[number], ends_with_parent=False)
        # A folder of the working directory must not take the package's place; tasks are of modules that we can import.
        with contextlib.suppress(OSError):
            ours.send(sys.path)
        self._output = bytearray()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """True when the process has not ended yet."""
        return self._process.poll() is None

    @property
    def pids(self) -> list[int]:
        """The numbers of the process and of all its descendants."""
        return [self.pid, *list_descendants(self.pid)]

    def forget_output(self) -> None:
        """Leave out of `log_tail` what it has written so far."""
        self._output.clear()

    def log_tail(self) -> str:
        """Return the last lines that the process has written."""
        lines = bytes(self._output[-_LOG_BYTES:]).decode(errors="replace").splitlines()
        return "\n".join(line[:_LOG_LINE_LENGTH] for line in lines[-_LOG_LINES:]).strip()

    def describe_end(self) -> str:
        """Return in words how it has ended, or that it has closed its connection; its last output is read by then."""
        try:
            ended = describe_exit(self._process.wait(timeout=_EXIT_WAIT_S))
        except subprocess.TimeoutExpired:
            return "closed its connection"
        self._listener.join(timeout=_LOG_WAIT_S)
        return ended

    def close(self) -> None:
        """Kill it with all that it has started."""
        for pid in reversed(self.pids):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._process.wait()
        self.connection.close()
        self._listener.join(timeout=_LOG_WAIT_S)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def _listen(self) -> None:
        stream = self._process.stdout
        assert stream is not None
        # Where something that the worker has started holds the other end, the stream is closed while it is read.
        with contextlib.suppress(OSError, ValueError):
            while chunk := os.read(stream.fileno(), 65536):
                self._output += chunk
                del self._output[:-_LOG_BYTES]


@dataclass(frozen=True, kw_only=True)
class TaskResult:
    """Result of a task: what the function returned, or why the worker ended before."""

    index: int
    value: Any = None
    failure: str | None = None


def run_tasks(function: Callable[[Any], Any], tasks: Sequence[Any], n_workers: int) -> Iterator[TaskResult]:
    """Do tasks in worker processes, and yield each result when it is there; leaving the iterator ends the workers.

    A worker that ends costs its task, and is replaced.

    Args:
        function: A function of a module; it, the tasks and its results are pickled.
        tasks: Its arguments.
        n_workers: How many are done at the same time.
    """
    waiting = list(enumerate(tasks))[::-1]
    busy: dict[Connection[Any, Any], tuple[WorkerProcess, int]] = {}

    def hand_out(worker: WorkerProcess) -> None:
        index, task = waiting.pop()
        busy[worker.connection] = (worker, index)
        # One that has ended is seen when its answer is read.
        with contextlib.suppress(OSError):
            worker.connection.send((function, task))

    try:
        for i in range(min(n_workers, len(tasks))):
            hand_out(WorkerProcess(f"worker_{i + 1}", _DO_TASKS))
        while busy:
            for connection in multiprocessing.connection.wait(list(busy)):
                worker, index = busy.pop(cast("Connection[Any, Any]", connection))
                try:
                    result = TaskResult(index=index, value=worker.connection.recv())
                except (EOFError, OSError):
                    failure = f"its process {worker.describe_end()}. {worker.log_tail()}".strip()
                    result = TaskResult(index=index, failure=failure)
                if waiting and result.failure is None:
                    hand_out(worker)
                else:
                    worker.close()
                if waiting and result.failure is not None:
                    hand_out(WorkerProcess(worker.name, _DO_TASKS))
                yield result
    finally:
        for worker, _ in busy.values():
            worker.close()


def _do_tasks(connection: "Connection[Any, Any]") -> None:
    with contextlib.suppress(EOFError):
        while True:
            function, task = connection.recv()
            connection.send(function(task))


def list_descendants(pid: int) -> list[int]:
    """Return the numbers of all processes that a process and its descendants have started; Linux only."""
    found: list[int] = []
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                found += [int(child), *list_descendants(int(child))]
    except OSError:
        return found
    return found


# Nothing is ever written to standard input: it ends when the process that started this one is gone.
def _end_with_parent() -> None:
    while os.read(0, 1):
        continue
    os._exit(1)


def main() -> None:
    """Call the function that the first argument names with the connection whose number is the second."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    module, _, function = sys.argv[1].partition(":")
    connection: Connection[Any, Any] = Connection(int(sys.argv[2]))
    sys.path[:] = connection.recv()
    getattr(importlib.import_module(module), function)(connection)


if __name__ == "__main__":
    main()
