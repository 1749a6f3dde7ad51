"""Suite runner: environments and tapes first and once, then trials, each row on disk before the next begins."""

import json
import math
import os
import platform
import secrets
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.checksums import write_checksums
from gslcosim.base.code_identity import COMPUTING_PACKAGES
from gslcosim.base.disk_cache import mark_used
from gslcosim.base.errors import MachineError, SimulationFault, UsageError
from gslcosim.environment.store import load_environment
from gslcosim_bench.cases.models import (
    LOWER_ANCHOR,
    UPPER_ANCHOR,
    Selection,
    Shard,
    Trial,
    choose_trials,
    derive_seed,
)
from gslcosim_bench.cases.plan import Plan, build_plan, build_plan_of_rows, group_settings, save_pace
from gslcosim_bench.cases.suite_files import LoadedSuite, load_suite, write_suite
from gslcosim_bench.execution.pool import POLL_PERIOD_S, Job, JobResult, LocalPool, Pool, n_cores
from gslcosim_bench.execution.scoring import COMPLETED, Row, row_without_result
from gslcosim_bench.execution.trial import ALL_CASES, TrialResult, map_keys
from gslcosim_bench.execution.verification import check_machine
from gslcosim_bench.results import Results
from gslcosim_bench.store import (
    MAPS_SCHEMA,
    RESULTS_SCHEMA,
    SHARD_SCHEMA,
    Journal,
    JournalEntry,
    ResultsFolder,
    ShardFacts,
    build_tables,
)

_TRIES = 2
_SECRET_BYTES = 16
_STATUS_EVERY_S = 2.0


def build_manifest(plan: Plan, sessions: list[dict[str, Any]], *, recorded: Sequence[str]) -> dict[str, Any]:
    """Return the content of `manifest.json`.

    Args:
        sessions: The wall times of each call that flew some of it.
    """
    suite = plan.loaded.suite
    names = {entry.spec.name for entry in plan.entries}
    anchors = {"lower": LOWER_ANCHOR, "upper": UPPER_ANCHOR}
    titles = {trial.scenario: trial.family for trial in plan.trials}
    return {
        "schema": RESULTS_SCHEMA,
        "suite": suite.name,
        "title": suite.title,
        "question": suite.question,
        "smallest_difference_points": suite.smallest_difference_points,
        "seed": suite.seed if suite.sealed is None else None,
        "suite_hash": plan.suite_hash,
        "software_hash": plan.software_hash,
        "sandbox": "required" if plan.loaded.demands_sandbox else "optional",
        "versions": {
            "gslcosim": gslcosim.__version__,
            "python": sys.version.split()[0],
            **{name: version(name) for name in COMPUTING_PACKAGES},
        },
        "machine": {
            "cpu": _cpu_name(),
            "cores": os.cpu_count(),
            "platform": platform.platform(),
            "reference_loop_s": median_reference_loop_s(sessions),
        },
        "entries": [
            {
                "name": entry.spec.name,
                "title": entry.card.title if entry.card else entry.spec.name,
                "family": entry.card.family if entry.card else "",
                "blind": entry.card is not None and entry.card.is_blind,
                "agent_hash": entry.agent_hash,
                "language": "python" if entry.spec.start.python else "command",
                "parameters": json.loads(entry.spec.model_dump_json())["parameters"],
                "robots": entry.spec.robots,
            }
            for entry in plan.entries
        ],
        "settings": group_settings(plan.entries),
        "scenarios": [{"name": name, "family": family, "title": name} for name, family in titles.items()],
        "n_planned": plan.n_trials,
        "n_dropped": len(plan.dropped),
        "dropped": [asdict(each) for each in plan.dropped],
        "moved": [asdict(each) for each in plan.moved],
        "anchors": {side: name for side, name in anchors.items() if name in names},
        "wall": sum_sessions(sessions),
        "sessions": sessions,
        "recordings": {trial: f"recordings/{trial}" for trial in recorded},
    }


