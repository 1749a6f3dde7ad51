"""Compilation of kernels at the start of a run, seen by the files that it leaves, whichever process compiles."""

import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

from gslcosim.base.disk_cache import mark_used
from gslcosim.base.kernel_cache import NUMBA_VARIABLE
from gslcosim.runtime.status import RunStatus

LOOK_EVERY_S = 0.5
TEXT = "compiling kernels"


class KernelFolder:
    """The folder in which numba keeps kernels, as it was when this object was made.

    Args:
        folder: It; by default that of this process, which those of a run share.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or Path(os.environ.get(NUMBA_VARIABLE, os.devnull))
        self._before = self._times()

    def has_new(self) -> bool:
        """Return whether kernels were added since."""
        return self._times() != self._before

    def mark_used(self) -> None:
        """Keep it in the cache while this process lives."""
        mark_used(self._folder)

    # Each folder of modules changes when a file is added.
    def _times(self) -> Mapping[str, int]:
        try:
            return {entry.name: entry.stat().st_mtime_ns for entry in os.scandir(self._folder) if entry.is_dir()}
        except OSError:
            return {}


class CompilationReporter:
    """Adds to the status of a run that starts that kernels are compiled; used as a context, and as the report in it.

    A first run of a version compiles for a minute, and one in a single process has nothing else to report meanwhile.

    Args:
        report: Is given the status.
        folder: Where kernels are added.
    """

    def __init__(self, report: Callable[[RunStatus], None], folder: KernelFolder | None = None) -> None:
        self._report = report
        self._folder = folder or KernelFolder()
        self._folder.mark_used()
        self._guard = threading.Lock()
        self._last = RunStatus(state="starting")
        self._is_compiling = False
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watches kernels", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join()

    @property
    def has_compiled(self) -> bool:
        """True if kernels were compiled."""
        return self._is_compiling

    def __call__(self, status: RunStatus) -> None:
        """Report a status."""
        with self._guard:
            self._last = status
            if status.state != "starting":
                self._is_over.set()
            self._report(self._completed(status))

    def _watch(self) -> None:
        while not self._is_over.wait(LOOK_EVERY_S):
            if not self._folder.has_new():
                continue
            with self._guard:
                if not self._is_over.is_set():
                    self._is_compiling = True
                    self._report(self._completed(replace(self._last, run_dir=None)))
            return

    def _completed(self, status: RunStatus) -> RunStatus:
        if not self._is_compiling or status.state != "starting":
            return status
        return replace(status, text=", ".join(filter(None, (TEXT, status.text))), is_compiling=True)
