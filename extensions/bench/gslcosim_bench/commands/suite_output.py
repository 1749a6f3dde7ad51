"""Output of `gslcosim bench`: progress of suites, plans and summaries."""

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import table

if TYPE_CHECKING:
    from gslcosim_bench.cases import Plan
    from gslcosim_bench.cases.models import Shard, Trial
    from gslcosim_bench.execution.runner import Progress, RunSummary
    from gslcosim_bench.merge import MergeSummary
    from gslcosim_bench.report.writer import WrittenReport

# Of suites, in a pipe.
_BAR = 20
_MOST_ENTRIES_IN_LINE = 6
# Of the leaderboard after a run.
_MOST_RANKED = 20
_REPORT_ONLY = ("Worst quarter", "Lift [points]", "SPL")


def plan_to_json(plan: "Plan", trials: "Sequence[Trial]", *, n_workers: int) -> dict[str, Any]:
    """Return the text of a plan.

    Args:
        n_workers: How many would fly at the same time.
    """
    from gslcosim_bench.cases.plan import BYTES_PER_TRIAL, OVERHEAD_S, PLUME_S, ROOM_S, measured_pace

    share = len(trials) / plan.n_trials
    rooms, plumes = {trial.room for trial in trials}, {trial.tape for trial in trials if trial.tape}
    flying_s = (plan.sim_s * share / measured_pace() + OVERHEAD_S * len(trials)) / n_workers
    preparing_s = (ROOM_S * len(rooms) + PLUME_S * len(plumes)) / n_workers
    return {
        "suite": plan.loaded.suite.name,
        "suite_hash": plan.suite_hash,
        "n_trials": len(trials),
        "n_cases": len({trial.case for trial in trials}),
        "n_controls": sum(trial.is_control for trial in trials),
        "n_rooms": len(rooms),
        "n_plumes_on_tape": len(plumes),
        "entries": dict(Counter(trial.entry for trial in trials)),
        "scenarios": dict(Counter(trial.scenario for trial in trials)),
        "dropped": [asdict(each) for each in plan.dropped],
        "moved": [asdict(each) for each in plan.moved],
        "most_simulated_h": round(plan.sim_s * share / 3600, 2),
        "expected_flying_s": round(flying_s),
        "expected_preparing_s": round(preparing_s),
        "expected_disk_mb": round(BYTES_PER_TRIAL * len(trials) / 1e6, 1),
        "n_workers": n_workers,
    }


def format_plan(plan: "Plan", fields: dict[str, Any]) -> str:
    """Return a plan for people."""
    scenarios = fields["scenarios"]
    cases = Counter(case.scenario for case in plan.cases)
    rows = [(name, str(cases[name]), str(n)) for name, n in scenarios.items()]
    lines = [
        f"{fields['suite']}: {fields['n_trials']} trials of {len(fields['entries'])} entries in {fields['n_cases']} "
        f"cases, {fields['n_controls']} of them without gas",
        table(("SCENARIO", "CASES", "TRIALS"), rows),
        f"Entries: {', '.join(fields['entries'])}",
        f"Prepared once: {fields['n_rooms']} rooms, {fields['n_plumes_on_tape']} plumes on tape "
        f"(up to {_duration(fields['expected_preparing_s'])} where the cache has none)",
        f"Flown: at most {fields['most_simulated_h']:g} h of simulated time, about "
        f"{_duration(fields['expected_flying_s'])} with {fields['n_workers']} workers, "
        f"{fields['expected_disk_mb']:g} MB",
    ]
    lines += [
        f"Moved: the start of {each['agent']} in {each['case']}, from {each['from_m']} to {each['to_m']} m"
        for each in fields["moved"]
    ]
    if fields["dropped"]:
        lines.append(f"Left out: {len(fields['dropped'])} combinations that are no case:")
        lines += [f"  {each['case']}: {each['reason']}" for each in fields["dropped"][:10]]
        if len(fields["dropped"]) > 10:
            lines.append(f"  and {len(fields['dropped']) - 10} more (--json has all)")
    return "\n".join(lines)


@contextlib.contextmanager
def show_suite_progress(title: str, *, is_quiet: bool) -> "Iterator[Callable[[Progress], None]]":
    """Yield what a suite reports to: a live line on a terminal, a line now and then in a pipe."""
    n_told = 0

    def show(progress: "Progress") -> None:
        nonlocal n_told
        for text in progress.lost[n_told:]:
            line.note(f"{title}: {text}")
        n_told = max(n_told, len(progress.lost))
        text, fraction = format_progress(progress), progress.done / progress.total if progress.total else 1.0
        bar = f"[{'#' * round(fraction * _BAR):<{_BAR}}]"
        line.show(text, fraction=fraction, plain=f"{bar} {text}", is_last=progress.done == progress.total)

    with ProgressLine(title, is_quiet=is_quiet) as line:
        yield show