def median_reference_loop_s(sessions: Sequence[Mapping[str, Any]]) -> float | None:
    """Return the median of what the reference loop took in several calls [s]; None where none has measured it."""
    loops_s = [each["reference_loop_s"] for each in sessions if each.get("reference_loop_s")]
    return statistics.median(loops_s) if loops_s else None


def sum_sessions(sessions: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the wall times of all calls together, as `manifest.json` has them under `wall`."""
    if not sessions:
        return {}
    totals: dict[str, Any] = {
        key: sum(each.get(key) or 0.0 for each in sessions)
        for key in ("total_s", "preparing_s", "flying_s", "cpu_s", "n_trials")
    }
    for key in ("busy_share", "flying_share"):
        weighted = sum((each.get(key) or 0.0) * (each.get("flying_s") or 0.0) for each in sessions)
        totals[key] = weighted / totals["flying_s"] if totals["flying_s"] else None
    return {
        "started_at": sessions[0]["started_at"],
        **totals,
        "jobs": sessions[-1]["jobs"],
        "peak_worker_mb": max(each.get("peak_worker_mb") or 0.0 for each in sessions),
    }


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")


def select_recorded_trials(trials: Sequence[Trial], rows: Mapping[str, Row], keep: Sequence[str]) -> list[Trial]:
    """Return the trials of each entry that a suite keeps recordings of, in the order of the suite.

    `first_failure` is its first run without success, `slowest` its slowest success, `median` the one in the middle
    of its successes by time. Controls and runs without result are left out.

    Args:
        keep: Words of `record.keep`.
    """
    chosen: set[str] = set()
    for entry in dict.fromkeys(trial.entry for trial in trials):
        flown = [t for t in trials if t.entry == entry and not t.is_control and rows[t.id]["status"] == COMPLETED]
        failed = [t for t in flown if not rows[t.id]["success"]]
        found = sorted((t for t in flown if rows[t.id]["success"]), key=lambda t: (rows[t.id]["time_s"], t.index))
        if "first_failure" in keep and failed:
            chosen.add(failed[0].id)
        if "slowest" in keep and found:
            chosen.add(found[-1].id)
        if "median" in keep and found:
            chosen.add(found[math.ceil(len(found) / 2) - 1].id)
    return [trial for trial in trials if trial.id in chosen]


def shuffle_trials(trials: Iterable[Trial], *, seed: int) -> list[Trial]:
    """Return trials in the order in which they are flown, so that what one leaves behind meets no trial of its choice.

    It depends on the seed of the suite and on the places of trials in it alone: not on the machine, nor on how many
    are left.
    """
    return sorted(trials, key=lambda trial: (derive_seed(seed, "order", trial.index), trial.index))


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Progress of a run: the current work, how much of it is done, and the outcomes so far."""

    phase: str
    done: int
    total: int
    elapsed_s: float
    successes: dict[str, int] = field(default_factory=dict[str, int])
    flown: dict[str, int] = field(default_factory=dict[str, int])
    n_without_result: int = 0
    cpu_s: float = 0.0
    """Processor time of all workers since they started [s]; 0 where nobody knows."""
    lost: tuple[str, ...] = ()
    """Trials that are flown again, each with what happened to its worker."""

    @property
    def rate_per_s(self) -> float:
        """Trials a second since the phase began."""
        return self.done / self.elapsed_s if self.elapsed_s > 0 else 0.0

    @property
    def left_s(self) -> float | None:
        """Time until the phase is over at this rate [s]; nobody knows before the first is done."""
        return (self.total - self.done) / self.rate_per_s if self.done else None


def build_status(progress: Progress) -> dict[str, Any]:
    """Return what the folder of a run that is going on says of it, for `gslcosim bench status`."""
    return {
        "phase": progress.phase,
        "done": progress.done,
        "total": progress.total,
        "elapsed_s": round(progress.elapsed_s, 1),
        "left_s": progress.left_s,
        "cpu_s": round(progress.cpu_s, 1),
        "n_without_result": progress.n_without_result,
        "process": os.getpid(),
    }


@dataclass(frozen=True, kw_only=True)
class StaleRows:
    """Rows of a results folder that the plan does not have, and what has changed since, in words."""

    folder: Path
    n_stale: int
    n_rows: int
    changes: tuple[str, ...]

    def __str__(self) -> str:
        changed = f" ({', '.join(self.changes)} changed)" if self.changes else ""
        return f"{self.n_stale} of {self.n_rows} trials were run with another version{changed}"


def describe_changes(plan: Plan, manifest: Mapping[str, Any]) -> tuple[str, ...]:
    """Return in words what differs between a plan and the manifest of earlier results.

    Args:
        manifest: That of the results folder; empty where it has none.
    """
    before = {entry["name"]: entry for entry in manifest.get("entries", ())}
    now = build_manifest(plan, [], recorded=())
    changes: list[str] = []
    if manifest.get("software_hash") not in (None, now["software_hash"]):
        changes.append("gslcosim or a package that it computes with")
    for entry in now["entries"]:
        known = before.pop(entry["name"], entry)
        for key, text in (("agent_hash", "program"), ("parameters", "parameters")):
            if known.get(key) not in (None, entry[key]):
                changes.append(f"{text} of {entry['name']}")
    changes += [f"list of entries without {name}" for name in before]
    if manifest.get("suite_hash") not in (None, now["suite_hash"]):
        changes.append("cases or seeds of the suite")
    return tuple(changes)


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """Summary of a suite run."""

    folder: Path
    n_planned: int
    n_chosen: int
    n_flown_before: int
    n_flown: int
    n_without_result: int
    is_interrupted: bool
    put_aside: Path | None
    wall: dict[str, Any]


class SuiteRun:
    """One call of `bench run`: goes on where an earlier one stopped."""

    def __init__(
        self,
        plan: Plan,
        folder: ResultsFolder,
        start_pool: Callable[[], Pool],
        *,
        selection: Selection,
        shard: Shard | None = None,
        flies_failures_again: bool = False,
        keeps_pool: bool = False,
        confirm_put_aside: Callable[[StaleRows], bool] = lambda _: True,
        report: Callable[[Progress], None] = lambda _: None,
    ) -> None:
        """Prepare to run.

        Args:
            start_pool: Starts the workers; not called when there is nothing to fly.
            shard: Which part of these; all if absent.
            flies_failures_again: Whether trials without result are run again.
            keeps_pool: Whether the workers are left running, for what else their owner has for them.
            confirm_put_aside: Receives which rows are of another version before they are moved aside, and returns
                whether to go on.
        """
        self._plan = plan
        self._folder = folder
        self._start_pool = start_pool
        self._selection = selection
        self._shard = shard
        self._chosen = choose_trials(plan.trials, selection, shard)
        self._keeps_pool = keeps_pool
        self._confirm_put_aside = confirm_put_aside
        self._flies_failures_again = flies_failures_again
        self._report = report
        self._entries: dict[str, JournalEntry] = {}
        self._flown: Counter[str] = Counter()
        self._found: Counter[str] = Counter()
        self._n_without_result = 0
        self._lost: list[str] = []
        self._environments: dict[str, Path] = {}
        self._hashes: dict[str, str] = {}
        self._secrets: dict[str, str] = {}
        self._is_interrupted = False
        self._busy_s = 0.0
        self._flying_s = 0.0
        self._status_written_at_s = -math.inf

    def fly(self) -> RunSummary:
        """Fly what is missing, write the tables, and return what was done.

        An interruption ends the workers and leaves whole tables of what was run.

        Raises:
            GslCosimError: the folder cannot be used or written, or a room or tape cannot be made.
        """
        began, started_at = time.perf_counter(), datetime.now(UTC)
        with self._folder.locked():
            drawn = self._folder.read_agent_secrets()
            aside = self._take_over()
            todo = [trial for trial in self._chosen if trial.id not in self._entries]
            n_before = len(self._chosen) - len(todo)
            write_suite(self._plan.loaded, self._folder.path)
            write_checksums(self._folder.path, self._folder.suite.name)
            # Before anything flies, so that a report can be made of rows whose run was killed.
            self._write_manifest({})
            self._write_shard()
            self._secrets = {key: text for key, text in drawn.items() if key in self._entries} | {
                trial.id: drawn.get(trial.id) or secrets.token_hex(_SECRET_BYTES)
                for trial in todo
                if trial.demands_sandbox
            }
            self._folder.write_agent_secrets(self._secrets)
            wall: dict[str, Any] = {}
            if todo or self._missing_recordings():
                wall = self._fly_with_pool(todo)
            wall = {
                "started_at": started_at.isoformat(timespec="seconds"),
                "total_s": time.perf_counter() - began,
                **wall,
            }
            self._write(wall)
            self._folder.status.unlink(missing_ok=True)
        new = [self._entries[trial.id].row for trial in todo if trial.id in self._entries]
        return RunSummary(
            folder=self._folder.path,
            n_planned=self._plan.n_trials,
            n_chosen=len(self._chosen),
            n_flown_before=n_before,
            n_flown=len(new),
            n_without_result=sum(row["status"] != COMPLETED for row in new),
            is_interrupted=self._is_interrupted,
            put_aside=aside,
            wall=wall,
        )

    # Rows of another version of the software or the suite are never mixed in; they are kept beside.
    def _take_over(self) -> Path | None:
        found = self._folder.entries()
        if self._plan.n_left_out and found:
            # What other calls have flown is theirs to keep, and its order is that of the suite.
            planned = {trial.slot for trial in self._plan.trials}
            rows = [entry.row for entry in found.values()]
            self._plan = build_plan_of_rows(self._plan.loaded, rows, wants=planned.__contains__)
        ids = {trial.id for trial in self._plan.trials}
        valid = {key: entry for key, entry in found.items() if key in ids}
        n_stale = len(found) - len(valid)
        if n_stale:
            changes = describe_changes(self._plan, self._folder.read_json(self._folder.manifest))
            stale = StaleRows(folder=self._folder.path, n_stale=n_stale, n_rows=len(found), changes=changes)
            if not self._confirm_put_aside(stale):
                raise UsageError(
                    f"{self._folder.path}: The results are as they were. Name another folder with --results."
                )
        aside = self._folder.put_aside() if n_stale else None
        if aside is not None:
            with Journal(self._folder.journal) as journal:
                for entry in valid.values():
                    journal.append(entry)
        if self._flies_failures_again:
            valid = {key: entry for key, entry in valid.items() if entry.row["status"] == COMPLETED}
        self._entries = valid
        for entry in valid.values():
            self._count(entry.row)
        if not valid:
            # Of a run that was killed before its first row, perhaps by other software.
            self._folder.maps.unlink(missing_ok=True)
        return aside

    def _fly_with_pool(self, todo: Sequence[Trial]) -> dict[str, Any]:
        pool = self._start_pool()
        wall: dict[str, Any] = {"jobs": pool.n_workers}
        began = prepared = time.perf_counter()
        try:
            self._prepare(pool, todo)
            prepared = time.perf_counter()
            self._fly_all(pool, todo)
            flown = time.perf_counter()
            self._record(pool)
        except KeyboardInterrupt:
            self._is_interrupted = True
            flown = time.perf_counter()
            prepared = flown if prepared == began else prepared
        finally:
            if not self._keeps_pool:
                pool.close()
        rows = [self._entries[trial.id].row for trial in todo if trial.id in self._entries]
        taken_s = flown - prepared
        wall |= {"preparing_s": prepared - began, "flying_s": taken_s, "n_trials": len(rows)}
        if rows and taken_s > 0:
            wall["busy_share"] = self._busy_s / (taken_s * pool.n_workers)
            wall["flying_share"] = self._flying_s / (taken_s * pool.n_workers)
            save_pace(sim_s=sum(row["end_s"] or 0.0 for row in rows), busy_s=self._busy_s)
        wall["peak_worker_mb"] = pool.peak_mb
        wall["cpu_s"] = pool.cpu_s
        if pool.reference_loops_s:
            wall["reference_loop_s"] = statistics.median(pool.reference_loops_s)
        return wall

    def _prepare(self, pool: Pool, todo: Sequence[Trial]) -> None:
        unmapped = self._unmapped()
        rooms = _firsts([*todo, *(trial for trial, _ in unmapped)], lambda trial: trial.room)
        jobs = [Job(key=room, kind="room", trial=trial) for room, trial in rooms.items()]
        for ended in self._all_done(pool, jobs, "rooms"):
            self._environments[ended.job.key] = ended.result
            # The worker that has made it may end.
            mark_used(ended.result)
        for room, folder in self._environments.items():
            self._hashes[room] = load_environment(folder).content_hash
        tapes = _firsts(todo, lambda trial: trial.tape)
        # One of each plume first, for the maps need them too.
        jobs = [
            Job(key=tape, kind="tape", trial=trial, environment_dir=self._environments[trial.room])
            for tape, trial in tapes.items()
        ]
        list(self._all_done(pool, jobs, "plumes"))
        self._draw_maps(pool, unmapped)

    def _maps(self) -> dict[tuple[str, str], dict[str, Any]]:
        maps = self._folder.read_json(self._folder.maps).get("maps", [])
        return {(each["scenario"], each["varied"]): each for each in maps}

    def _unmapped(self) -> list[tuple[Trial, str]]:
        known = self._maps()
        chosen = {(trial.scenario, varied) for trial in self._chosen for varied in (trial.varied, ALL_CASES)}
        return [
            (trial, varied)
            for trial, varied in map_keys(self._plan.trials)
            if (trial.scenario, varied) in chosen and (trial.scenario, varied) not in known
        ]

    def _draw_maps(self, pool: Pool, unmapped: Sequence[tuple[Trial, str]]) -> None:
        maps = self._maps()
        jobs = [
            Job(
                key=f"map {trial.id}", kind="map", trial=trial,
                environment_dir=self._environments[trial.room], varied=varied,
            )
            for trial, varied in unmapped
        ]  # fmt: skip
        for ended in self._all_done(pool, jobs, "maps"):
            maps[ended.result["scenario"], ended.result["varied"]] = ended.result
        if jobs:
            # In the order of the suite, whichever was made first.
            keys = [(trial.scenario, varied) for trial, varied in map_keys(self._plan.trials)]
            ordered = {key: maps[key] for key in keys if key in maps} | maps
            self._folder.write_json(self._folder.maps, {"schema": MAPS_SCHEMA, "maps": list(ordered.values())})

    def _all_done(self, pool: Pool, jobs: Sequence[Job], phase: str) -> Iterable[JobResult]:
        began, left = time.perf_counter(), len(jobs)
        for job in jobs:
            pool.submit(job)
        while left:
            self._report_phase(pool, phase, len(jobs) - left, len(jobs), began)
            for ended in pool.wait(POLL_PERIOD_S):
                if ended.failure is not None:
                    raise SimulationFault(
                        f"{phase} of {ended.job.trial.case}: expected to be made, {ended.failure}: {ended.text}"
                    )
                left -= 1
                yield ended
        if jobs:
            self._report_phase(pool, phase, len(jobs), len(jobs), began)

    def _report_phase(self, pool: Pool, phase: str, done: int, total: int, began: float) -> None:
        elapsed_s = time.perf_counter() - began
        self._show(Progress(phase=phase, done=done, total=total, elapsed_s=elapsed_s, cpu_s=pool.cpu_s))

    # For who asked, and for `bench status` in another terminal.
    def _show(self, progress: Progress) -> None:
        self._report(progress)
        now_s = time.monotonic()
        if now_s - self._status_written_at_s >= _STATUS_EVERY_S:
            self._status_written_at_s = now_s
            # Nothing of the results depends on it.
            with suppress(MachineError):
                self._folder.write_json(self._folder.status, build_status(progress))

    def _fly_all(self, pool: Pool, todo: Sequence[Trial]) -> None:
        began = time.perf_counter()
        tries = Counter[str]()
        for trial in shuffle_trials(todo, seed=self._plan.loaded.suite.seed):
            self._submit(pool, trial)
        left = len(todo)
        with Journal(self._folder.journal) as journal:
            while left:
                self._report_trials(pool, len(todo) - left, len(todo), began)
                for ended in pool.wait(POLL_PERIOD_S):
                    trial = ended.job.trial
                    tries[trial.id] += 1
                    self._busy_s += ended.taken_s
                    entry = self._entry_of(ended)
                    if entry.row["status"] != COMPLETED and tries[trial.id] < _TRIES:
                        self._submit(pool, trial)
                        self._lost.append(f"{trial.id}: {ended.text} It is flown again.")
                        continue
                    # Before it is journalled: who interrupts that must not lose it.
                    self._entries[trial.id] = entry
                    journal.append(entry)
                    self._count(entry.row)
                    self._flying_s += entry.row["wall_flying_s"] or 0.0
                    left -= 1
            self._report_trials(pool, len(todo), len(todo), began)

    def _submit(self, pool: Pool, trial: Trial) -> None:
        flown = trial.with_agent_secret(self._secrets.get(trial.id))
        pool.submit(Job(key=trial.id, kind="fly", trial=flown, environment_dir=self._environments[trial.room]))

    def _entry_of(self, ended: JobResult) -> JournalEntry:
        trial = ended.job.trial
        if ended.failure is None:
            flown: TrialResult = ended.result
            return JournalEntry(flown.row | {"wall_worker": ended.worker}, flown.tracks)
        row = row_without_result(trial, self._hashes[trial.room], status=ended.failure, fault=ended.text)
        return JournalEntry(row | {"wall_worker": ended.worker}, None)

    # Counted as they come: a suite has tens of thousands, and is looked at twice a second.
    def _count(self, row: Row) -> None:
        self._n_without_result += row["status"] != COMPLETED
        if not row["is_control"]:
            self._flown[row["entry"]] += 1
            self._found[row["entry"]] += bool(row["success"])

    def _report_trials(self, pool: Pool, done: int, total: int, began: float) -> None:
        self._show(
            Progress(
                phase="trials",
                done=done,
                total=total,
                elapsed_s=time.perf_counter() - began,
                successes=dict(self._found),
                flown=dict(self._flown),
                n_without_result=self._n_without_result,
                cpu_s=pool.cpu_s,
                lost=tuple(self._lost),
            )
        )

    def _kept(self) -> list[Trial]:
        keep = self._plan.loaded.suite.record.keep
        # Which of all trials is the slowest, no shard knows.
        if self._shard is not None or not keep or any(trial.id not in self._entries for trial in self._chosen):
            return []
        return select_recorded_trials(self._chosen, {key: entry.row for key, entry in self._entries.items()}, keep)

    def _missing_recordings(self) -> list[Trial]:
        return [trial for trial in self._kept() if not (self._folder.recordings / trial.id).is_dir()]

    def _record(self, pool: Pool) -> None:
        for trial in (missing := self._missing_recordings()):
            if trial.room not in self._environments:
                job = Job(key=trial.room, kind="room", trial=trial)
                self._environments[trial.room] = next(iter(self._all_done(pool, [job], "rooms"))).result
        jobs = [
            Job(
                key=f"record {trial.id}", kind="record", trial=trial.with_agent_secret(self._secrets.get(trial.id)),
                environment_dir=self._environments[trial.room], runs_dir=self._folder.recordings,
            )
            for trial in missing
        ]  # fmt: skip
        for ended in self._all_done(pool, jobs, "recordings"):
            if faults := [] if ended.result.result["valid"] else ended.result.result["faults"]:
                raise SimulationFault(
                    f"recording of {ended.job.trial.case}, {ended.job.trial.entry}: expected to be made, was ended by "
                    f"{faults[0].get('participant')}: {faults[0]['text']}"
                )
            digest = ended.result.result.get("digest")
            expected = self._entries[ended.job.trial.id].row["digest"]
            if digest != expected:
                raise SimulationFault(
                    f"{ended.job.trial.case}, {ended.job.trial.entry}: expected the digest {expected} when flown again "
                    f"with a recording, was {digest}. Trial: {ended.job.trial.id}"
                )
            ended.result.run_dir.rename(self._folder.recordings / ended.job.trial.id)

    def _write(self, wall: dict[str, Any]) -> None:
        trials = [trial for trial in self._plan.trials if trial.id in self._entries]
        if self._folder.journal.is_file() or not self._folder.trials.is_file():
            self._folder.write_tables(*build_tables([self._entries[trial.id] for trial in trials]))
            self._folder.journal.unlink(missing_ok=True)
        self._write_manifest(wall)

    def _write_manifest(self, wall: dict[str, Any]) -> None:
        before = self._folder.read_json(self._folder.manifest)
        sessions = [*before.get("sessions", []), *([wall] if wall.get("n_trials") else [])]
        recorded = [path.name for path in sorted(self._folder.recordings.glob("*")) if path.name in self._entries]
        manifest = build_manifest(self._plan, sessions, recorded=recorded)
        self._folder.write_json(self._folder.manifest, manifest)

    def _write_shard(self) -> None:
        if self._shard is None:
            self._folder.shard.unlink(missing_ok=True)
            return
        facts = ShardFacts(
            index=self._shard.index,
            count=self._shard.count,
            only=[(key, list(patterns)) for key, patterns in self._selection.patterns],
            n_chosen=len(choose_trials(self._plan.trials, self._selection)),
            trials={trial.id: trial.index for trial in self._chosen},
        )
        self._folder.write_json(self._folder.shard, {"schema": SHARD_SCHEMA, **facts})


def _firsts(trials: Iterable[Trial], key_of: Callable[[Trial], str | None]) -> dict[str, Trial]:
    firsts: dict[str, Trial] = {}
    for trial in trials:
        key = key_of(trial)
        if key is not None:
            firsts.setdefault(key, trial)
    return firsts


def run(
    suite: str | Path | LoadedSuite,
    folder: str | Path,
    *,
    jobs: int | None = None,
    only: Sequence[str] = (),
    report: Callable[[Progress], None] = lambda _: None,
) -> Results:
    """Fly what is missing of a suite, and return all rows that there are.

    Args:
        suite: A file, the name of a bundled suite, or what `load_suite` returns.
        folder: Where results go; the same call goes on where it stopped.
        jobs: How many worker processes; one for each core if absent.
        only: Which trials, as `--only` has it: `["entry=surge_*", "scenario=gsl_bench_3"]`.

    Raises:
        ScenarioError: the suite is wrong.
        UsageError: the folder cannot be used or written, or the suite demands a sandbox that is not here.
        KeyboardInterrupt: it was interrupted; what was run is kept.
    """
    loaded = suite if isinstance(suite, LoadedSuite) else load_suite(suite, is_flown=True)
    n_workers = jobs or n_cores()
    selection = Selection.of(only)
    plan = build_plan(loaded, wants=selection.may_take)
    check_machine(plan)
    summary = SuiteRun(
        plan,
        ResultsFolder(Path(folder)),
        lambda: LocalPool(n_workers, loaded.suite.limits),
        selection=selection,
        report=report,
    ).fly()
    if summary.is_interrupted:
        raise KeyboardInterrupt
    return Results.load(folder)
