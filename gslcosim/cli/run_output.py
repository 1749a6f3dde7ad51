"""Output of runs and of suites: live lines, progress, plans and summaries."""

import contextlib
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.cli.arguments import RECORDING
from gslcosim.cli.progress import ProgressLine, RemainingTime
from gslcosim.cli.terminal import table, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.status import RunResult, RunStatus
    from gslcosim_archive.signing.signed_results import SignedResults
    from gslcosim_archive.submissions import Ranking
    from gslcosim_bench.cases import Plan
    from gslcosim_bench.cases.models import Shard, Trial
    from gslcosim_bench.execution.runner import Progress, RunSummary
    from gslcosim_bench.execution.verification import Verification
    from gslcosim_bench.merge import MergeSummary
    from gslcosim_bench.report.writer import WrittenReport

Report = Callable[["RunStatus"], None]

_ENDINGS = {
    "success": "The source was found",
    "time_limit": "The time was up",
    "collision": "A vehicle collided",
    "agent_failed": "The agent failed",
    "declared": "The agent declared the source",
    "out_of_bounds": "A vehicle left the room",
    "interrupted": "Interrupted",
    "cut": "The replay ended as asked",
    "timeout": "Nothing moved any more",
    "simulation_fault": "The simulation failed",
}


@contextlib.contextmanager
def show_run_progress(title: str, *, is_quiet: bool) -> Iterator[Report]:
    """Yield what a run reports to: a live line on a terminal, a few plain lines in a pipe, or nothing.

    Args:
        title: What flies, at the beginning of the live line.
        is_quiet: Whether to show nothing.
    """
    if is_quiet:
        yield lambda _: None
    elif sys.stderr.isatty():
        with ProgressLine(title, is_quiet=False) as line:
            remaining = RemainingTime()

            # The share that is done has a bar of its own.
            def draw(status: "RunStatus") -> str:
                left = remaining.estimate(status.text, status.fraction)
                return ", ".join(filter(None, (format_status(status), left)))

            yield lambda status: line.show(lambda: draw(status), fraction=status.fraction)
    else:
        yield PlainLines(title)


# How often a pipe gets the time that is left of one piece of work [s].
_REMINDER_EVERY_S = 30.0


class PlainLines:
    """One line for each piece of preparation, each state of the run, and what takes too long: for logs and pipes.

    A piece of preparation that takes long has a line now and then with the time that is left.
    """

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        """Take what begins each line, and the clock [s]."""
        self._title = title
        self._last = ""
        self._clock = clock
        self._written_at_s = 0.0
        self._remaining = RemainingTime(clock)

    def __call__(self, status: "RunStatus") -> None:
        """Write the status when it is a new one."""
        is_told = status.state == "preparing" or (status.state == "flying" and status.text)
        other = f"{status.state} {status.is_late} {status.is_compiling}"
        piece = (status.text or format_status(status)) if is_told else other
        left = self._remaining.describe(piece, status.fraction) if status.state == "preparing" else ""
        is_due = bool(left) and self._clock() - self._written_at_s >= _REMINDER_EVERY_S
        if piece == self._last and not is_due:
            return
        self._last, self._written_at_s = piece, self._clock()
        write_note(f"{self._title}: {', '.join(filter(None, (format_status(status), left)))}")


def format_status(status: "RunStatus") -> str:
    """Return the status in words: `flying, 84.3 s simulated, 212 x real time`."""
    parts = [] if status.state == "preparing" and status.text else [status.state]
    if status.sim_time_s > 0:
        parts += [f"{status.sim_time_s:.1f} s simulated", f"{status.real_time_factor:.0f} x real time"]
    if status.text:
        parts.append(status.text)
    return ", ".join(parts)


def format_summary(flight: "RunResult") -> str:
    """Return the end of a run for a person: what happened, each agent's figures, and where everything is."""
    result = flight.result
    reason = str(result.get("end_reason", ""))
    lines = [f"{_ENDINGS.get(reason, reason)} after {result.get('sim_time_s', 0.0):.1f} s of simulated time.", ""]
    if agents := result.get("agents"):
        lines += [format_agents_table(agents, result.get("sandboxes", {})), ""]
    from gslcosim.validity.findings import format_validity

    agent_faults = [fault for fault in result.get("faults", []) if result.get("valid")]
    lines += [f"{fault['participant']}, tick {fault['tick']}: {fault['text']}" for fault in agent_faults]
    if "validity" in result:
        lines += [*format_validity(result["validity"]), ""]
    return "\n".join([*lines, *_paths(flight.run_dir, result)])


