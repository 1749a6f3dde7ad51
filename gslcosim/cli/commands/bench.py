"""`gslcosim bench`: suites of runs, from the plan to the report."""

import argparse
import os
import secrets
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import RECORDING, Command, CommandFamily, parse_positive_number, parse_whole_number
from gslcosim.cli.bench_workers import (
    add_sealed_option,
    add_trusted,
    add_worker_arguments,
    add_yes_option,
    check_sandbox_here,
    choose_loader,
    confirm_put_aside,
    start_pool,
    verify_here,
)
from gslcosim.cli.commands import dataset, failures, sealing, submission, sweep, tune
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, table, write, write_json

if TYPE_CHECKING:
    from gslcosim_bench.cases import LoadedSuite, Plan
    from gslcosim_bench.cases.models import Selection, Shard, TrialSlot
    from gslcosim_bench.cases.submission_bundles import PreparedBundles

EXAMPLES = """  gslcosim bench list
  gslcosim bench plan gsl_bench_2023
  gslcosim bench run smoke
  gslcosim bench run methods --only entry=surge_cast,infotaxis --jobs 2
  gslcosim bench run gsl_bench_2023 --shard 2/8
  gslcosim bench report results/smoke
  gslcosim bench verify results/smoke --sample 5
  gslcosim bench sweep tiny_room --entry dung_beetle --vary leg_m=0.4,0.8,1.6
  gslcosim bench failures surge_cast --budget 40
  gslcosim bench run measured --data FOLDER"""

RESULTS_DIR = Path("results")
# The suite whose gas is a log: nothing of it is flown.
MEASURED = "measured"
MEASURED_QUESTION = "Who finds sources, their places and rates in logs of masts, lasers and rooms? (needs --data)"


def _add_suite(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("suite", metavar="SUITE", help="a suite file, or the name of a bundled suite")
    parser.add_argument("--seed", type=parse_whole_number, metavar="N", help="replace the seed of the suite")
    add_sealed_option(parser)
    _add_selection(parser)
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
    parser.add_argument(
        "--data",
        type=Path,
        metavar="FOLDER",
        help="for the suite measured: folder of measured data (default: measured in GSLCOSIM_REFERENCE)",
    )
    parser.add_argument(
        "--agents",
        nargs="+",
        metavar="AGENT",
        help="for the suite measured: agents that replay the logs, too: bundled names, Python files, or suites",
    )
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


def _add_verify_arguments(parser: argparse.ArgumentParser) -> None:
    _add_results(parser)
    parser.add_argument(
        "--sample", type=parse_positive_number, default=20, metavar="N", help="number of trials (default: 20)"
    )
    parser.add_argument(
        "--seed",
        type=parse_whole_number,
        metavar="N",
        help="seed of the sample (default: a new one)",
    )
    parser.add_argument("--signature-only", action="store_true", help="check the author's signature, and run nothing")
    submission.add_author(parser)
    add_trusted(parser)
    add_worker_arguments(parser)


def _add_merge_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", nargs="+", type=Path, metavar="FOLDER", help="folders of bench run --shard I/N")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of the merged results")
    parser.add_argument("--partial", action="store_true", help="merge even if shards or trials are missing")
    parser.add_argument("--no-report", action="store_true", help="write no report")


def _add_rank_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS", help="results folders of one suite")
    parser.add_argument("--sandboxed", action="store_true", help="refuse runs whose agents had no sandbox")
    parser.add_argument("--signed", action="store_true", help="refuse results that nobody has signed")
    parser.add_argument("--log", type=Path, metavar="LOG", help="refuse results that are not in this log")
    submission.add_head(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write merged results, with a report, to this folder")


def _add_site_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS", help="results folders of one suite")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of the site")


def _add_selection(parser: argparse.ArgumentParser) -> None:
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


