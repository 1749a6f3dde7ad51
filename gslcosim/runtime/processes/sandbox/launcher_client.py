"""Client of the launcher: the plan that it gets, and the failure that it reports in the end."""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gslcosim.base.bundled import CARD_FILE
from gslcosim.base.kernel_cache import NUMBA_VARIABLE, UNCHECKED_VARIABLE
from gslcosim.base.spawn import open_memory_file
from gslcosim.runtime.processes.sandbox import confinement
from gslcosim.runtime.processes.sandbox.bubblewrap import build_bubblewrap_arguments, build_bubblewrap_command
from gslcosim.runtime.processes.sandbox.confinement import PIPES_AT
from gslcosim.runtime.processes.sandbox.policy import SandboxPolicy, split_readable_paths
from gslcosim.scenario.models.participants import AgentLimitsSpec

if sys.platform != "win32":
    import fcntl

# The packages around the launcher stay empty: imports there would take as long as all the rest.
_LAUNCHER_CODE = """
import sys
whole = ""
for name, folder in zip(("gslcosim", "runtime", "processes", "sandbox"), sys.argv[1:5]):
    whole = whole + "." * bool(whole) + name
    sys.modules[whole] = type(sys)(whole)
    sys.modules[whole].__path__ = [folder]
from gslcosim.runtime.processes.sandbox.launcher import main
main()
"""
_MAX_UNSEEN = 3
_HERE = Path(__file__).parent
_PACKAGE = _HERE.parents[2]
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")
_READABLE_PROC_FILES = ("cpuinfo", "meminfo", "stat", "loadavg", "uptime", "version", "filesystems", "sys")
_LIMIT_TEXTS = {"cpu_s": "cpu_s of {:g} s", "memory_mb": "memory_mb of {:g} MB", "n_processes": "n_processes of {:g}"}


@dataclass(frozen=True, kw_only=True)
class Confinement:
    """Confinement of one process of agents: its policy, if any, and its limits.

    `unseen` are files beside the program that its sandbox hides.
    """

    kind: str = "none"
    policy: SandboxPolicy | None = None
    unseen: tuple[Path, ...] = ()
    limits: AgentLimitsSpec = field(default_factory=AgentLimitsSpec)
    environment: Mapping[str, str] = field(default_factory=dict[str, str])


def is_launcher_possible() -> bool:
    """Return whether processes of agents can be watched and confined on this system."""
    return sys.platform == "linux"


