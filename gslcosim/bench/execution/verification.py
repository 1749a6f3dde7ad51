"""Verification of results: trials run again, and compared with their rows."""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError
from gslcosim.base.rng import stream
from gslcosim.bench.cases.plan import Plan, build_plan
from gslcosim.bench.cases.suite_files import load_suite
from gslcosim.bench.cases.trials import Trial
from gslcosim.bench.execution.pool import Job, Pool, iterate_results
from gslcosim.bench.execution.sandbox_requirement import confine_trial, find_unsandboxed_rows
from gslcosim.bench.execution.scoring import Row
from gslcosim.bench.store.columns import is_machine_dependent
from gslcosim.bench.store.folder import ResultsFolder
from gslcosim.bench.store.verification_marks import VerificationMark, results_hash, save_mark
from gslcosim.runtime.processes.sandbox.selection import NONE_IN_THIS_PROCESS


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A run that came out differently: the columns, with what was in the row and what came now."""

    trial: str
    case: str
    entry: str
    columns: dict[str, tuple[Any, Any]]


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Result of running a sample again; `sandboxes` counts the sandboxes its agents ran in this time.

    `n_missing` trials of the suite have no row, so that nobody can tell what came of them.
    """

    n_sampled: int
    n_missing: int
    sandboxes: Mapping[str, int]
    differences: tuple[Difference, ...]


class RepeatableResults:
    """A results folder whose runs can be run again: its suite planned again, its rows by trial."""

    def __init__(self, folder: ResultsFolder) -> None:
        """Read the folder.

        Raises:
            UsageError: there are no results, they were made with another version of the software, or without the
                sandbox that the suite demands.
        """
        folder.check()
        self.folder = folder
        self.rows: dict[str, Row] = {row["trial"]: row for row in folder.rows()}
        self.plan: Plan = build_plan(load_suite(folder.suite))
        _check_sandboxes(self.plan, folder, self.rows)
        self.trials = {trial.id: trial for trial in self.plan.trials if trial.id in self.rows}
        manifest = folder.read_json(folder.manifest)
        self.n_missing = len(self.plan.trials) - len(self.trials)
        if len(self.trials) < len(self.rows):
            version = manifest.get("versions", {}).get("gslcosim", "?")
            same = manifest.get("software_hash") == self.plan.software_hash
            cause = "the programs of its agents have changed" if same else f"they were made by gslcosim {version}"
            raise UsageError(
                f"{folder.path}: expected flights that this version can repeat, {len(self.rows) - len(self.trials)} of "
                f"{len(self.rows)} are others ({cause}). Install that version, or fly the suite again with bench run."
            )

        _check_manifest(self.plan, folder, manifest)

    def trial(self, beginning: str) -> Trial:
        """Return the one trial whose id begins like this.

        Raises:
            UsageError: there is none, or there are several.
        """
        found = [trial for key, trial in self.trials.items() if key.startswith(beginning)]
        if len(found) != 1:
            raise UsageError(
                f"--trial: expected the beginning of one trial's id in {self.folder.path}, {beginning!r} begins "
                f"{len(found)}. The report and trials.parquet have the ids."
            )
        return found[0]

    def sample(self, n: int, *, seed: int) -> list[Trial]:
        """Return n of the runs with a result, drawn at random, in the order of the suite."""
        flown = [trial for trial in self.trials.values() if self.rows[trial.id]["status"] == "flown"]
        chosen = stream(seed, "benchmark.verify").permutation(len(flown))[:n]
        return [flown[i] for i in sorted(chosen)]


def verify_trials(
    again: RepeatableResults,
    trials: Sequence[Trial],
    pool: Pool,
    report: Callable[[int, int], None] = lambda _done, _total: None,
    *,
    is_trusted: bool = False,
) -> Verification:
    """Run trials again, compare all columns but those of the clock, and keep the result in this user's state.

    Args:
        again: The folder; nothing is written to it.
        trials: Which of its runs.
        pool: Who flies.
        report: Receives how many of how many are done.
        is_trusted: Whether programs are started as the suite says; otherwise all of them are in a sandbox.

    Raises:
        UsageError: the folder was changed meanwhile.
        MachineError: the result cannot be kept.
    """
    contents = results_hash(again.folder.path)
    rooms = _rooms(trials, pool)
    differences: list[Difference] = []
    sandboxes: Counter[str] = Counter()
    flown = trials if is_trusted else [confine_trial(trial) for trial in trials]
    jobs = [Job(key=trial.id, kind="fly", trial=trial, environment_dir=rooms[trial.room]) for trial in flown]
    for i, ended in enumerate(iterate_results(pool, jobs)):
        report(i + 1, len(jobs))
        trial, before = ended.job.trial, again.rows[ended.job.trial.id]
        if ended.failure is not None:
            columns: dict[str, tuple[Any, Any]] = {"status": (before["status"], f"{ended.failure}: {ended.text}")}
        else:
            now = ended.result.row
            sandboxes[now["sandbox"]] += 1
            columns = {name: (before[name], now.get(name)) for name in _differing(before, now)}
        if columns:
            differences.append(Difference(trial=trial.id, case=trial.case, entry=trial.entry, columns=columns))
    if results_hash(again.folder.path) != contents:
        raise UsageError(
            f"{again.folder.path}: expected results that stay as they are while they are verified, they were changed. "
            "Verify a copy that nobody writes to."
        )
    mark = VerificationMark(
        sample=len(trials),
        same=len(trials) - len(differences),
        at=datetime.now(UTC).isoformat(timespec="seconds"),
        n_missing=again.n_missing,
    )
    save_mark(contents, mark)
    return Verification(
        n_sampled=len(trials), n_missing=again.n_missing, sandboxes=sandboxes, differences=tuple(differences)
    )


