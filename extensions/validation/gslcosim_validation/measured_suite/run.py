"""Run of the suite: every entry on every log, with the rows and report of other suites and a page of events."""

import hashlib
import json
import math
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import gslcosim
from gslcosim.base.code_identity import COMPUTING_PACKAGES
from gslcosim.base.errors import UsageError
from gslcosim.runtime.processes.sandbox.selection import NONE_IN_THIS_PROCESS
from gslcosim_bench.cases.models import LOWER_ANCHOR
from gslcosim_bench.store import RESULTS_SCHEMA, TRIAL_COLUMNS, TRIALS, JournalEntry, ResultsFolder, build_tables
from gslcosim_validation.measured_suite.agents import DEFAULT_AGENTS, find_agent_entries
from gslcosim_validation.measured_suite.estimators import ENTRIES, FLOOR, Claim, Entry, is_room
from gslcosim_validation.measured_suite.logs import LogCase, LogSite, load_log_cases
from gslcosim_validation.measured_suite.room_estimators import ROOM_ENTRIES
from gslcosim_validation.measured_suite.scores import LogScore, QuietDay, ReleaseScore, score_claims
from gslcosim_validation.readers.folder import read_measured

SUITE = "measured"
TITLE = "Search on measured air"
QUESTION = "Who finds sources, their places and rates in logs of masts, lasers and rooms?"

_COMPLETED = "flown"
_EMPTY = dict.fromkeys((column.name for column in TRIAL_COLUMNS), None)


@dataclass(frozen=True, kw_only=True)
class LogResult:
    """Result of an entry on a log; `fault` is what the entry did wrong, and then it has no claims.

    `sandbox` is what confined its process, in the words of `result.json`.
    """

    entry: str
    case: LogCase
    score: LogScore
    fault: str
    wall_s: float
    sandbox: str = NONE_IN_THIS_PROCESS


@dataclass(frozen=True, kw_only=True)
class SuiteResult:
    """Results of a run of the suite, and the files that hold them."""

    results: tuple[LogResult, ...]
    folder: Path
    report: Path | None
    page: Path


def choose_entries(only: Sequence[str], agents: Sequence[str], data_dir: Path) -> tuple[Entry, ...]:
    """Return the entries whose names match one of the patterns; all where there is no pattern.

    Args:
        agents: What `find_agent_entries` makes entries of beside the default agents.
    """

    def is_chosen(name: str) -> bool:
        return not only or any(fnmatchcase(name, pattern) for pattern in only)

    own = list(dict.fromkeys(entry.name for entry in (*ENTRIES, *ROOM_ENTRIES)))
    more = find_agent_entries(agents, data_dir, taken=own, is_chosen=is_chosen)
    chosen = (*(entry for entry in (*ENTRIES, *ROOM_ENTRIES) if is_chosen(entry.name)), *more)
    if not chosen:
        names = ", ".join([*own, *DEFAULT_AGENTS, *agents])
        raise UsageError(f"--only entry={','.join(only)}: expected one of {names}, found none.")
    return chosen


def run_measured(
    data_dir: Path,
    folder: ResultsFolder,
    *,
    only: Sequence[str] = (),
    agents: Sequence[str] = (),
    has_report: bool = True,
    progress: Callable[[str, float], None] = lambda text, fraction: None,
) -> SuiteResult:
    """Run entries on the logs of a folder, and write a folder of results.

    Args:
        folder: Of the results; what it has of this suite is replaced.
        agents: Agents that take part beside the bundled entries: names, Python files, suites.
        has_report: Whether to write `report.html` too.
    """
    from gslcosim_bench.report.writer import write_report
    from gslcosim_validation.measured_suite.page import write_page

    cases = load_log_cases(read_measured(data_dir))
    entries = choose_entries(only, agents, data_dir)
    earlier = folder.read_json(folder.manifest).get("suite", SUITE)
    if earlier != SUITE:
        raise UsageError(
            f"{folder.path}: expected a folder of this suite or a new one, was one of suite {earlier}. "
            "Name another with --results."
        )
    with folder.locked():
        began, started_at = time.perf_counter(), datetime.now(UTC)
        pairs = [(entry, case) for case in cases for entry in entries if entry.can_take(case.site)]
        results: list[LogResult] = []
        for i, (entry, case) in enumerate(pairs):
            progress(f"{entry.name} on {case.name}", i / max(len(pairs), 1))
            results.append(run_entry(entry, case))
        results += [score_oracle(case) for case in cases]
        rows = [row for result in results for row in build_rows(result)]
        folder.write_tables(*build_tables([JournalEntry(row, None) for row in rows]))
        wall_s = time.perf_counter() - began
        manifest = _manifest(entries, results, n_rows=len(rows), started_at=started_at, wall_s=wall_s)
        folder.write_json(folder.manifest, manifest)
        page = write_page(folder.path, results)
        report = write_report(folder.path).page if has_report else None
        return SuiteResult(results=tuple(results), folder=folder.path, report=report, page=page)


