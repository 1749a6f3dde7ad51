"""Verification of results: trials run again and compared with their rows, in the sandbox that a suite requires."""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.bundled import CARD_FILE
from gslcosim.base.errors import UsageError
from gslcosim.base.files import remove_tree
from gslcosim.runtime.agents.loader import build_start_command, find_python_agent, resolve_command
from gslcosim.runtime.processes.sandbox.policy import find_own_folders, is_system_path, list_python_folders
from gslcosim.runtime.processes.sandbox.selection import (
    NONE_IN_THIS_PROCESS,
    find_strongest_sandbox,
    is_sandboxed,
    unavailable_reason,
)
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.problems import InvalidScenarioError, TextLocation, TextLocations, locate
from gslcosim_bench.cases.models import Trial
from gslcosim_bench.cases.plan import Plan, build_plan_of_rows
from gslcosim_bench.cases.suite_files import LoadedSuite, load_suite
from gslcosim_bench.execution.pool import Job, Pool, iterate_results
from gslcosim_bench.execution.scoring import COMPLETED, Row
from gslcosim_bench.store import ResultsFolder, is_machine_dependent
from gslcosim_bench.verification_marks import VerificationMark, remove_caches, results_hash, save_mark

_SEEING = ("start", "may_read", "may_write")
_Program = tuple[str, list[str], tuple[str, ...]]


def check_sandbox(plan: Plan) -> None:
    """Refuse to fly a suite that demands a sandbox on a machine without one."""
    if plan.loaded.demands_sandbox and find_strongest_sandbox() == "none":
        reasons = _reasons()
        raise UsageError(
            f"{plan.loaded.shown_path}: sandbox: expected a machine that has a sandbox for agents, was one without "
            f"({reasons}). Install bubblewrap, or fly the suite on another machine."
        )


def check_machine(plan: Plan) -> None:
    """Refuse to fly a suite on a machine that lacks what it needs: a sandbox, or what draws pictures of cameras."""
    check_sandbox(plan)
    # One stands for all: what draws does not depend on the case. To read thousands of scenarios takes its time.
    likely = (trial for trial in plan.trials if "camera" in trial.scenario_json)
    seeing = next((trial for trial in likely if trial.resolved.cameras), None)
    if seeing is None:
        return
    source = f"{plan.loaded.shown_path}: case {seeing.case}, entry {seeing.entry}"
    checks = list_scenario_checks("machine", without=("sandboxes",))
    problems = [problem for check in checks for problem in check(seeing.resolved, seeing.directory)]
    if problems:
        raise InvalidScenarioError(locate(problems, TextLocations(TextLocation(source=source))), name=source)


def check_confinable(trials: Sequence[Trial], folder: Path, *, is_trusted: bool = False) -> None:
    """Refuse to run trials of somebody else whose programs could not be confined, before any of them is started.

    Args:
        folder: The results that they are of; their programs lie in it, or come with gslcosim or the system.
        is_trusted: Whether programs do as they like: then nothing is refused but variables of this process.
    """
    trusting = "If you trust who made these results, give --trusted: then their programs do as they like."
    _check_variables(trials, folder, "" if is_trusted else trusting)
    if is_trusted:
        return
    if find_strongest_sandbox() == "none":
        raise UsageError(
            f"{folder}: expected a machine that has a sandbox for the programs of these results, was one without "
            f"({_reasons()}). Install bubblewrap. {trusting}"
        )
    _check_programs([(trial, _programs(trial)) for trial in trials], folder, trusting)


# A variable without a value would be a secret of the machine that repeats the run, and no part of the results.
def _check_variables(trials: Sequence[Trial], folder: Path, trusting: str) -> None:
    for trial in trials:
        for own in (*trial.resolved.agents, *trial.resolved.participants):
            for name, value in (own.environment or {}).items():
                if value is None or trusting:
                    found = "one that takes the value set here" if value is None else f"{value!r:.80}"
                    remedy = trusting if value is not None else "Ask their author for results without it."
                    raise UsageError(
                        f"{folder}: {trial.entry}: {own.place}.environment.{name}: expected a program that needs no "
                        f"variables of others, was {found}. {remedy}"
                    )


def check_bundles(plan: Plan, roots: Mapping[str, Path]) -> None:
    """Refuse to fly bundles whose programs would see more than their own files, before any of them is started.

    Args:
        roots: Where each bundle is unpacked, by the name of its entry.
    """
    for entry in plan.loaded.suite.entries:
        names = {setting.name for setting in entry.settings}
        # Participants are the suite's own, and its cases start an agent in a few ways alone.
        of_kind = {_read_starts(trial): trial for trial in plan.trials if trial.entry in names}
        trials = [(trial, _agent_programs(trial)) for trial in of_kind.values()]
        _check_programs(trials, roots[entry.name], "Ask its author for another bundle.")


def _read_starts(trial: Trial) -> tuple[Path, str]:
    agents = json.loads(trial.scenario_json)["agents"]
    return trial.directory, json.dumps([[agent.get(key) for key in _SEEING] for agent in agents])


