"""Live viewer beside a command: `--live` and `--serve` of a run, `--web` of a recording."""

import argparse
import contextlib
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode, RecordingError, UsageError
from gslcosim.cli.run_paths import RECORDING
from gslcosim.cli.terminal import write_note

if TYPE_CHECKING:
    from gslcosim.data.recording.viewer import LiveViewer, ViewerKind
    from gslcosim.runtime.status import RunStatus
    from gslcosim.scenario import Scenario

Report = Callable[["RunStatus"], None]


def add_live_options(parser: argparse.ArgumentParser) -> None:
    """Add `--live` and `--serve`."""
    outputs = parser.add_mutually_exclusive_group()
    outputs.add_argument(
        "--live",
        action="store_const",
        const="window",
        dest="live",
        help="show the recording in the viewer while it is written; the command ends when its window is closed",
    )
    outputs.add_argument(
        "--serve",
        action="store_const",
        const="browser",
        dest="live",
        help="the same as a page for a browser of this machine; the command ends with Ctrl-C",
    )


class RunViewer:
    """Live view of a run; without a viewer it does nothing."""

    def __init__(self, view: "LiveViewer | None") -> None:
        self._view = view
        self._is_over = threading.Event()

    def passing_on(self, report: Report) -> Report:
        """Return what a run reports to in place of `report`, so that it is shown from its beginning."""
        view = self._view
        if view is None:
            return report

        def show_and_report(status: "RunStatus") -> None:
            if status.run_dir is not None:
                view.show(status.run_dir / RECORDING, self._is_over.is_set)
            report(status)

        return show_and_report

    def end(self) -> None:
        """Say that the run is over, and that nothing more will be written."""
        self._is_over.set()

    def stay_open(self, exit_code: int) -> None:
        """Return when the person has closed the viewer, or presses Ctrl-C; at once where the run was interrupted."""
        if self._view is not None and exit_code != ExitCode.INTERRUPTED:
            _wait_until_closed(self._view)


@contextlib.contextmanager
def open_live_view(kind: "ViewerKind | None", scenario: "Scenario") -> Iterator[RunViewer]:
    """Open a viewer for a run, and close it at the end.

    Args:
        kind: `window`, `browser`, or None for no viewer.
        scenario: What will be run.

    Raises:
        UsageError: the scenario is not recorded.
        RecordingError: there is no screen, or no viewer.
    """
    if kind is None:
        yield RunViewer(None)
        return
    if not scenario.recording.enabled:
        raise UsageError("--live and --serve show the recording: expected recording.enabled to be true, was false.")
    view = _opened(kind)
    flight = RunViewer(view)
    try:
        yield flight
    finally:
        flight.end()
        view.close()


def serve_until_closed(recording: Path) -> None:
    """Serve a recording that is complete to browsers of this machine until Ctrl-C.

    Raises:
        RecordingError: there is no viewer.
    """
    view = _opened("browser")
    try:
        view.show(recording, lambda: True)
        _wait_until_closed(view)
    finally:
        view.close()


def _opened(kind: "ViewerKind") -> "LiveViewer":
    from gslcosim.base.command_lines import build_parent_death_prefix
    from gslcosim.data.recording.viewer import LiveViewer

    return LiveViewer(kind, lambda address: write_note(f"Watch it at {address}"), prefix=build_parent_death_prefix())


def _wait_until_closed(view: "LiveViewer") -> None:
    with contextlib.suppress(KeyboardInterrupt):
        view.wait_until_shown()
        if view.is_open:
            write_note("The viewer stays open until Ctrl-C.")
        try:
            view.wait_until_closed()
        except RecordingError as error:
            # What it has shown is as good without it.
            write_note(str(error))
