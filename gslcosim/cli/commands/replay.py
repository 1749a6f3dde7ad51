"""`gslcosim replay`: repeat a run from its inputs."""

import argparse

from gslcosim.cli.arguments import MANIFEST, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.run_output import format_summary, show_run_progress
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

EXAMPLES = """  gslcosim replay runs/warehouse_empty-seed7-20250101T120000-abc123
  gslcosim replay warehouse_empty-seed7-2025 --gas-every 0.1 --slice-cell 0.1
  gslcosim replay runs/night_42 --from 100 --to 130 --gas-every 0.1 --until 130"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", metavar="RUN", nargs="?", help="a run: folder or id (default: the newest)")
    parser.add_argument("--gas-every", type=float, metavar="S", help="record the gas every S seconds of simulated time")
    parser.add_argument("--slice-cell", type=float, metavar="M", help="record gas slices with cells of M metres")
    parser.add_argument("--from", type=float, metavar="S", dest="from_s", help="record from this simulated time on")
    parser.add_argument("--to", type=float, metavar="S", dest="to_s", help="record up to this simulated time")
    parser.add_argument("--no-recording", action="store_true", help="only repeat and compare")
    parser.add_argument("--until", type=float, metavar="S", help="end at this simulated time")
    parser.add_argument(
        "--snapshots-every", type=float, metavar="S", help="take snapshots, for forks, every S simulated seconds"
    )
    parser.add_argument(
        "--from-start", action="store_true", help="repeat the whole run, even if it has a snapshot before --from"
    )
    parser.add_argument("--quiet", action="store_true", help="print only errors and differences")
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.replay.past_run import PastRun
    from gslcosim.runtime.replay.replay import replay_run

    manifest = find_in_run(arguments.run, runs_dir=arguments.runs_dir, file_name=MANIFEST)
    past = PastRun.load(manifest.parent)
    with show_run_progress(f"replay of {past.run_dir.run_id}", is_quiet=arguments.quiet or arguments.json) as report:
        replayed = replay_run(
            past,
            runs_dir=arguments.runs_dir,
            recording=_recording(arguments),
            until_s=arguments.until,
            snapshots_every_s=arguments.snapshots_every,
            uses_snapshots=not arguments.from_start,
            report=report,
        )
    flight, divergence = replayed.flight, replayed.divergence
    if replayed.note:
        write_note(f"{replayed.note} The run was flown from its start.")
    if arguments.json:
        comparison = {
            "replay_of": past.run_dir.run_id,
            "snapshot_tick": replayed.snapshot and replayed.snapshot.tick,
            "ticks_compared": replayed.n_ticks,
            "equal": divergence is None and replayed.n_ticks > 0,
            "divergence": divergence and vars(divergence),
        }
        write_json({**flight.result, "comparison": comparison})
    elif not arguments.quiet:
        write(format_summary(flight))
        if replayed.snapshot is not None:
            write(f"begun at   the snapshot of tick {replayed.snapshot.tick}; nothing before it was flown")
        if replayed.n_ticks == 0:
            write("compared   with nothing: the past run or this one came to no digest")
        elif divergence is None:
            write(f"compared   equal to {past.run_dir.path} in all {replayed.n_ticks} ticks")
    if divergence is not None:
        write_note(
            f"Different from {past.run_dir.path} from tick {divergence.tick} on: participant "
            f"{divergence.participant}, port {divergence.port}: {divergence.text}."
        )
    return replayed.exit_code


def _recording(arguments: argparse.Namespace) -> dict[str, float | bool]:
    asked: dict[str, float | bool | None] = {
        "gas_every_s": arguments.gas_every,
        "slice_cell_m": arguments.slice_cell,
        "from_s": arguments.from_s,
        "to_s": arguments.to_s,
        "enabled": False if arguments.no_recording else None,
    }
    return {key: value for key, value in asked.items() if value is not None}


COMMAND = Command(
    name="replay",
    is_computing=True,
    summary=("repeat a run from its inputs, without its agents; compare it to the bit and record it again"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