def run_entry(entry: Entry, case: LogCase) -> LogResult:
    """Run an entry on a log and score its claims; it receives the site and the rows, and nothing of the truth."""
    began = time.perf_counter()
    fault, claims = "", []
    try:
        estimator = entry.build(case.site)
        for row in case.log.rows():
            estimator.observe(row)
        claims = list(estimator.conclude())
    # Any exception is a fault of this method; the others continue.
    except Exception as error:
        fault, claims = f"{type(error).__name__}: {error}", []
    wall_s = time.perf_counter() - began
    score = score_claims(case, claims)
    return LogResult(entry=entry.name, case=case, score=score, fault=fault, wall_s=wall_s, sandbox=entry.sandbox)


def score_oracle(case: LogCase) -> LogResult:
    """Return the result of claims equal to the truth: the bound of every estimator."""
    claims = [
        Claim(
            start_s=release.start_s,
            end_s=release.end_s,
            place=release.place,
            position_m=(float(release.position_m[0]), float(release.position_m[1]))
            if np.isfinite(release.position_m).all()
            else None,
            rate_kg_s=release.rate_kg_s,
            source=release.source,
        )
        for release in case.releases
    ]
    return LogResult(entry=LOWER_ANCHOR, case=case, score=score_claims(case, claims), fault="", wall_s=0.0)


def build_rows(result: LogResult) -> list[dict[str, Any]]:
    """Return the rows of `trials.parquet`: one for each release, and as a control one for each day between them."""
    rows = [_release_row(result, each) for each in result.score.releases]
    return rows + [_quiet_row(result, day) for day in result.score.quiet_days]


