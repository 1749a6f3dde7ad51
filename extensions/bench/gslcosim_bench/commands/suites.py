"""`gslcosim bench`: suites of runs, from the plan to the report."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.bundled import bundled_suites
from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.base.extensions import find_remedy
from gslcosim.cli.arguments import RECORDING, Command, parse_whole_number
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, table, write, write_json
from gslcosim_bench.commands.workers import (
    add_trusted,
    add_worker_arguments,
    add_yes_option,
    check_sandbox_here,
    choose_loader,
    confirm_put_aside,
    start_pool,
)
from gslcosim_bench.suite_kinds import list_suite_kinds

if TYPE_CHECKING:
    from gslcosim_bench.cases import LoadedSuite, Plan
    from gslcosim_bench.cases.models import Selection, Shard, TrialSlot
    from gslcosim_bench.cases.submission_bundles import PreparedBundles

RESULTS_DIR = Path("results")


def _add_suite(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("suite", metavar="SUITE", help="a suite file, or the name of a bundled suite")
    parser.add_argument("--seed", type=parse_whole_number, metavar="N", help="replace the seed of the suite")
    parser.set_defaults(load_suite=None)
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="KEY=PATTERN",
        help=(
            "only trials with this entry, scenario, family, case, repetition, control (yes, no) or "
            "trial, for example entry=e_coli,surge_*; repeatable"
        ),
    )
    parser.add_argument(
        "--filter", metavar="TEXT", help="only cases whose name contains this text or matches this pattern"
    )
    parser.add_argument(
        "--shard",
        metavar="I/N",
        help=("only the I-th of N equal parts, for queues and machines that share nothing; bench merge combines them"),
    )


def _add_run_arguments(parser: argparse.ArgumentParser) -> None:
    _add_suite(parser)
    add_worker_arguments(parser)
    parser.add_argument(
        "--results",
        type=Path,
        metavar="DIR",
        help="results folder (default: results/NAME; for a shard, results/NAME-I-of-N)",
    )
    for kind in list_suite_kinds().values():
        kind.add_arguments(parser)
    parser.add_argument(
        "--bundle",
        type=Path,
        action="append",
        metavar="FILE",
        help="run the method of this bundle of bench pack in a sandbox, on the cases of SUITE; repeatable",
    )
    parser.add_argument("--build", action="store_true", help="run the build commands of the bundles, with your rights")
    parser.add_argument("--retry", action="store_true", help="run trials without a result again")
    parser.add_argument("--no-report", action="store_true", help="write no report")
    add_yes_option(parser)


def _add_report_arguments(parser: argparse.ArgumentParser) -> None:
    _add_results(parser)
    parser.add_argument("--figures", action="store_true", help="also write figures as SVG and PDF")


def _add_show_arguments(parser: argparse.ArgumentParser) -> None:
    _add_results(parser)
    parser.add_argument("--trial", required=True, metavar="ID", help="id of the trial, or its beginning")
    add_trusted(parser)
    parser.add_argument("--no-view", action="store_true", help="do not open the recording")


def _add_merge_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", nargs="+", type=Path, metavar="FOLDER", help="folders of bench run --shard I/N")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of the merged results")
    parser.add_argument("--partial", action="store_true", help="merge even if shards or trials are missing")
    parser.add_argument("--no-report", action="store_true", help="write no report")


def _add_results(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", type=Path, metavar="RESULTS", help="a results folder, for example results/smoke")


def _list(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases import load_suite

    suites = [(name, load_suite(path).suite) for name, path in bundled_suites().items()]
    listed = [(name, suite.title, suite.question) for name, suite in suites]
    listed += [(kind.name, kind.title, kind.question) for kind in list_suite_kinds().values()]
    if arguments.json:
        write_json([{"name": name, "title": title, "question": question} for name, title, question in listed])
    else:
        write(table(("SUITE", "QUESTION"), [(name, question) for name, _, question in listed]))
    return 0


def _plan(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases.models import choose_trials
    from gslcosim_bench.commands.suite_output import format_plan, plan_to_json
    from gslcosim_bench.execution.pool import n_cores

    selection, shard = _chosen(arguments)
    _, plan = _planned(arguments, selection, is_quiet=arguments.json)
    fields = plan_to_json(plan, choose_trials(plan.trials, selection, shard), n_workers=n_cores())
    if arguments.json:
        write_json(fields)
    else:
        write(format_plan(plan, fields))
    return 0


def _run_suite(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim_bench.commands.suite_output import format_suite_summary, show_suite_progress
    from gslcosim_bench.execution.runner import SuiteRun
    from gslcosim_bench.execution.verification import check_bundles
    from gslcosim_bench.store import ResultsFolder

    kinds = list_suite_kinds()
    if arguments.suite in kinds:
        return kinds[arguments.suite].run(arguments)
    if remedy := find_remedy("commands", f"bench run {arguments.suite}"):
        raise UsageError(f"{arguments.suite}: expected a suite that is installed. {remedy}")
    if arguments.build and not arguments.bundle:
        raise UsageError("--build: expected --bundle, whose commands it runs, found none. Add --bundle FILE.")
    for name, option in ((kind.name, option) for kind in kinds.values() for option in kind.options):
        if getattr(arguments, option) is not None:
            raise UsageError(f"--{option}: expected the suite {name}, was {arguments.suite}. Leave the option out.")
    selection, shard = _chosen(arguments)
    bundles = _prepare_bundles(arguments) if arguments.bundle else None
    if bundles is not None:
        arguments.suite = str(bundles.suite)
    loaded, plan = _planned(arguments, selection, is_quiet=arguments.json)
    check_sandbox_here(arguments, plan)
    if bundles is not None:
        check_bundles(plan, bundles.roots)
    name = loaded.suite.name if shard is None else f"{loaded.suite.name}-{shard.index}-of-{shard.count}"
    folder = ResultsFolder(arguments.results or RESULTS_DIR / name)
    with show_suite_progress(loaded.suite.name, is_quiet=arguments.json) as report:
        run = SuiteRun(
            plan,
            folder,
            lambda: start_pool(arguments, loaded.suite.limits),
            selection=selection,
            shard=shard,
            flies_failures_again=arguments.retry,
            confirm_put_aside=confirm_put_aside(arguments),
            report=report,
        )
        summary = run.fly()
    written = None
    if not summary.is_interrupted and not arguments.no_report and shard is None:
        from gslcosim_bench.report.writer import write_report

        written = write_report(folder.path)
    if arguments.json:
        write_json({key: str(v) if isinstance(v, Path) else v for key, v in asdict(summary).items()})
    else:
        write(format_suite_summary(summary, written, shard))
    if summary.is_interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.AGENT_FAILED if summary.n_without_result else 0


def _prepare_bundles(arguments: argparse.Namespace) -> "PreparedBundles":
    from gslcosim_bench.cases import load_suite
    from gslcosim_bench.cases.models import MAX_NAME_LENGTH
    from gslcosim_bench.cases.submission_bundles import prepare_bundles

    loaded = load_suite(arguments.suite)
    ending = "_bundles"
    name = f"{loaded.suite.name[: MAX_NAME_LENGTH - len(ending)]}{ending}"
    results = arguments.results or RESULTS_DIR / name
    return prepare_bundles(arguments.bundle, loaded.path, name=name, results=results, builds=arguments.build)


def _status(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.commands.suite_output import format_status_of_results
    from gslcosim_bench.results import read_state

    fields = read_state(arguments.results)
    if arguments.json:
        write_json(fields)
    else:
        write(format_status_of_results(fields))
    return 0


def _report(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.report.writer import write_report

    page = write_report(arguments.results, figures=arguments.figures).page
    if arguments.json:
        write_json({"report": str(page)})
    else:
        write(f"Report: {page}")
    return 0


def _show(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.execution.pool import LocalPool
    from gslcosim_bench.execution.verification import (
        RepeatableResults,
        check_confinable,
        check_sandbox,
        record_trial_again,
    )
    from gslcosim_bench.store import ResultsFolder

    again = RepeatableResults(ResultsFolder(arguments.results), choose_loader(arguments))
    trial = again.trial(arguments.trial)
    expected = again.rows[trial.id]["digest"]
    check_sandbox(again.plan)
    check_confinable([trial], again.folder.path, is_trusted=arguments.trusted)
    pool = LocalPool(1, again.plan.loaded.suite.limits)
    try:
        place, digest = record_trial_again(again, trial, pool, is_trusted=arguments.trusted)
    finally:
        pool.close()
    is_same = digest == expected
    if arguments.json:
        write_json({"trial": trial.id, "run": str(place), "digest": digest, "expected": expected, "equal": is_same})
    else:
        equal = f"the same as in the row, digest {digest}" if is_same else f"digest {digest}, the row has {expected}"
        write(f"{trial.case}, {trial.entry}, repetition {trial.repetition}: {equal}.\nRun: {place}")
    if not is_same:
        return ExitCode.DIVERGENCE
    if not arguments.no_view and not arguments.json:
        from gslcosim.recordings.viewer import open_viewer

        open_viewer(place / RECORDING)
    return 0


def _merge(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim_bench.commands.suite_output import format_merge
    from gslcosim_bench.merge import merge_shards

    summary = merge_shards(arguments.results, arguments.out, is_partial=arguments.partial)
    report = None
    if not arguments.no_report:
        from gslcosim_bench.report.writer import write_report

        report = write_report(arguments.out)
    if arguments.json:
        write_json(asdict(summary) | {"folder": str(summary.folder)})
    else:
        write(format_merge(summary, report))
    return 0


def _chosen(arguments: argparse.Namespace) -> "tuple[Selection, Shard | None]":
    from gslcosim_bench.cases.models import Selection, Shard

    shard = None if arguments.shard is None else Shard.parse(arguments.shard)
    return Selection.of(arguments.only, arguments.filter), shard


def _planned(arguments: argparse.Namespace, selection: "Selection", *, is_quiet: bool) -> "tuple[LoadedSuite, Plan]":
    from gslcosim_bench.cases import build_plan

    if arguments.suite in list_suite_kinds():
        raise UsageError(f"{arguments.suite}: expected a suite that is flown, was one of logs. Run it with: bench run")
    loaded = choose_loader(arguments)(arguments.suite, seed=arguments.seed, is_flown=True)
    slots: list[TrialSlot] = []

    def wants(slot: "TrialSlot") -> bool:
        slots.append(slot)
        return selection.may_take(slot)

    with ProgressLine("planning", is_quiet=is_quiet) as line:
        plan = build_plan(loaded, wants=wants, progress=lambda n: line.count(n, 0))
    selection.check_patterns(slots)
    return loaded, plan


COMMANDS = (
    Command(
        name="list",
        summary="list the bundled suites",
        examples="  gslcosim bench list",
        add_arguments=add_json_option,
        run=_list,
    ),
    Command(
        name="plan",
        summary="print the runs of a suite and their estimated duration",
        examples="  gslcosim bench plan gsl_bench_2023\n  gslcosim bench plan my_suite.yaml --json",
        add_arguments=_add_suite,
        run=_plan,
    ),
    Command(
        name="run",
        summary="run a suite; repeat the command to resume",
        examples="  gslcosim bench run smoke\n"
        "  gslcosim bench run my_suite.yaml --jobs 4 --results results/mine\n"
        "  gslcosim bench run methods --only entry=surge_cast --filter meander\n"
        "  gslcosim bench run gsl_bench_2023 --ray auto\n"
        "  gslcosim bench run gsl_bench_2023 --shard 2/8",
        add_arguments=_add_run_arguments,
        run=_run_suite,
    ),
    Command(
        name="status",
        summary="print how far a suite run is, from another terminal or afterwards",
        examples="  gslcosim bench status results/smoke\n  gslcosim bench status results/smoke --json",
        add_arguments=_add_results,
        run=_status,
    ),
    Command(
        name="merge",
        summary="merge the shards of a suite into one set of results",
        examples="  gslcosim bench merge results/smoke-1-of-2 results/smoke-2-of-2 --out results/smoke\n"
        "  gslcosim bench merge shards/* --out results/mine --partial",
        add_arguments=_add_merge_arguments,
        run=_merge,
    ),
    Command(
        name="report",
        summary="regenerate report, tables and leaderboard",
        examples="  gslcosim bench report results/smoke\n  gslcosim bench report results/smoke --figures",
        add_arguments=_add_report_arguments,
        run=_report,
    ),
    Command(
        name="show",
        summary="repeat a trial, check that it is equal, and open its recording",
        examples="  gslcosim bench show results/smoke --trial b89dbc2f",
        add_arguments=_add_show_arguments,
        run=_show,
    ),
)