def format_progress(progress: "Progress") -> str:
    """Return the state of a run in one line: what is done, the time left, and the time that processors worked."""
    done, total = progress.done, progress.total
    left = f", {_duration(progress.left_s)} left" if progress.left_s and done < total else ""
    cpu = f", {_duration(progress.cpu_s)} of processor time" if progress.cpu_s >= 1 else ""
    if progress.phase != "trials":
        return f"{progress.phase} {done}/{total}, {_duration(progress.elapsed_s)}{left}{cpu}"
    rate = f"{progress.rate_per_s:.1f}/s" if progress.rate_per_s >= 1 else f"{progress.rate_per_s * 60:.1f}/min"
    lost = f" | {progress.n_without_result} without result" if progress.n_without_result else ""
    return f"{done}/{total} trials, {rate}{left}{cpu} | found: {_found(progress)}{lost}"


# By entry, where a line has room for all of them.
def _found(progress: "Progress") -> str:
    if not progress.flown:
        return "none yet"
    if len(progress.flown) > _MOST_ENTRIES_IN_LINE:
        return f"{sum(progress.successes.values())} of {sum(progress.flown.values())}"
    return ", ".join(f"{name} {progress.successes.get(name, 0)}/{n}" for name, n in sorted(progress.flown.items()))


def format_status_of_results(fields: dict[str, Any]) -> str:
    """Return the state of a folder of results, as `bench status` has it, for a person."""
    rows, planned, now = fields["n_rows"], fields["n_planned"], fields["run"]
    have = f"{rows} of {planned} planned trials" if planned is not None else f"{rows} trials"
    lost = f", {fields['n_without_result']} of them without result" if fields["n_without_result"] else ""
    lines = [f"{fields['folder']}: {fields['state']}, {have}{lost}."]
    if now is not None:
        left = f", {_duration(now['left_s'])} left" if now["left_s"] else ""
        lines.append(
            f"Process {now['process']}: {now['phase']} {now['done']}/{now['total']} in {_duration(now['elapsed_s'])}"
            f"{left}, {_duration(now['cpu_s'])} of processor time."
        )
    if fields["state"] == "not complete":
        lines.append("Repeat the command that ran it to resume.")
    if fields["entries"]:
        cells = [(name, str(each["found"]), str(each["n"])) for name, each in fields["entries"].items()]
        lines.append(table(("ENTRY", "FOUND", "FLOWN"), cells))
    return "\n".join(lines)


def format_suite_summary(summary: "RunSummary", report: "WrittenReport | None", shard: "Shard | None" = None) -> str:
    """Return the summary of a run of a suite or of a shard of it."""
    wall = summary.wall
    lines = []
    if summary.put_aside is not None:
        lines.append(f"Earlier results of another version are in {summary.put_aside}.")
    what = "Interrupted: " if summary.is_interrupted else ""
    lines.append(
        f"{what}{summary.n_flown} trials flown, {summary.n_flown_before} were there already, of {summary.n_chosen} "
        f"chosen and {summary.n_planned} planned."
    )
    if summary.n_without_result:
        lines.append(f"{summary.n_without_result} without result: see status and fault in the report.")
    if "busy_share" in wall:
        lines.append(
            f"Time: {_duration(wall['total_s'])}, of which preparing {_duration(wall['preparing_s'])}; workers busy "
            f"{100 * wall['busy_share']:.0f} % of the time after that, flying {100 * wall['flying_share']:.0f} %; "
            f"{wall['jobs']} workers, at most {wall['peak_worker_mb']:.0f} MB each"
            + (f", {_duration(wall['cpu_s'])} of processor time." if wall.get("cpu_s") else ".")
        )
    if summary.is_interrupted:
        lines.append("Repeat the command to resume.")
    lines += _leaderboard_lines(report)
    lines.append(f"Results: {summary.folder}" + (f"\nReport: {report.page}" if report else ""))
    if shard is not None:
        lines.append(f"Shard {shard}. When all have run: gslcosim bench merge FOLDER... --out FOLDER")
    return "\n".join(lines)


# The beginning of the report's leaderboard, with columns that fit in a terminal, where anything was flown.
def _leaderboard_lines(report: "WrittenReport | None") -> list[str]:
    if report is None or not report.leaderboard[1]:
        return []
    headings, rows = report.leaderboard
    kept = [i for i, heading in enumerate(headings) if heading not in _REPORT_ONLY]
    shown = [[row[i] for i in kept] for row in rows[:_MOST_RANKED]]
    lines = ["", table([headings[i] for i in kept], shown)]
    if len(rows) > len(shown):
        lines.append(f"{len(rows) - len(shown)} more entries are in {report.page.parent / 'summary.md'}.")
    return [*lines, ""]


def format_merge(summary: "MergeSummary", report: "WrittenReport | None") -> str:
    """Return the summary of a merge, with what is missing."""
    found = summary.n_shards - len(summary.missing)
    lines = [f"{summary.n_trials} of {summary.n_chosen} trials, from {found} of {summary.n_shards} shards."]
    if summary.missing:
        lines.append(f"Missing: {', '.join(summary.missing)}")
    lines += _leaderboard_lines(report)
    lines.append(f"Results: {summary.folder}" + (f"\nReport: {report.page}" if report else ""))
    return "\n".join(lines)


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "?"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
