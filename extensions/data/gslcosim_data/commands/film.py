"""`gslcosim film`: a film of a run, or of several side by side."""

import argparse
from pathlib import Path

from gslcosim.base.errors import UsageError, build_path_error
from gslcosim.cli.arguments import RECORDING, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim film --out search.mp4
  gslcosim film runs/night_42 --out end.mp4 --from 100 --to 130 --speed 2
  gslcosim film RUN_A RUN_B RUN_C --out three.webp --size 960x540 --speed 10"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        nargs="*",
        metavar="RUN",
        help=("a run: folder, recording, or id or its beginning (default: the newest); several become tiles"),
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="output file: .mp4, .gif or .webp")
    parser.add_argument(
        "--speed", type=_speed, default=8.0, metavar="X", help="simulated seconds per second of film (default: 8)"
    )
    parser.add_argument("--from", type=float, dest="from_s", metavar="S", help="simulated time of the start")
    parser.add_argument("--to", type=float, dest="to_s", metavar="S", help="simulated time of the end")
    parser.add_argument(
        "--size", type=_size, default=(1280, 720), metavar="WxH", help="size in pixels (default: 1280x720)"
    )
    parser.add_argument("--follow", metavar="AGENT", help="agent of the room view (default: the first)")
    parser.add_argument("--plan-only", action="store_true", help="render only the plan; needs neither EGL nor OSMesa")
    add_runs_dir_option(parser)
    add_json_option(parser)


def _speed(text: str) -> float:
    speed = float(text)
    if not 0.01 <= speed <= 1000:
        raise argparse.ArgumentTypeError(f"expected a number from 0.01 to 1000, was {text}")
    return speed


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if (
        not (width.isdecimal() and height.isdecimal())
        or not 160 <= int(width) <= 7680
        or not 120 <= int(height) <= 4320
    ):
        raise argparse.ArgumentTypeError(f"expected pixels such as 1280x720, at least 160x120, was {text}")
    # What H.264 wants.
    return int(width) // 2 * 2, int(height) // 2 * 2


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.base.errors import ModelError
    from gslcosim_data.film import FilmSegment, render_frames, write_film
    from gslcosim_data.run import open_run

    names = arguments.runs or [None]
    runs = [open_run(find_in_run(name, runs_dir=arguments.runs_dir, file_name=RECORDING)) for name in names]
    cuts = [FilmSegment.of(run, from_s=arguments.from_s, to_s=arguments.to_s, speed=arguments.speed) for run in runs]
    cut = max(cuts, key=lambda one: one.to_s)
    frames = render_frames(runs, cut, arguments.size, follow=arguments.follow, has_chase_view=not arguments.plan_only)
    n_frames = len(cut.times_s)
    try:
        with ProgressLine("frames", is_quiet=arguments.json) as line:
            write_film(frames, arguments.out, lambda done: line.count(done, n_frames))
    except ModelError as error:
        raise UsageError(f"{error} Or film the plan alone with --plan-only.") from error
    except OSError as error:
        raise build_path_error(error, "--out", "a file that can be written", path=arguments.out) from error
    if arguments.json:
        size = arguments.out.stat().st_size
        write_json(
            {"out": str(arguments.out), "n_frames": n_frames, "bytes": size, "from_s": cut.from_s, "to_s": cut.to_s}
        )
        return 0
    write(str(arguments.out))
    return 0


COMMAND = Command(
    name="film",
    summary="render a film of a run (plan, room view, readings), or tiles of several",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