def record_trial_again(
    again: RepeatableResults, trial: Trial, pool: Pool, *, is_trusted: bool = False
) -> tuple[Path, str | None]:
    """Run a trial again with a recording; return its run directory and its digest.

    Args:
        again: The folder.
        trial: Which of its runs.
        pool: Who flies.
        is_trusted: Whether its programs are started as the suite says, and a recording that is there is taken for its
            own; otherwise they are in a sandbox, and what is there is replaced.

    Raises:
        UsageError: it came to nothing again; the text has the end of its log. Or recordings would lie elsewhere.
    """
    recordings = again.folder.recordings
    place = recordings / trial.id
    if recordings.is_symlink():
        raise UsageError(
            f"{recordings}: expected a folder of its own for recordings, was a link to another. Remove the link."
        )
    if is_trusted and (place / "recording.rrd").is_file():
        return place, again.rows[trial.id]["digest"]
    rooms = _rooms([trial], pool)
    trial = trial if is_trusted else confine_trial(trial)
    job = Job(key="record", kind="record", trial=trial, environment_dir=rooms[trial.room], runs_dir=recordings)
    (ended,) = iterate_results(pool, [job])
    if ended.failure is not None:
        raise UsageError(f"{trial.case}, {trial.entry}: {ended.failure} again: {ended.text}")
    if place.is_symlink() or place.is_file():
        place.unlink()
    elif place.exists():
        shutil.rmtree(place)
    ended.result.run_dir.rename(place)
    return place, ended.result.result["digest"]


def _check_sandboxes(plan: Plan, folder: ResultsFolder, rows: Mapping[str, Row]) -> None:
    demanding = {case.name for case in plan.cases if case.is_sandboxed}
    outside = find_unsandboxed_rows(row for row in rows.values() if row["case"] in demanding)
    if outside:
        raise UsageError(
            f"{folder.path}: expected agents in a sandbox, as the suite demands (sandbox: required), was "
            f"{outside[0]['sandbox'] or 'nothing told'} in {len(outside)} of {len(rows)} flights. Fly them again with "
            "bench run."
        )


def _rooms(trials: Sequence[Trial], pool: Pool) -> dict[str, Path]:
    firsts = {trial.room: trial for trial in reversed(trials)}
    rooms: dict[str, Path] = {}
    for ended in iterate_results(pool, [Job(key=room, kind="room", trial=trial) for room, trial in firsts.items()]):
        if ended.failure is not None:
            raise UsageError(f"{ended.job.trial.case}: its room cannot be made: {ended.text}")
        rooms[ended.job.key] = ended.result
    return rooms


# What a manifest says decides with whom results are ranked, and under which name.
def _check_manifest(plan: Plan, folder: ResultsFolder, manifest: Mapping[str, Any]) -> None:
    hashes = {entry.spec.name: entry.agent_hash for entry in plan.entries}
    parameters = {entry.spec.name: json.loads(entry.spec.model_dump_json())["parameters"] for entry in plan.entries}
    found = {"suite_hash": manifest.get("suite_hash")}
    expected: dict[str, Any] = {"suite_hash": plan.suite_hash}
    for entry in manifest.get("entries", []):
        name = entry.get("name")
        found |= {f"agent_hash of {name}": entry.get("agent_hash"), f"parameters of {name}": entry.get("parameters")}
        expected |= {f"agent_hash of {name}": hashes.get(name), f"parameters of {name}": parameters.get(name)}
    wrong = next((key for key, value in expected.items() if found[key] != value), None)
    if wrong is not None:
        raise UsageError(
            f"{folder.manifest}: expected {wrong} {expected[wrong]}, as suite.yaml beside it comes to, was "
            f"{found[wrong]}. Fly the suite again with bench run."
        )


# Those of the machine's clock apart. An agent that fails as an object of the worker says so in other words than one
# that fails as a process; that it did is in the digest.
def _differing(before: Row, now: Row) -> list[str]:
    in_other_words = (
        {"agent_faults"}
        if (before["sandbox"] == NONE_IN_THIS_PROCESS) != (now["sandbox"] == NONE_IN_THIS_PROCESS)
        else set()
    )
    return [
        name
        for name in now
        if not is_machine_dependent(name) and name not in in_other_words and now[name] != before.get(name)
    ]