class Launch:
    """One process that is started by the launcher; the caller that starts it closes `descriptors` afterwards.

    Args:
        environment: All variables of the process itself. The launcher does not start with them.
    """

    def __init__(
        self,
        confinement: Confinement,
        command: Sequence[str],
        *,
        environment: Mapping[str, str],
        directory: Path,
        has_pipes: bool,
        keep: Sequence[int] = (),
    ) -> None:
        self._limits = confinement.limits
        self._unseen = confinement.unseen
        self._status, theirs = os.pipe()
        cell, is_bubblewrap = confinement.policy, confinement.kind == "bubblewrap"
        variables = {**environment, NUMBA_VARIABLE: os.environ.get(NUMBA_VARIABLE, "/")}
        inherited: list[int] = []
        confined: Mapping[str, Any] = {}
        if cell is not None:
            # It reads the compiled kernels, but not the key that verifies them.
            variables[UNCHECKED_VARIABLE] = "1"
            if is_bubblewrap:
                calls = _write_call_filter(cell)
                words = build_bubblewrap_arguments(variables)
                arguments = _open_memory_file_above_pipes(b"".join(os.fsencode(word) + b"\0" for word in words))
                inherited = [*calls, arguments]
                confined = _plan_bubblewrap(cell, command, has_pipes=has_pipes, calls=calls, arguments=arguments)
            else:
                confined = _plan_landlock(cell, has_pipes=has_pipes)
                variables |= {"HOME": str(cell.scratch), "TMPDIR": str(cell.scratch)}
        keep = [*keep, *inherited]
        plan = {
            "command": list(command),
            "environment": None if is_bubblewrap else variables,
            "directory": "/" if is_bubblewrap else str(directory),
            "supervisor": os.getpid(),
            "status": theirs,
            "keep": keep,
            "limits": confinement.limits.model_dump(),
            "is_bubblewrap": is_bubblewrap,
            "pipes_apart": is_bubblewrap and has_pipes,
            "landlock": None,
            "seccomp": None,
            **confined,
        }
        self._theirs = [theirs, *keep, open_memory_file(json.dumps(plan).encode())]

    @property
    def command(self) -> list[str]:
        """The launcher's command line."""
        folders = (str(folder) for folder in (_PACKAGE, _HERE.parents[1], _HERE.parent, _HERE))
        return [sys.executable, "-I", "-S", "-c", _LAUNCHER_CODE, *folders, str(self._theirs[-1])]

    @property
    def descriptors(self) -> tuple[int, ...]:
        """Descriptors that the launcher inherits, `keep` among them."""
        return tuple(self._theirs)

    def hidden_files_hint(self) -> str:
        """Return the files beside the program that its sandbox hides, with the remedy; empty if there are none."""
        if not self._unseen:
            return ""
        names = ", ".join(path.name for path in self._unseen[:_MAX_UNSEEN])
        more = f" and {n} more" if (n := len(self._unseen) - _MAX_UNSEEN) > 0 else ""
        return (
            f" (its sandbox hides {names}{more} beside the program: name what it needs under files in {CARD_FILE}, or "
            "in may_read)"
        )

    def log_tail(self) -> str:
        """Return the launcher's report on the end, once it has ended; empty if there is none."""
        with os.fdopen(self._status, "rb") as status:
            lines = status.read().splitlines()
        if not lines:
            return ""
        words: dict[str, str] = json.loads(lines[0])
        if (key := words.get("reached")) is not None:
            bound = _LIMIT_TEXTS[key].format(getattr(self._limits, key))
            return f"used more than its limits.{bound}"
        return f"could not be started ({words.get('could_not_start')})"


# The filter that bubblewrap installs before the program starts, if there is one for this machine.
def _write_call_filter(cell: SandboxPolicy) -> list[int]:
    if not confinement.can_filter():
        return []
    code = confinement.build_filter_program(
        os.uname().machine, allows_unix=True, allows_tcp=True, is_beside_namespaces=True,
        has_own_network=cell.tcp_port is None, owns_devices=os.geteuid() == 0,
    )  # fmt: skip
    return [_open_memory_file_above_pipes(code)]


# Apart from the descriptors that the launcher uses for pipes.
def _open_memory_file_above_pipes(data: bytes) -> int:
    made = open_memory_file(data)
    apart = fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, 2 * max(PIPES_AT))
    os.close(made)
    return apart


def _plan_bubblewrap(
    cell: SandboxPolicy, command: Sequence[str], *, has_pipes: bool, calls: Sequence[int], arguments: int
) -> Mapping[str, Any]:
    # It has its own network, but for one that joins by TCP.
    ports = [cell.tcp_port] if cell.tcp_port is not None else []
    return {
        "command": build_bubblewrap_command(
            cell, command, has_pipes=has_pipes, calls=next(iter(calls), None), arguments=arguments
        ),
        "landlock": {"tcp_ports": ports, "is_about_files": False} if ports else None,
    }


def _plan_landlock(cell: SandboxPolicy, *, has_pipes: bool) -> Mapping[str, Any]:
    reads, lists = split_readable_paths(cell)
    return {
        "landlock": {
            "reads": [*map(str, reads), *(f"/proc/{name}" for name in _READABLE_PROC_FILES)],
            "lists": [str(path) for path in lists],
            "writes": [str(path) for path in (*cell.writes, cell.scratch)],
            "files_rw": [*_DEVICES, *map(str, cell.sockets)],
            "tcp_ports": [cell.tcp_port] if cell.tcp_port is not None else [],
            "is_about_files": True,
        },
        "seccomp": {
            "allows_unix": not has_pipes and cell.tcp_port is None,
            "allows_tcp": cell.tcp_port is not None,
        },
    }
