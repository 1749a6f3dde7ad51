"""`gslcosim view`: a recording in the viewer or as a picture, and the viewer of live runs."""

import argparse
import contextlib
import re
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode, RecordingError, UsageError
from gslcosim.base.extensions import find_remedy
from gslcosim.cli.arguments import RECORDING, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.run_output import Report
from gslcosim.cli.terminal import write, write_note

if TYPE_CHECKING:
    from gslcosim.recordings.viewer import LiveViewer, ViewerKind
    from gslcosim.runtime.status import RunStatus
    from gslcosim.scenario import Scenario

EXAMPLES = """  gslcosim view                                   the newest run
  gslcosim view runs/warehouse_empty-seed7-20250101T120000-a1b2c3
  gslcosim view runs/first runs/second            both on one map, with their curves in the same plots
  gslcosim view runs/first runs/second --align first_contact
  gslcosim view --at 120
  gslcosim view hall                              the environment in the folder hall
  gslcosim view --web
  gslcosim view --screenshot run.png --window-size 1600x1000"""
ENVIRONMENT_HEADER = "environment.yaml"


def add_live_options(parser: argparse.ArgumentParser) -> None:
    """Add `--live` and `--serve`."""
    outputs = parser.add_mutually_exclusive_group()
    outputs.add_argument(
        "--live",
        action="store_const",
        const="window",
        dest="live",
        help=("open the recording in the viewer while it grows; the command ends when you close the window"),
    )
    outputs.add_argument(
        "--serve",
        action="store_const",
        const="browser",
        dest="live",
        help="serve the same as a page for a browser on this machine, until Ctrl-C",
    )


class RunViewer:
    """Live view of a run; without a viewer it does nothing."""

    def __init__(self, view: "LiveViewer | None") -> None:
        self._view = view
        self._is_over = threading.Event()

    def passing_on(self, report: Report) -> Report:
        """Return a report function that shows the run from its beginning and then calls `report`."""
        view = self._view
        if view is None:
            return report

        def show_and_report(status: "RunStatus") -> None:
            if status.run_dir is not None:
                view.show(status.run_dir / RECORDING, self._is_over.is_set)
            report(status)

        return show_and_report

    def end(self) -> None:
        """Mark the run as over: nothing more will be written."""
        self._is_over.set()

    def stay_open(self, exit_code: int) -> None:
        """Wait until the viewer is closed or Ctrl-C is pressed; return at once if the run was interrupted."""
        if self._view is not None and exit_code != ExitCode.INTERRUPTED:
            _wait_until_closed(self._view)


@contextlib.contextmanager
def open_live_view(kind: "ViewerKind | None", scenario: "Scenario") -> Iterator[RunViewer]:
    """Open a viewer for a run, and close it at the end."""
    if kind is None:
        yield RunViewer(None)
        return
    if not scenario.recording.enabled:
        raise UsageError("--live and --serve show the recording: expected recording.enabled to be true, was false.")
    view = _open_viewer(kind)
    flight = RunViewer(view)
    try:
        yield flight
    finally:
        flight.end()
        view.close()


def serve_until_closed(recording: Path) -> None:
    """Serve a complete recording to browsers of this machine until Ctrl-C."""
    from gslcosim.recordings.viewer import N_TRIES

    for _ in range(N_TRIES):
        view = _open_viewer("browser")
        try:
            view.show(recording, lambda: True)
            if _wait_until_closed(view):
                return
        finally:
            view.close()


def _open_viewer(kind: "ViewerKind") -> "LiveViewer":
    from gslcosim.base.processes import build_parent_death_prefix
    from gslcosim.recordings.viewer import LiveViewer

    return LiveViewer(kind, lambda address: write_note(f"Watch it at {address}"), prefix=build_parent_death_prefix())


# Return whether all of the recording was shown.
def _wait_until_closed(view: "LiveViewer") -> bool:
    is_shown = False
    try:
        view.wait_until_shown()
        is_shown = True
        if view.is_open:
            write_note("The viewer stays open until Ctrl-C.")
        view.wait_until_closed()
    except RecordingError as error:
        # The recording is complete without the viewer.
        write_note(str(error))
    except KeyboardInterrupt:
        return True
    return is_shown


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        nargs="*",
        metavar="RUN",
        help=(
            "a run (folder, recording or id) or an environment folder (default: the newest run); "
            "several runs of one room appear together"
        ),
    )
    outputs = parser.add_mutually_exclusive_group()
    outputs.add_argument("--screenshot", type=Path, metavar="FILE", help="write an image to FILE, without a window")
    outputs.add_argument(
        "--web", action="store_true", help="serve a page for a browser on this machine, until Ctrl-C; needs no screen"
    )
    parser.add_argument(
        "--window-size", type=_size, default=(1600, 1000), metavar="WxH", help="size of the image (default: 1600x1000)"
    )
    add_runs_dir_option(parser)


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{1,4})x([1-9]\d{1,4})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"expected width x height in pixels like 1600x1000, was '{text}'")
    return int(match[1]), int(match[2])


def is_environment(runs: Sequence[str]) -> bool:
    """Return whether the first of the words for runs is the folder of an environment."""
    return bool(runs) and (Path(runs[0]) / ENVIRONMENT_HEADER).is_file()


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.recordings.viewer import open_viewer, screenshot

    if len(arguments.runs) > 1 or is_environment(arguments.runs):
        remedy = find_remedy("commands", "view --align") or ""
        raise UsageError(
            f"gslcosim view: expected one run without an extension that shows more, was {' '.join(arguments.runs)}. "
            f"{remedy}"
        )
    run = arguments.runs[0] if arguments.runs else None
    recording = find_in_run(run, runs_dir=arguments.runs_dir, file_name=RECORDING)
    if arguments.screenshot:
        screenshot(recording, arguments.screenshot, window_size=arguments.window_size)
        write(str(arguments.screenshot))
    elif arguments.web:
        serve_until_closed(recording)
    else:
        open_viewer(recording)
    return 0


COMMAND = Command(
    name="view",
    summary="open the recording of a run, or an environment, in the viewer, or save an image",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
