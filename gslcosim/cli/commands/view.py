"""`gslcosim view`: a run's recording, or an environment, in the viewer or as a picture."""

import argparse
import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import Command
from gslcosim.cli.live_viewer import serve_until_closed
from gslcosim.cli.run_paths import RECORDING, add_runs_dir_option, find_in_run
from gslcosim.cli.terminal import write

EXAMPLES = """  gslcosim view                                   the newest run
  gslcosim view runs/warehouse_empty-seed7-20250101T120000-a1b2c3
  gslcosim view runs/first runs/second            both over one map, their curves over each other
  gslcosim view runs/first runs/second --align first_contact
  gslcosim view --at 120
  gslcosim view hall                              the environment in the folder hall
  gslcosim view --web
  gslcosim view --screenshot run.png --window-size 1600x1000"""


ENVIRONMENT_HEADER = "environment.yaml"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        nargs="*",
        metavar="RUN",
        help="a run's folder, its recording, or its id; or an environment's folder (default: the newest run); several "
        "runs of one room: all in one recording",
    )
    outputs = parser.add_mutually_exclusive_group()
    outputs.add_argument("--screenshot", type=Path, metavar="FILE", help="write a picture to FILE, without a window")
    outputs.add_argument(
        "--web", action="store_true", help="serve a page for a browser of this machine, until Ctrl-C; needs no screen"
    )
    parser.add_argument(
        "--window-size", type=_size, default=(1600, 1000), metavar="WxH", help="the picture's size (default: 1600x1000)"
    )
    parser.add_argument(
        "--at",
        type=_time_s,
        metavar="S",
        help="open one run at a simulated time: it plays from there on; a picture shows it as it was then",
    )
    parser.add_argument(
        "--align",
        choices=("sim_time", "first_contact"),
        help="what several runs share: the simulated time (default), or the time of their first contact with gas",
    )
    add_runs_dir_option(parser)


def _time_s(text: str) -> float:
    try:
        time_s = float(text)
    except ValueError:
        time_s = -1.0
    if not 0 <= time_s < 1e9:
        raise argparse.ArgumentTypeError(f"expected a simulated time in seconds, was '{text}'")
    return time_s


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{1,4})x([1-9]\d{1,4})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"expected width x height in pixels like 1600x1000, was '{text}'")
    return int(match[1]), int(match[2])


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.data.recording.viewer import open_viewer, screenshot

    with _recording(arguments) as recording:
        if arguments.screenshot:
            screenshot(recording, arguments.screenshot, window_size=arguments.window_size)
            write(str(arguments.screenshot))
        elif arguments.web:
            serve_until_closed(recording)
        else:
            open_viewer(recording)
    return 0


# An environment's recording is made to be looked at, and is gone afterwards.
@contextlib.contextmanager
def _recording(arguments: argparse.Namespace) -> Iterator[Path]:
    run = arguments.runs[0] if arguments.runs else None
    is_environment = run is not None and (Path(run) / ENVIRONMENT_HEADER).is_file()
    if arguments.align is not None and len(arguments.runs) < 2:
        raise UsageError("gslcosim view: expected --align with several runs.")
    if arguments.at is not None and (len(arguments.runs) > 1 or is_environment):
        raise UsageError("gslcosim view: expected --at with one run.")
    if len(arguments.runs) < 2 and not is_environment and arguments.at is None:
        yield find_in_run(run, runs_dir=arguments.runs_dir, file_name=RECORDING)
        return
    from gslcosim.base.scratch import ScratchFolder

    with ScratchFolder() as scratch:
        path = scratch.path / RECORDING
        if arguments.at is not None:
            from gslcosim.cli.run_views import record_run_at

            recording = find_in_run(run, runs_dir=arguments.runs_dir, file_name=RECORDING)
            record_run_at(recording, path, arguments.at, is_still=arguments.screenshot is not None)
        elif len(arguments.runs) > 1:
            from gslcosim.cli.run_views import record_runs

            recordings = [find_in_run(run, runs_dir=arguments.runs_dir, file_name=RECORDING) for run in arguments.runs]
            record_runs(recordings, path, is_by_contact=arguments.align == "first_contact")
        else:
            from gslcosim.data.recording.environment_view import record_environment
            from gslcosim.environment.store import load_environment

            record_environment(load_environment(Path(arguments.runs[0]), with_meshes=True), path)
        yield path


COMMAND = Command(
    name="view",
    summary="open the recording of a run, or an environment, in the viewer, or save a picture of it",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