def _check_programs(programs: Sequence[tuple[Trial, Iterable[_Program]]], folder: Path, trusting: str) -> None:
    trials = [trial for trial, _ in programs]
    for entry, program in {(trial.entry, program) for trial in trials for program in _python_programs(trial)}:
        if program.name != CARD_FILE and "__main__" not in program.read_text(encoding="utf-8", errors="replace"):
            raise UsageError(
                f"{folder}: {entry}: expected a Python agent that is also a program, which a sandbox can start, was "
                f"one without the line: if __name__ == '__main__': run(MyAgent). {trusting}\nFile: {program}"
            )
    allowed = [folder.resolve(), *(place.resolve() for place in list_python_folders())]
    seen: set[tuple[Any, ...]] = set()
    for trial, of_trial in programs:
        for place, command, granted in of_trial:
            if (key := (place, tuple(command), granted, trial.directory)) in seen:
                continue
            seen.add(key)
            if granted:
                raise UsageError(
                    f"{folder}: {trial.entry}: {place}: expected a program that sees and changes its own folder alone, "
                    f"was one that asks for {granted[0]} (may_read, may_write). {trusting}"
                )
            for seen_folder in find_own_folders(command, trial.directory):
                if not any(seen_folder.resolve().is_relative_to(each) for each in allowed) and not is_system_path(
                    seen_folder.resolve()
                ):
                    raise UsageError(
                        f"{folder}: {trial.entry}: {place}.start: expected a command that names files of its folder "
                        f"or of the system, was one that names something in {seen_folder}. {trusting}"
                    )


def confine_trial(trial: Trial) -> Trial:
    """Return a trial whose programs are processes in the strongest sandbox; what it comes to is the same.

    Args:
        trial: As planned; it keeps its id.
    """
    values = json.loads(trial.scenario_json)
    for agent in values["agents"]:
        start = agent["start"]
        if start.get("process_of") is None and not start.get("attach"):
            agent["sandbox"] = "required"
        if start.get("python") is not None:
            start["door"] = "stdio"
    for participant in values.get("participants", []):
        participant["sandbox"] = "required"
    return replace(trial, scenario_json=json.dumps(values))


def _python_programs(trial: Trial) -> Iterator[Path]:
    for agent in trial.resolved.agents:
        if agent.start.python is not None:
            yield find_python_agent(agent.start.python, trial.directory)


# Of each program of a trial: its place in the scenario, its command line, and the folders that it asks for.
def _programs(trial: Trial) -> Iterator[_Program]:
    yield from _agent_programs(trial)
    for own in trial.resolved.participants:
        yield own.place, resolve_command(own.start.words, trial.directory), (*own.may_read, *own.may_write)


def _agent_programs(trial: Trial) -> Iterator[_Program]:
    for agent in trial.resolved.agents:
        command = build_start_command(agent, trial.directory)
        if command is not None:
            yield agent.place, command, (*agent.may_read, *agent.may_write)


def _reasons() -> str:
    return "; ".join(unavailable_reason(kind) for kind in ("bubblewrap", "landlock"))