def format_agents_table(agents: list[dict[str, Any]], sandboxes: dict[str, str]) -> str:
    """Return one row an agent with the figures that matter, and what its process was confined by."""
    headings = (
        "agent",
        "method",
        "outcome",
        "time to source",
        "commands",
        "path",
        "overhead",
        "distance at the end",
        "sandbox",
    )
    rows = [
        (
            str(agent["name"]),
            str(agent.get("method", "-")),
            str(agent["outcome"]).replace("_", " "),
            _figure(agent["time_to_source_s"], "{:.1f} s"),
            _figure(agent["steps"], "{}"),
            _figure(agent["path_length_m"], "{:.1f} m"),
            _figure(agent["movement_overhead"], "{:.2f}"),
            _figure(agent["final_distance_m"], "{:.2f} m"),
            sandboxes.get(agent["name"], "-"),
        )
        for agent in agents
    ]
    return table(headings, rows)


def _paths(run_dir: Path, result: dict[str, Any]) -> list[str]:
    seconds, factor = result.get("flight_wall_s", 0.0), result.get("real_time_factor", 0.0)
    lines = [f"speed      {factor:g} x real time"] if factor else []
    if factor and (whole := result.get("wall_time_s", 0.0)):
        preparation = result.get("preparation_s", 0.0)
        rest = max(whole - preparation - seconds, 0.0)
        lines.append(
            f"time       {whole:.1f} s: {preparation:.1f} s room and wind, {seconds:.1f} s run, "
            f"{rest:.1f} s start and end"
        )
    if pace := result.get("pace"):
        lines.append(f"pace       {_pace_text(pace)}")
    lines.append(f"run        {run_dir}")
    if (recording := run_dir / RECORDING).exists():
        lines += [f"recording  {recording}", f"open it    gslcosim view {run_dir}"]
    if not result.get("valid") or result.get("faults"):
        lines.append(f"logs       {run_dir / 'logs'}")
    return lines


def _pace_text(pace: dict[str, float]) -> str:
    text = f"{pace['factor']:g} x real time, at worst {pace['worst_lag_s']:g} s late"
    if pace["late_share"]:
        text += f"; {100 * pace['late_share']:.1f} % of the ticks late"
    return f"{text}, {pace['lost_s']:g} s lost" if pace["lost_s"] else text


def _figure(value: object, pattern: str) -> str:
    return "-" if value is None else pattern.format(value)


# Of suites, in a pipe.
_BAR = 20
_MOST_ENTRIES_IN_LINE = 6
# Of the leaderboard after a run.
_MOST_RANKED = 20
_REPORT_ONLY = ("Worst quarter", "Lift [points]", "SPL")