def _add_results(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", type=Path, metavar="RESULTS", help="a results folder, for example results/smoke")


def _list(arguments: argparse.Namespace) -> int:
    from gslcosim.base.bundled import bundled_suites
    from gslcosim_bench.cases import load_suite

    suites = {name: load_suite(path).suite for name, path in bundled_suites().items()}
    if arguments.json:
        listed = [{"name": name, "title": s.title, "question": s.question} for name, s in suites.items()]
        write_json([*listed, {"name": MEASURED, "title": "Search on measured air", "question": MEASURED_QUESTION}])
    else:
        rows = [(name, s.question) for name, s in suites.items()]
        write(table(("SUITE", "QUESTION"), [*rows, (MEASURED, MEASURED_QUESTION)]))
    return 0


def _plan(arguments: argparse.Namespace) -> int:
    from gslcosim.cli.run_output import format_plan, plan_to_json
    from gslcosim_bench.cases.models import choose_trials
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

    from gslcosim.cli.run_output import format_suite_summary, show_suite_progress
    from gslcosim_bench.execution.runner import SuiteRun
    from gslcosim_bench.execution.verification import check_bundles
    from gslcosim_bench.store import ResultsFolder

    if arguments.suite == MEASURED:
        return _run_measured(arguments)
    if arguments.build and not arguments.bundle:
        raise UsageError("--build: expected --bundle, whose commands it runs, found none. Add --bundle FILE.")
    for option in ("data", "agents"):
        if getattr(arguments, option) is not None:
            raise UsageError(f"--{option}: expected the suite {MEASURED}, was {arguments.suite}. Leave the option out.")
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


def _run_measured(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases.models import Selection
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_validation.measured_suite.page import HEADINGS, compute_figures, table_rows, to_json
    from gslcosim_validation.measured_suite.run import run_measured

    for option in ("seed", "filter", "shard", "jobs", "ray", "retry", "bundle"):
        if getattr(arguments, option) not in (None, False):
            raise UsageError(f"--{option}: expected a suite that is flown, was {MEASURED}. Leave the option out.")
    patterns = Selection.of(arguments.only).patterns
    if others := [key for key, _ in patterns if key != "entry"]:
        raise UsageError(f"--only {others[0]}: expected entry=NAME with the suite {MEASURED}.")
    folder = ResultsFolder(arguments.results or RESULTS_DIR / MEASURED)
    with ProgressLine(MEASURED, is_quiet=arguments.json) as line:
        done = run_measured(
            _measured_data(arguments.data),
            folder,
            only=[name for _, names in patterns for name in names],
            agents=arguments.agents or (),
            has_report=not arguments.no_report,
            progress=lambda text, fraction: line.show(text, fraction=fraction),
        )
    faults = [result for result in done.results if result.fault]
    if arguments.json:
        figures = [to_json(compute_figures(result)) for result in done.results]
        write_json({"folder": str(done.folder), "report": done.report and str(done.report), "figures": figures})
    else:
        write(table(HEADINGS, table_rows(done.results)))
        write("".join(f"\n{each.entry} failed on {each.case.name}: {each.fault}" for each in faults))
        write(f"Results: {done.page}" + (f"\nReport: {done.report}" if done.report else ""))
    return ExitCode.AGENT_FAILED if faults else ExitCode.SUCCESS


def _measured_data(given: Path | None) -> Path:
    if given is not None:
        return given
    reference = os.environ.get("GSLCOSIM_REFERENCE")
    if not reference:
        raise UsageError(
            f"--data: expected a folder of measured data for the suite {MEASURED}, found none. Give --data FOLDER, or "
            "set GSLCOSIM_REFERENCE to a folder that has one called measured; docs/measured-data.md has the formats."
        )
    return Path(reference) / "measured"


def _status(arguments: argparse.Namespace) -> int:
    from gslcosim.cli.run_output import format_status_of_results
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


def _site(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim_archive.site.writer import write_site

    written = write_site(arguments.results, arguments.out)
    if arguments.json:
        write_json(asdict(written) | {"page": str(written.page)})
    else:
        write(
            f"{written.n_methods} methods, {written.n_cases} cases, {written.n_trials} trials, "
            f"{written.n_bytes / 1e6:.1f} MB.\nSite: {written.page}"
        )
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


def _verify(arguments: argparse.Namespace) -> int:
    from gslcosim.cli.run_output import format_signature, format_verification, signature_to_json, verification_to_json
    from gslcosim_archive.signing.keys import parse_author
    from gslcosim_archive.signing.signed_results import check_signature
    from gslcosim_bench.execution.verification import RepeatableResults
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_bench.verification_marks import results_hash

    # A repeated trial is more exact than a changed checksum.
    folder = ResultsFolder(arguments.results, is_checked=False)
    folder.check()
    author = None if arguments.author is None else parse_author(arguments.author)
    # Before the signature is checked, so that the mark is of what was signed.
    contents = "" if arguments.signature_only else results_hash(folder.path)
    signed = check_signature(folder.path, author=author)
    if arguments.signature_only:
        if signed is None:
            raise UsageError(f"{folder.path}: expected signed results, were unsigned ones. Sign them: bench sign.")
        if arguments.json:
            write_json({"signature": signature_to_json(signed)})
        else:
            write(format_signature(signed))
        return 0
    again = RepeatableResults(folder, choose_loader(arguments))
    seed = secrets.randbelow(1 << 31) if arguments.seed is None else arguments.seed
    verification = verify_here(arguments, again, again.draw(arguments.sample, seed=str(seed)), contents)
    if arguments.json:
        write_json(verification_to_json(verification) | {"seed": seed, "signature": signature_to_json(signed)})
    else:
        write(
            f"{format_signature(signed)}\n{format_verification(verification)}\nThe sample was drawn with --seed {seed}."
        )
    return ExitCode.DIVERGENCE if verification.differences else 0


def _merge(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim.cli.run_output import format_merge
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


def _rank(arguments: argparse.Namespace) -> int:
    from gslcosim.cli.run_output import format_ranking
    from gslcosim_archive.submissions import rank

    if arguments.head is not None and arguments.log is None:
        raise UsageError("--head: expected the log that has this line, --log LOG, found none. Add it.")
    ranking = rank(
        arguments.results,
        arguments.out,
        demands_sandbox=arguments.sandboxed,
        demands_signature=arguments.signed,
        log=arguments.log,
        head=arguments.head,
    )
    if arguments.json:
        write_json(
            {**ranking.leaderboard, "submissions": ranking.submissions, "verified": ranking.verified}
            | {"keys": ranking.keys}
        )
    else:
        write(format_ranking(ranking))
    return 0


def _chosen(arguments: argparse.Namespace) -> "tuple[Selection, Shard | None]":
    from gslcosim_bench.cases.models import Selection, Shard

    shard = None if arguments.shard is None else Shard.parse(arguments.shard)
    return Selection.of(arguments.only, arguments.filter), shard


def _planned(arguments: argparse.Namespace, selection: "Selection", *, is_quiet: bool) -> "tuple[LoadedSuite, Plan]":
    from gslcosim_bench.cases import build_plan, load_suite

    if arguments.suite == MEASURED:
        raise UsageError(f"{MEASURED}: expected a suite that is flown, was one of logs. Run it with: bench run")
    if arguments.sealed is not None:
        if arguments.seed is not None:
            raise UsageError("--seed: expected one seed, were two: the sealed one of --sealed too. Leave one out.")
        from gslcosim_archive.sealing import load_sealed_suite

        loaded = load_sealed_suite(arguments.suite, arguments.sealed, is_flown=True)
    else:
        loaded = load_suite(arguments.suite, seed=arguments.seed, is_flown=True)
    slots: list[TrialSlot] = []

    def wants(slot: "TrialSlot") -> bool:
        slots.append(slot)
        return selection.may_take(slot)

    with ProgressLine("planning", is_quiet=is_quiet) as line:
        plan = build_plan(loaded, wants=wants, progress=lambda n: line.count(n, 0))
    selection.check_patterns(slots)
    return loaded, plan


COMMAND = CommandFamily(
    name="bench",
    summary="run suites of many trials, with statistics and a report",
    examples=EXAMPLES,
    is_computing=True,
    parts=(
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
            "  gslcosim bench run gsl_bench_2023 --shard 2/8\n"
            "  gslcosim bench run measured --data FOLDER --only entry=leak_network",
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
        Command(
            name="verify",
            summary="repeat a sample of the trials and compare all figures",
            examples="  gslcosim bench verify results/smoke --sample 5\n"
            "  gslcosim bench verify submissions/delft --seed 7\n"
            "  gslcosim bench verify submissions/delft --signature-only --author delft.pub",
            add_arguments=_add_verify_arguments,
            run=_verify,
        ),
        Command(
            name="rank",
            summary="merge the results of several authors into one table",
            examples="  gslcosim bench rank results/mine submissions/delft\n"
            "  gslcosim bench rank submissions/* --out results/merged",
            add_arguments=_add_rank_arguments,
            run=_rank,
        ),
        *submission.COMMANDS,
        *sealing.COMMANDS,
        Command(
            name="site",
            summary="write a static site of results: the table, each method, each case, and a player of flights",
            examples="  gslcosim bench site results/smoke --out site\n"
            "  gslcosim bench site results/mine submissions/* --out site",
            add_arguments=_add_site_arguments,
            run=_site,
        ),
        dataset.COMMAND,
        sweep.COMMAND,
        tune.COMMAND,
        failures.COMMAND,
    ),
)