def find_unsandboxed_rows(rows: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows of runs whose agents were not all in a sandbox; those without a run have none."""
    return [row for row in rows if row["digest"] and not is_sandboxed(row["sandbox"])]


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

    `n_rows` have a result, from which the sample was drawn; `by_entry` gives for each entry these rows, those of the
    sample, and those that came out differently. `n_missing` trials of the suite have no row, so that nobody can tell
    what came of them.
    """

    n_rows: int
    by_entry: Mapping[str, tuple[int, int, int]]
    n_sampled: int
    n_missing: int
    sandboxes: Mapping[str, int]
    differences: tuple[Difference, ...]


class RepeatableResults:
    """A results folder whose runs can be run again: its suite planned again, its rows by trial."""

    def __init__(self, folder: ResultsFolder, load: Callable[[Path], LoadedSuite] = load_suite) -> None:
        """Read the folder.

        Args:
            load: Reads its suite; that of sealed results needs the secret.
        """
        folder.check()
        self.folder = folder
        self.rows: dict[str, Row] = {row["trial"]: row for row in folder.rows()}
        self.plan: Plan = build_plan_of_rows(load(folder.suite), self.rows.values())
        _check_sandboxes(self.plan, folder, self.rows)
        self.trials = {trial.id: trial for trial in self.plan.trials if trial.id in self.rows}
        manifest = folder.read_json(folder.manifest)
        self.n_missing = self.plan.n_trials - len(self.trials)
        if len(self.trials) < len(self.rows):
            cause = describe_other_software(manifest, self.plan.software_hash)
            raise UsageError(
                f"{folder.path}: expected flights that this version can repeat, {len(self.rows) - len(self.trials)} of "
                f"{len(self.rows)} are others: {cause}, or fly the suite again with bench run."
            )

        _check_manifest(self.plan, folder, manifest)

    def trial(self, beginning: str) -> Trial:
        """Return the one trial whose id begins like this."""
        found = [trial for key, trial in self.trials.items() if key.startswith(beginning)]
        if len(found) != 1:
            raise UsageError(
                f"--trial: expected the beginning of one trial's id in {self.folder.path}, {beginning!r} begins "
                f"{len(found)}. The report and trials.parquet have the ids."
            )
        return found[0]

    def draw(self, n: int, *, seed: str) -> list[Trial]:
        """Return n of the runs with a result, drawn at random by `draw_trials`, in the order of the suite."""
        chosen = set(draw_trials(self.list_flown(), n, seed=seed))
        return [trial for key, trial in self.trials.items() if key in chosen]

    def list_places(self, entries: Collection[str] = ()) -> dict[str, list[Trial]]:
        """Return the runs with a result by place, that is by what all entries meet alike.

        A place is the hash of the case, the repetition, and 1 for a control run or 0. It has nothing in it that an
        author may choose: a comment in a program changes ids of runs, and another order or number of entries changes
        where an entry stands.

        Args:
            entries: Whose runs; absent: those of all.
        """
        places: dict[str, list[Trial]] = {}
        for trial in map(self.trials.__getitem__, self.list_flown()):
            if not entries or trial.entry in entries:
                place = f"{trial.case_hash} {trial.repetition} {trial.is_control:d}"
                places.setdefault(place, []).append(trial)
        return places

    def list_flown(self) -> list[str]:
        """Return the trials with a result; what ended a run without one may have been the machine."""
        return [key for key in self.trials if self.rows[key]["status"] == COMPLETED]


def draw_trials(trials: Iterable[str], n: int, *, seed: str) -> list[str]:
    """Return n trials or places, those with the smallest SHA-256 behind a seed: a draw that any program can repeat.

    Args:
        n: How many; all where there are fewer.
        seed: Any text. The hash is of the seed, a line feed and the trial or place.
    """
    return sorted(trials, key=lambda each: hashlib.sha256(f"{seed}\n{each}".encode()).digest())[:n]


def verify_trials(
    again: RepeatableResults,
    trials: Sequence[Trial],
    pool: Pool,
    report: Callable[[int, int], None] = lambda _done, _total: None,
    *,
    contents: str | None = None,
    is_trusted: bool = False,
) -> Verification:
    """Run trials again, compare all columns but those of the clock, and keep the result in this user's state.

    Args:
        again: The folder; nothing is written to it.
        contents: The `results_hash` of the folder before anything was read of it; absent: as it is now.
        is_trusted: Whether programs are started as the suite says; otherwise all of them are in a sandbox.
    """
    contents = results_hash(again.folder.path) if contents is None else contents
    rooms = _rooms(trials, pool)
    differences: list[Difference] = []
    sandboxes: Counter[str] = Counter()
    secrets = again.folder.read_agent_secrets()
    flown = [trial.with_agent_secret(secrets.get(trial.id)) for trial in trials]
    flown = flown if is_trusted else [confine_trial(trial) for trial in flown]
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
    if is_trusted:
        remove_caches(again.folder.path)
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
    rows = Counter(again.trials[key].entry for key in again.list_flown())
    sampled = Counter(trial.entry for trial in trials)
    wrong = Counter(each.entry for each in differences)
    return Verification(
        n_rows=rows.total(),
        by_entry={entry: (n, sampled[entry], wrong[entry]) for entry, n in rows.items()},
        n_sampled=len(trials),
        n_missing=again.n_missing,
        sandboxes=sandboxes,
        differences=tuple(differences),
    )


def record_trial_again(
    again: RepeatableResults, trial: Trial, pool: Pool, *, is_trusted: bool = False
) -> tuple[Path, str | None]:
    """Run a trial again with a recording; return its run directory and its digest.

    Args:
        is_trusted: Whether its programs are started as the suite says, and a recording that is there is taken for its
            own; otherwise they are in a sandbox, and what is there is replaced.
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
    trial = trial.with_agent_secret(again.folder.read_agent_secrets().get(trial.id))
    trial = trial if is_trusted else confine_trial(trial)
    job = Job(key="record", kind="record", trial=trial, environment_dir=rooms[trial.room], runs_dir=recordings)
    (ended,) = iterate_results(pool, [job])
    if ended.failure is not None:
        raise UsageError(f"{trial.case}, {trial.entry}: {ended.failure} again: {ended.text}")
    if place.is_symlink() or place.is_file():
        place.unlink()
    elif place.exists():
        remove_tree(place)
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


def describe_other_software(manifest: Mapping[str, Any], software_hash: str) -> str:
    """Return why rows of results are not those of this software, which has a hash, and what to do about it."""
    if manifest.get("software_hash") == software_hash:
        return "the programs of its agents have changed. Give it those programs"
    version = manifest.get("versions", {}).get("gslcosim", "?")
    if version == gslcosim.__version__:
        return f"they were made by other code or packages of gslcosim {version}. Install those"
    return f"they were made by gslcosim {version}. Install that version"
