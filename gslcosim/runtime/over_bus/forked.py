"""What a process that was forked becomes: a service, or a rehearsal of several."""

import contextlib
import ctypes
import gc
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from gslcosim.bus.port import Join
from gslcosim.runtime.process_title import set_process_title
from gslcosim.safe_files import open_for_writing

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int) -> None:
    """Let Linux end this process when the one that has forked it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def become(request: dict[str, Any], parent: int, unwanted: Sequence[int]) -> NoReturn:
    """Do in this fork what is requested, and end it, whatever happens: there must be one server.

    Args:
        request: `log`, and either `rehearse`, or `services` and `join`.
        parent: The process that has forked this one.
        unwanted: Descriptors that are none of its business.
    """
    code = 1
    try:
        end_with_parent(parent)
        with contextlib.suppress(PermissionError):  # it leads a session already
            os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for fd in unwanted:
            os.close(fd)
        _write_to(request["log"])
        gc.enable()
        if "rehearse" in request:
            from gslcosim.runtime.over_bus.still_air import rehearse_requested

            rehearse_requested(request["rehearse"])
            os._exit(0)
        names = [str(name) for name in request["services"]]
        set_process_title(f"{sys.executable} -P -m gslcosim_services {' '.join(names)}")
        from gslcosim.runtime.over_bus.service import serve

        serve(names, Join.model_validate(request["join"]))
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    except BaseException:  # told in the log, as by an interpreter that ends
        traceback.print_exc()
    finally:
        end_fork(code)


def end_fork(code: int) -> NoReturn:
    """End a process that was forked, with what it has written, and without what its parent would do at its end."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


# A service without a log can fly; what ends it is told over the bus.
def _write_to(log: str) -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    try:
        output = open_for_writing(Path(log).parent, Path(log).name, is_appended=True)
    except OSError:
        output = os.dup(nothing)
    for fd, target in ((nothing, 0), (output, 1), (output, 2)):
        os.dup2(fd, target)
    os.close(nothing)
    os.close(output)