def _release_row(result: LogResult, scored: ReleaseScore) -> dict[str, Any]:
    release, site = scored.release, result.case.site
    limit_s = release.end_s - release.start_s
    time_s = min(scored.delay_s, limit_s) if scored.is_exact else limit_s
    n_wrong = sum(1 for claim in scored.claims if scored.release.place is not None and claim.place != release.place)
    place_m = [float(x) if math.isfinite(x) else None for x in release.position_m]
    is_choice = release.place is not None
    return _row(
        result,
        case=f"{result.case.name}/{release.name}",
        varied={"release": release.name.removeprefix("release=")},
        day=int(release.start_s // 86_400),
        time_limit_s=limit_s,
        is_control=False,
        within_m=None if is_choice else result.case.within_m,
        success_of="place" if is_choice or site.places_m else "declaration",
        source_x_m=place_m[0],
        source_y_m=place_m[1],
        source_z_m=place_m[2],
        outcome=scored.outcome,
        success=scored.is_exact,
        time_to_source_s=time_s if scored.is_exact else None,
        time_s=time_s,
        end_s=limit_s,
        score=(1.0 - 0.5 * time_s / limit_s) * 0.5**n_wrong if scored.is_exact else 0.0,
        share_arrived=float(scored.is_exact),
        declared=scored.is_touched,
        first_declared_s=scored.delay_s if scored.is_touched else None,
        declared_error_in_plane_m=scored.place_error_m if math.isfinite(scored.place_error_m) else None,
        n_false_declarations=n_wrong,
        digest=_hash([_claim_fields(claim) for claim in scored.claims]),
    )


def _quiet_row(result: LogResult, day: QuietDay) -> dict[str, Any]:
    date = datetime.fromtimestamp(day.start_s, UTC).date().isoformat()
    return _row(
        result,
        case=f"{result.case.name}/quiet={date}",
        varied={"quiet": date},
        day=int(day.start_s // 86_400),
        time_limit_s=day.quiet_s,
        is_control=True,
        success_of="declaration",
        outcome="false_event" if day.claims else "quiet",
        success=False,
        time_s=day.quiet_s,
        end_s=day.quiet_s,
        score=0.0,
        share_arrived=0.0,
        declared=bool(day.claims),
        n_false_declarations=len(day.claims),
        digest=_hash([_claim_fields(claim) for claim in day.claims]),
    )


def _row(result: LogResult, *, case: str, varied: dict[str, str], day: int, **values: Any) -> dict[str, Any]:
    row = {
        **_EMPTY,
        "trial": _hash([SUITE, case, result.entry, result.case.hash, gslcosim.__version__]),
        "case": case,
        "scenario": result.case.name,
        "family": result.case.name,
        "varied": json.dumps(varied),
        "repetition": 0,
        "entry": result.entry,
        "seed": 0,
        # Releases of a day share their weather.
        "gas_seed": day,
        "knows": "source" if result.entry == LOWER_ANCHOR else "",
        "sensors": _name_sensors(result.case.site),
        "n_robots": len(result.case.site.names),
        "environment_hash": result.case.hash,
        "status": _COMPLETED,
        "agent_faults": result.fault,
        "sandbox": result.sandbox,
        "wall_flying_s": result.wall_s,
        **values,
    }
    if result.fault:
        row |= {"outcome": "agent_failed"}
    assert row.keys() == set(TRIALS.names)
    return row


def _name_sensors(site: LogSite) -> str:
    if is_room(site):
        return "room_sensor"
    return "mast" if site.has_points else "laser_path"


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def _claim_fields(claim: Claim) -> dict[str, Any]:
    return {
        "start_s": claim.start_s,
        "end_s": claim.end_s,
        "place": claim.place,
        "position_m": claim.position_m,
        "rate_kg_s": claim.rate_kg_s if math.isfinite(claim.rate_kg_s) else None,
        "is_upper_bound": claim.is_upper_bound,
        "is_unsure": claim.is_unsure,
        "margin": claim.margin if math.isfinite(claim.margin) else None,
        "confidence": claim.confidence if math.isfinite(claim.confidence) else None,
        "runner_up": claim.runner_up,
    }


def describe_events(results: Sequence[LogResult]) -> list[dict[str, Any]]:
    """Return all events of all entries, as `events.json` has them."""
    return [
        {"entry": result.entry, "log": result.case.name, "is_false": claim in result.score.false_claims}
        | _claim_fields(claim)
        for result in results
        for claim in result.score.claims
    ]


def _manifest(
    entries: Sequence[Entry], results: Sequence[LogResult], *, n_rows: int, started_at: datetime, wall_s: float
) -> dict[str, Any]:
    ran = {result.entry for result in results}
    # An entry of masts and one of rooms may share a name: they are one row of the report.
    listed = {
        e.name: {
            "name": e.name,
            "title": e.title,
            "family": e.family,
            "language": "python",
            "parameters": dict(e.parameters),
        }
        for e in entries
        if e.name in ran
    }
    oracle = {"name": LOWER_ANCHOR, "title": "The truth", "family": "anchor", "language": "python", "parameters": {}}
    logs = {result.case.name: result.case.hash for result in results}
    return {
        "schema": RESULTS_SCHEMA,
        "suite": SUITE,
        "title": TITLE,
        "question": QUESTION,
        "seed": 0,
        "suite_hash": _hash(logs),
        "sandbox": "optional",
        "versions": {
            "gslcosim": gslcosim.__version__,
            "python": sys.version.split()[0],
            **{name: version(name) for name in COMPUTING_PACKAGES},
        },
        "machine": {"platform": platform.platform()},
        "entries": [*listed.values(), oracle],
        "scenarios": [{"name": name, "family": name, "title": name} for name in logs],
        "n_planned": n_rows,
        "anchors": {"lower": LOWER_ANCHOR, **({"upper": FLOOR} if FLOOR in ran else {})},
        "wall": {"started_at": started_at.isoformat(timespec="seconds"), "jobs": 1, "total_s": wall_s},
        "sessions": [],
    }
