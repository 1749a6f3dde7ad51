"""Running OpenFOAM's tools on a case and following what they print."""

import collections
import contextlib
import os
import re
import signal
import subprocess
from collections.abc import Callable, Sequence

from gslcosim.errors import FlowError
from gslcosim.flow.openfoam.case import FoamCase
from gslcosim.flow.openfoam.installation import Installation

_TIME = re.compile(r"^Time = ([0-9.eE+-]+)s?$")
_N_LAST_LINES = 15


def run_case(case: FoamCase, installation: Installation, *, on_time: Callable[[float], None]) -> None:
    """Solve a case: cut its mesh into parts and let pimpleFoam run on them.

    Args:
        case: A written case that was not run yet.
        installation: OpenFOAM.
        on_time: Is told the flow's time [s] at each step.

    Raises:
        FlowError: a tool failed; the message has the last lines of its log and says where the log is.
    """
    solver = [installation.tool("pimpleFoam"), "-case", str(case.folder)]
    if case.n_ranks > 1:
        _run(case, installation, [installation.tool("decomposePar"), "-case", str(case.folder)])
        solver = [installation.tool("mpirun"), "-np", str(case.n_ranks), *solver, "-parallel"]
    _run(case, installation, solver, on_time=on_time)


def _run(
    case: FoamCase,
    installation: Installation,
    command: Sequence[str],
    *,
    on_time: Callable[[float], None] | None = None,
) -> None:
    name = "decomposePar" if on_time is None else "pimpleFoam"
    log = case.folder / f"log.{name}"
    last_lines: collections.deque[str] = collections.deque(maxlen=_N_LAST_LINES)
    process = subprocess.Popen(
        command,
        env=installation.environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    with _ended(process), log.open("w", encoding="utf-8") as lines:
        assert process.stdout is not None, "it is a pipe"
        for line in process.stdout:
            lines.write(line)
            last_lines.append(line)
            if on_time is not None and (match := _TIME.match(line)):
                on_time(float(match[1]))
        status = process.wait()
    if status != 0:
        raise FlowError(
            f"{name} failed with exit status {status}. The end of its log:\n{''.join(last_lines).rstrip()}\nLog: {log}"
        )


# Leaves no process behind, whatever ends the block: mpirun passes the signal on to its ranks.
@contextlib.contextmanager
def _ended(process: "subprocess.Popen[str]"):  # noqa: ANN202
    try:
        yield
    finally:
        if process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait()
        if process.stdout is not None:
            process.stdout.close()
