"""Limit on processes and threads, checked before libraries exceed it."""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Generator
from pathlib import Path

from gslcosim.base.errors import build_process_error

# Maximum number of threads of a Zenoh session.
_N_SESSION_THREADS = 16
# Far above the need of runs, so that no check is worth its time.
_HIGH_LIMIT = 4096
# A process without its turn by then opens its session beside the others.
_MAX_TURN_S = 5.0
_TURN_POLL_PERIOD_S = 0.01


def check_thread_limit() -> None:
    """Refuse a limit that libraries would exceed, with obscure errors of their own, by starting as many threads.

    OpenBLAS, which starts a thread per processor, raises SIGINT where it cannot, as if Ctrl-C were pressed, and Zenoh
    panics.
    """
    gate = threading.Event()
    threads = [
        threading.Thread(target=gate.wait, daemon=True) for _ in range((os.cpu_count() or 1) + _N_SESSION_THREADS)
    ]
    n_started = 0
    try:
        for thread in threads:
            thread.start()
            n_started += 1
    except RuntimeError as error:
        raise build_process_error() from error
    finally:
        gate.set()
        for thread in threads[:n_started]:
            thread.join()


@contextlib.contextmanager
def reserve_session_threads() -> Generator[bool]:
    """Refuse a limit that a session of Zenoh would exceed, and reserve its threads within the block.

    Yields True for a low limit: then a session must start all its threads within the block.

    Under a low limit processes open their sessions one after another: otherwise several would count the same free
    threads. Under a high one this costs nothing.
    """
    if sys.platform == "win32":
        yield False
        return
    import fcntl
    import resource

    limit = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    if limit == resource.RLIM_INFINITY or limit >= _HIGH_LIMIT:
        yield False
        return
    # The one file that all processes of a run can read, under any account. An agent among them may hold it for ever.
    with Path(__file__).open("rb") as common:
        deadline_s = time.monotonic() + _MAX_TURN_S
        while time.monotonic() < deadline_s:
            try:
                fcntl.flock(common, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(_TURN_POLL_PERIOD_S)
        check_thread_limit()
        yield True