def plan_to_json(plan: "Plan", trials: "Sequence[Trial]", *, n_workers: int) -> dict[str, Any]:
    """Return the text of a plan.

    Args:
        plan: The plan.
        trials: Those of its trials that are meant.
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
        "dropped": [{"case": each.case, "reason": each.reason} for each in plan.dropped],
        "moved": [{"case": m.case, "agent": m.agent, "from_m": m.from_m, "to_m": m.to_m} for m in plan.moved],
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


def verification_to_json(verification: "Verification") -> dict[str, Any]:
    """Return the result of a verification as JSON has it."""
    from gslcosim_archive.audits import max_false_rows

    return {
        "rows": verification.n_rows,
        "max_false": max_false_rows(verification.n_rows, verification.n_sampled, len(verification.differences)),
        "entries": {
            entry: {
                "rows": n,
                "sample": n_drawn,
                "different": n_wrong,
                "max_false": max_false_rows(n, n_drawn, n_wrong),
            }
            for entry, (n, n_drawn, n_wrong) in verification.by_entry.items()
        },
        "sample": verification.n_sampled,
        "same": verification.n_sampled - len(verification.differences),
        "missing": verification.n_missing,
        "sandboxes": dict(verification.sandboxes),
        "differences": [
            {"trial": d.trial, "case": d.case, "entry": d.entry, "columns": d.columns} for d in verification.differences
        ],
    }


def format_verification(verification: "Verification") -> str:
    """Return the result of a verification as text."""
    from gslcosim.runtime.processes.sandbox.selection import is_sandboxed

    n, different = verification.n_sampled, verification.differences
    started = ", ".join(f"{count} {kind}" for kind, count in sorted(verification.sandboxes.items()))
    note = f"Sandbox of agents: {started or 'nothing was flown'}."
    if any(not is_sandboxed(kind) for kind in verification.sandboxes):
        note += " Agents without one could read the truth; without --trusted all of them are in one."
    if verification.n_missing:
        note += (
            f"\n{verification.n_missing} trials of the suite have no row, so that nobody can tell what came of them: "
            "bench rank does not take these results for verified."
        )
    note = f"{format_false_rows(verification)}\n{note}"
    if not different:
        return f"{n} of {n} flights came out the same: digests and all figures.\n{note}"
    lines = [f"{len(different)} of {n} flights came out differently:"]
    for each in different:
        name, (before, now) = next(iter(each.columns.items()))
        more = f" and {len(each.columns) - 1} other columns" if len(each.columns) > 1 else ""
        lines.append(f"  {each.trial} {each.case}, {each.entry}: {name} was {before}, is {now}{more}")
    return "\n".join([*lines, note])


def format_false_rows(verification: "Verification") -> str:
    """Return how many rows can still be false, in a sentence and for each entry."""
    from gslcosim_archive.audits import max_false_rows

    n, n_drawn, n_wrong = verification.n_rows, verification.n_sampled, len(verification.differences)
    most = max_false_rows(n, n_drawn, n_wrong)
    least = f"at least {n_wrong} and, " if n_wrong else ""
    text = f"Of {n} rows with a flight {least}at 95 % confidence, at most {most} are false: {100 * most / n:.1f} %."
    entries = ", ".join(
        f"{entry} {max_false_rows(n_of, drawn, wrong)} of {n_of} ({drawn} drawn)"
        for entry, (n_of, drawn, wrong) in verification.by_entry.items()
    )
    return f"{text}\nOf one entry at most: {entries}."


def signature_to_json(signed: "SignedResults | None") -> dict[str, Any] | None:
    """Return a signature as JSON has it; None without one."""
    if signed is None:
        return None
    return {
        "key": signed.key.text,
        "fingerprint": signed.key.fingerprint,
        "author": signed.author,
        "signed_at": signed.signed_at,
        "statement_hash": signed.statement_hash,
        "suite_hash": signed.suite_hash,
        "rows": signed.n_rows,
    }


def format_signature(signed: "SignedResults | None") -> str:
    """Return who has signed results, in a sentence."""
    if signed is None:
        return "Nobody has signed these results."
    author = f" ({signed.author})" if signed.author else ""
    return (
        f"Signed by {signed.key.fingerprint}{author}, {signed.signed_at}: {signed.n_rows} rows and all files as "
        f"signed, statement {signed.statement_hash}."
    )


def format_ranking(ranking: "Ranking") -> str:
    """Return a merged leaderboard: the places each entry may have, who has been verified, and what follows from it."""
    from gslcosim_bench.report.conclusions import CONCLUDED, NOT_CONCLUDED
    from gslcosim_bench.report.number_formats import format_ranks

    view = ranking.leaderboard["views"][0]
    rows = [
        (
            format_ranks(row["rank"], row["last_rank"]),
            row["entry"],
            _format_figure(row["score"], 1.0, 3),
            f"{_format_figure(row['success'], 100.0, 0)} %",
            _format_figure(row["time_s"], 1.0, 0),
            str(row["n"]),
            ranking.submissions[row["entry"]],
            _verified(ranking.verified[row["entry"]]),
            (ranking.keys[row["entry"]] or "nobody")[:_KEY_WIDTH],
        )
        for row in view["rows"]
    ]
    head = ("RANK", "ENTRY", "SCORE", "SUCCESS", "TIME [s]", "N", "SUBMISSION", "VERIFIED", "SIGNED BY")
    said = ranking.leaderboard["conclusions"]
    parts = ((CONCLUDED, said["holds"]), (NOT_CONCLUDED, said["limits"]))
    lines = [line for title, some in parts if some for line in (f"\n{title}:", *(f"- {text}" for text in some))]
    order = "Highest score first. Intervals are 95 %; RANK is the best and the worst place."
    return f"{table(head, rows)}\n{order}\n" + "\n".join(lines)


# Enough of a fingerprint to tell keys of a table apart; --json has all of it.
_KEY_WIDTH = len("SHA256:") + 12


def _format_figure(figure: dict[str, float] | None, times: float, digits: int) -> str:
    if figure is None:
        return "-"
    value, low, high = (
        "?" if part is None else f"{times * part:.{digits}f}" for part in (figure[k] for k in ("value", "low", "high"))
    )
    return f"{value} [{low}, {high}]"


def _verified(counts: tuple[int, int] | None) -> str:
    return "no" if counts is None else f"{counts[0]} of {counts[1]}"


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "?"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
