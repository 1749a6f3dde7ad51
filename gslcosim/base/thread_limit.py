"""Limit on processes and threads, looked at before libraries run into it."""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Generator
from pathlib import Path

from gslcosim.base.errors import build_process_error

# A session of Zenoh has as many at the most.
_N_SESSION_THREADS = 16
# Far above what runs take; a limit like this is not met by chance.
_HIGH_LIMIT = 4096
# Who has not had its turn by then opens its session beside the others.
_MAX_TURN_S = 5.0
_TURN_POLL_PERIOD_S = 0.01


def check_thread_limit() -> None:
    """Refuse a limit that libraries would run into, each with words of its own, by starting their number of threads.

    OpenBLAS, which starts a thread a processor, raises SIGINT where it cannot, as if somebody had pressed Ctrl-C, and
    Zenoh panics.
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
    """Refuse a limit that a session of Zenoh would run into, and let one be opened within the block.

    Yields whether the limit is low: then a session must start all its threads within the block.

    Where the user's limit is low, processes open theirs one after another: otherwise several would see the same
    threads free. Where it is high this costs nothing.
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
    # The one file that all processes of a run can read, whoever they are. An agent among them may hold it for ever.
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
