"""`gslcosim bench failures`: cases in which a method fails and the oracle does not."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command, parse_positive_number, parse_whole_number
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, table, write, write_json, write_note
from gslcosim_bench.commands.study_output import RESULTS_DIR
from gslcosim_bench.commands.suite_output import format_progress
from gslcosim_bench.commands.workers import add_worker_arguments, add_yes_option, confirm_put_aside, start_pool

if TYPE_CHECKING:
    from gslcosim_bench.execution.runner import Progress
    from gslcosim_bench.studies.failures import FailureSearch, FinderProgress

EXAMPLES = """  gslcosim bench failures surge_cast --budget 40
  gslcosim bench failures infotaxis --in cluttered_halls --budget 400 --film 3
  gslcosim bench failures mine.py --in my_room.yaml --vary gas.sources[0].filaments_per_s=3:30:log
  gslcosim bench failures casting --vary agents[0].sensors[0].model=pid,tgs2600"""

_LISTED = 8
_FILM_SPEED = 16.0
_FILM_SIZE_PX = (640, 360)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("method", metavar="METHOD", help="a bundled method, or a .py file")
    parser.add_argument(
        "--in",
        dest="space",
        default="open_halls",
        metavar="SPACE",
        help="a family of cases, or a scenario with --vary: a file or a bundled name (default: open_halls)",
    )
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="PATH=VALUES",
        help="more that is searched: PATH=LEAST:MOST, with :log, or PATH=VALUE,VALUE; repeatable",
    )
    parser.add_argument(
        "--sensors-by-method",
        action="store_true",
        help="fly with the sensors that the method's card asks for (default: those of the scenario)",
    )
    parser.add_argument(
        "--budget",
        type=parse_positive_number,
        default=200,
        metavar="N",
        help="number of runs, those of the oracle included (default: 200)",
    )
    parser.add_argument(
        "--seed", type=parse_whole_number, default=0, metavar="N", help="seed of the search and its runs (default: 0)"
    )
    parser.add_argument(
        "--film",
        type=parse_positive_number,
        metavar="N",
        help="film the N worst cases, method beside oracle (default: none)",
    )
    add_worker_arguments(parser)
    parser.add_argument("--results", type=Path, metavar="DIR", help="results folder (default: below results/)")
    add_yes_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases.models import LimitsSpec
    from gslcosim_bench.studies.failure_output import failures_to_json, write_failures
    from gslcosim_bench.studies.failures import FailureFinder
    from gslcosim_bench.studies.output import write_fields
    from gslcosim_bench.studies.runner import StudyHost
    from gslcosim_bench.studies.search_space import find_space

    space = find_space(arguments.space, arguments.vary)
    stem = Path(arguments.method).stem
    folder = arguments.results or RESULTS_DIR / f"failures_{stem}_{space.name}"
    with ProgressLine(f"failures of {stem}", is_quiet=arguments.json) as line:

        def show(progress: "Progress") -> None:
            fraction = progress.done / progress.total if progress.total else None
            line.show(f"this batch: {format_progress(progress)}", fraction=fraction)

        finder = FailureFinder(
            arguments.method,
            space,
            budget=arguments.budget,
            seed=arguments.seed,
            folder=folder,
            host=StudyHost(
                start_pool=lambda: start_pool(arguments, LimitsSpec()),
                confirm_put_aside=confirm_put_aside(arguments),
                report=show,
            ),
            sensors_by_method=arguments.sensors_by_method,
            tell=lambda progress: line.note(_format_stage(progress)),
        )
        try:
            search = finder.find()
        except KeyboardInterrupt:
            line.end()
            write_note("Interrupted. Repeat the command to resume.")
            return ExitCode.INTERRUPTED
        films = _film(search, folder, arguments, line)
    fields = failures_to_json(search)
    write_fields(folder / "failures.json", fields)
    page = write_failures(search, folder, films)
    if arguments.json:
        write_json(fields)
    else:
        from gslcosim_bench.studies.failure_output import build_fly_command, describe_common

        rate = search.failure_rate
        lines = [
            f"{search.entry} in {search.space.name}: {sum(each.is_failure for each in search.random)} of "
            f"{len(search.random)} random cases are failures, {100 * rate.value:.0f} % ({100 * rate.low:.0f} to "
            f"{100 * rate.high:.0f}); {len(search.outcomes)} cases in {search.n_runs} runs, "
            f"{search.n_runs - search.n_flown_now} of them there already.",
            describe_common(search),
        ]
        if search.failures:
            rows = [
                (
                    each.outcome.case.name,
                    f"{each.severity:.2f}",
                    f"{each.outcome.row['nearest_m']:.1f} of {each.outcome.distance_m:.1f}",
                    f"{each.n_again_failed} of {each.n_again}" if each.n_again else "-",
                    f"{each.n_beside_failed} of {each.n_beside}" if each.n_beside else "-",
                    build_fly_command(folder, each.outcome),
                )
                for each in search.failures[:_LISTED]
            ]
            heads = ("CASE", "SEVERITY", "NEAREST m", "OTHER SEEDS", "BESIDE IT", "FLY AGAIN")
            lines += ["", table(heads, rows), ""]
            if len(search.failures) > _LISTED:
                lines.append(f"{len(search.failures) - _LISTED} more are in failures.json.")
        write("\n".join([*lines, f"Results: {folder} (failures.json, failures.md)", f"Page: {page}"]))
    return 0


def _format_stage(progress: "FinderProgress") -> str:
    return (
        f"{progress.n_runs} of {progress.budget} runs, {progress.n_cases} cases, {progress.n_failures} failures "
        f"(now: {progress.phase})"
    )


def _film(search: "FailureSearch", folder: Path, arguments: argparse.Namespace, line: ProgressLine) -> dict[str, Path]:
    if not arguments.film or not search.failures:
        return {}
    from gslcosim_bench.cases.models import LimitsSpec
    from gslcosim_bench.execution.verification import RepeatableResults, record_trial_again
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_data.film import FilmSegment, render_frames, write_film
    from gslcosim_data.run import open_run

    again = RepeatableResults(ResultsFolder(folder))
    films: dict[str, Path] = {}
    (folder / "films").mkdir(exist_ok=True)
    pool = start_pool(arguments, LimitsSpec())
    try:
        for i, each in enumerate(search.failures[: arguments.film]):
            line.count(i, min(arguments.film, len(search.failures)), phase="films")
            rows = [row for row in (each.outcome.row, each.outcome.oracle) if row is not None]
            places = [record_trial_again(again, again.trials[row["trial"]], pool, is_trusted=True)[0] for row in rows]
            runs = [open_run(place) for place in places]
            cuts = [FilmSegment.of(run, from_s=None, to_s=None, speed=_FILM_SPEED) for run in runs]
            cut = max(cuts, key=lambda one: one.to_s)
            path = folder / "films" / f"{each.outcome.case.name}.webp"
            write_film(render_frames(runs, cut, _FILM_SIZE_PX, has_chase_view=False), path)
            films[each.outcome.case.name] = path
    finally:
        pool.close()
    return films


COMMAND = Command(
    name="failures",
    summary="search for cases in which a method fails and the oracle does not, with pictures and films",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
