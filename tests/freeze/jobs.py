"""Everything that the freeze holds, as jobs: what is computed, from the command line alone, and under which names.

A job gives one entry, or several whose names begin with its own. An entry is a few named texts, mostly hashes, so that
a difference has a name. Nothing here may depend on where code lies: no module path, hash of code or version enters.
"""

import contextlib
import csv
import json
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as parquet
import yaml
from commands import (
    ENDED,
    LIMIT_S,
    CommandFailed,
    gslcosim,
    gslcosim_apart,
    hash_of,
    hash_of_fields,
    start,
)

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
SCENARIOS = ROOT / "scenarios"
END_TO_END = ROOT / "tests" / "end_to_end"
PAST_CONTRACTS = ROOT / "tests" / "golden"
BAD_INPUTS = HERE / "bad_inputs.jsonl"

# The seeds of bundled scenarios, 1 and 7, are among them.
SEEDS = (1, 2, 7)
PROCESSES = ("one", "grouped", "separate")
# Longer runs end here, but for one of each scenario.
SHORT_S = 60

Entry = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """One thing to compute, in an empty working directory.

    `cost_s` is about how long it takes; long ones come first. A portable one is the same with other packages.
    """

    name: str
    compute: Callable[[], Entry | dict[str, Entry]]
    cost_s: float = 5.0
    is_portable: bool = False
    has_parts: bool = False

    def entries(self) -> dict[str, Entry]:
        """Compute, and return the entries by their names."""
        if self.has_parts:
            return {f"{self.name}/{part}": entry for part, entry in self.compute().items()}
        return {self.name: self.compute()}

    def holds(self, entry: str) -> bool:
        """Return whether an entry of that name is of this job."""
        return entry == self.name or (self.has_parts and entry.startswith(f"{self.name}/"))


def all_jobs() -> list[Job]:
    """Return all jobs, those first on which others may wait."""
    jobs = [
        *_environment_jobs(),
        *_learning_jobs(),
        *_bench_jobs(),
        *_travel_jobs(),
        *_run_jobs(),
        *_recording_jobs(),
        *_text_jobs(),
    ]
    names = [job.name for job in jobs]
    assert len({*names}) == len(names), names
    return sorted(jobs, key=lambda job: -job.cost_s)


# --- runs ------------------------------------------------------------------------------------------------------------


def scenario_names() -> list[str]:
    """Return the names of the bundled scenarios."""
    return [path.stem for path in sorted(SCENARIOS.glob("*.yaml"))]


def _run_jobs() -> Iterator[Job]:
    for name in scenario_names():
        limit_s = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text())["referee"]["stop"]["time_limit_s"]
        short = ("--set", f"referee.stop.time_limit_s={SHORT_S}") if limit_s > SHORT_S else ()
        for seed in SEEDS:
            for processes in PROCESSES:
                words = (name, "--seed", str(seed), *short)
                yield Job(f"run/{name}/seed{seed}/{processes}", _Run(words, processes), 2 if processes == "one" else 6)
        if short:
            yield Job(f"run/{name}/full", _Run((name,), "one"), 9)
    for file in ("every_vehicle", "around_a_wall"):
        for processes in PROCESSES:
            yield Job(f"run/{file}/{processes}", _Run((END_TO_END / f"{file}.yaml",), processes), 4)
    for mode in ("lockstep", "{latency: 3}"):
        words = ("tiny_room", "--set", f"agents[0].mode={mode}", "--set", "referee.stop.time_limit_s=8")
        for processes in PROCESSES:
            yield Job(
                f"run/tiny_room/{re.sub(r'[^a-z0-9]+', '_', mode).strip('_')}/{processes}", _Run(words, processes)
            )
    frames = f"command: [{sys.executable}, {ROOT}/docs/examples/frames.py]"
    starts = {"stdio": "python: dung_beetle", "unix": frames, "tcp": frames}
    for door, program in starts.items():
        words = ("tiny_room", "--set", f"agents[0].start={{{program}, door: {door}}}")
        yield Job(f"run/tiny_room/{door}", _Run(words, "separate"))


@dataclass(frozen=True)
class _Run:
    words: tuple[str | Path, ...]
    processes: str

    def __call__(self) -> Entry:
        return fly(*self.words, processes=self.processes)[0]


def fly(*words: str | Path, processes: str, is_recorded: bool = False, runs: str = "runs") -> tuple[Entry, Path]:
    """Fly, and return what came of it and the run's folder."""
    call = gslcosim if processes == "one" else gslcosim_apart
    recording = () if is_recorded else ("--set", "recording.enabled=false")
    ended = call(
        "up", *words, *recording, "--processes", processes, "--runs-dir", runs, "--json", "--quiet", expected=ENDED
    )
    folder = Path(runs).resolve() / ended.fields["run_id"]
    return outcome_of(ended.fields) | (ports_of(folder) if processes == "one" else {}), folder


def outcome_of(result: dict[str, Any]) -> Entry:
    """Return what a result says, without wall times and how agents were kept apart."""
    late = any("did not answer within" in fault["text"] for fault in result["faults"])
    if late or not result["valid"]:
        raise CommandFailed(f"expected a valid run in time, was {json.dumps(result['faults'])[:800]}")
    return {
        "digest": result["digest"],
        "end": f"{result['end_reason']} at tick {result['ticks']}",
        "agents": hash_of_fields(result["agents"]),
        "faults": hash_of_fields(result["faults"]) if result["faults"] else "none",
    }


def ports_of(folder: Path) -> Entry:
    """Return a hash of what each port of a run has carried."""
    ports = json.loads((folder / "digest.json").read_text())["ports"]
    return {port: hash_of_fields([each["ticks"], each["links"]])[:12] for port, each in ports.items()}


# --- runs repeated, continued, forked and disturbed ------------------------------------------------------------------

TRAVELLED = {
    "tiny_room": ("tiny_room", "--seed", "2"),
    "swarm_tiny": ("swarm_tiny", "--seed", "2"),
    "event_source": ("event_source", "--seed", "2"),
    "every_vehicle": (str(END_TO_END / "every_vehicle.yaml"),),
}
FORKS = {
    "same": (),
    "seed": ("--set", "agents[0].seed=4711"),
    "agent": ("--agent", "{first}=spiral"),
    "event": ("--event", "{{what: sensor_sticks, at_s: 6.5, agent: {first}, sensor: nose}}"),
}
# Nobody comes that near: the run lasts long enough to be disturbed.
LONG = ("--set", "referee.success.within_m=0.02", "--set", "referee.stop.time_limit_s=40")
RESTARTS = ("--set", "snapshots.every_s=5", "--set", "restart={tries: 2}")


def _travel_jobs() -> Iterator[Job]:
    for name, words in TRAVELLED.items():
        yield Job(f"travel/{name}", _Travel(words), 8, has_parts=True)
    for service in ("world", "fields", "sensing", "referee"):
        yield Job(f"restart/{service}", _Restart(service), 6)
    yield Job("restart/undisturbed", _Run(("tiny_room", *LONG, *RESTARTS), "one"), 6)
    for name in ("tiny_room", "warehouse_racks"):
        yield Job(f"tape/{name}", _Tape(name), 8, has_parts=True)


@dataclass(frozen=True)
class _Travel:
    words: tuple[str, ...]

    def __call__(self) -> dict[str, Entry]:
        entries = {}
        entries["past"], past = fly(*self.words, "--set", "snapshots.every_s=3", processes="one")
        first = yaml.safe_load((past / "scenario.yaml").read_text())["agents"][0]["name"]
        common = ("--runs-dir", "again", "--json")
        for name, more in {"replay": (), "resume": ("--from", "6.5")}.items():
            result = gslcosim("replay", past, "--no-recording", "--quiet", *more, *common).fields
            entries[name] = {**outcome_of(result), "snapshot": str(result["comparison"].get("snapshot_tick"))}
        unrecorded = ("--set", "recording.enabled=false", "--quiet")
        for name, change in FORKS.items():
            change = tuple(word.format(first=first) for word in change)
            for start_at, more in {"snapshot": (), "start": ("--from-start",)}.items():
                words = ("fork", past, "--at", "6", "--in-process", *unrecorded, *change, *more, *common)
                entries[f"fork_{name}/{start_at}"] = outcome_of(gslcosim(*words, expected=ENDED).fields)
        return entries


@dataclass(frozen=True)
class _Tape:
    """A run that records its gas on tape, and one that reads it."""

    scenario: str

    def __call__(self) -> dict[str, Entry]:
        # No other run has this seed, so that nothing is on tape yet where the freeze begins.
        words = (self.scenario, "--seed", "11", "--set", "gas.tape=true", "--set", "referee.stop.time_limit_s=20")
        return {
            "recorded": fly(*words, processes="one")[0],
            "read": fly(*words, processes="one")[0],
            "separate": fly(*words, processes="separate")[0],
        }


@dataclass(frozen=True)
class _Restart:
    """A run in which one service is killed after a snapshot, and started again."""

    service: str

    def __call__(self) -> Entry:
        unrecorded = ("--set", "recording.enabled=false", "--runs-dir", "runs", "--quiet", "--json")
        # Its time follows the clock: it does not end before the service is killed.
        process = start("up", "tiny_room", *LONG, *RESTARTS, "--pace", "10", *unrecorded)
        deadline = time.monotonic() + LIMIT_S
        try:
            while not any(Path("runs").glob(f"*/snapshots/000000050/{self.service}.snap")):
                self._wait_for(process, deadline)
            while (pid := self._pid()) is None:
                self._wait_for(process, deadline)
            os.kill(pid, signal.SIGKILL)
            output, errors = process.communicate(timeout=LIMIT_S)
        finally:
            process.terminate()
        if process.returncode not in ENDED:
            raise CommandFailed(errors[-800:])
        result = json.loads(output)
        return {**outcome_of(result), "restarts": str(len(result["restarts"]))}

    def _pid(self) -> int | None:
        (run,) = Path("runs").iterdir()
        ended = gslcosim("runs", "top", run.resolve(), "--once", "--every", "0.2", "--json")
        of = {each["name"]: each["pid"] for each in ended.fields["participants"]}
        return of.get(self.service)

    def _wait_for(self, process: Any, deadline: float) -> None:
        if process.poll() is not None or time.monotonic() > deadline:
            raise CommandFailed(f"expected {self.service} to be killed, but the run is over or hangs")
        time.sleep(0.01)


# --- recordings ------------------------------------------------------------------------------------------------------

RECORDED = ("tiny_room", "swarm_tiny", "event_source", "on_board_sensors")


def _recording_jobs() -> Iterator[Job]:
    for name in RECORDED:
        yield Job(f"recording/{name}", _Recording(name), 10)


@dataclass(frozen=True)
class _Recording:
    """The tables of a recorded run."""

    scenario: str

    def __call__(self) -> Entry:
        entry, folder = fly(self.scenario, processes="one", is_recorded=True)
        gslcosim("extract", folder, "--to", "csv", "--out", "tables", "--json")
        return {"digest": entry["digest"], **{path.name: _hash_of_table(path) for path in Path("tables").glob("*.csv")}}


def _hash_of_table(path: Path) -> str:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    # How long a decision took is measured by the clock.
    kept = [i for i, name in enumerate(rows[0]) if not name.startswith("decision_time")]
    return hash_of_fields([[row[i] for i in kept] for row in rows])


# --- environments ----------------------------------------------------------------------------------------------------


def _environment_jobs() -> Iterator[Job]:
    known = set()
    for path in [*sorted(SCENARIOS.glob("*.yaml")), *sorted(SCENARIOS.glob("suites/methods/*.yaml"))]:
        content = yaml.safe_load(path.read_text())
        if "environment" not in content or "layout" not in content["environment"]:
            continue
        key = json.dumps([content["environment"], content.get("wind")])
        if key not in known:
            known.add(key)
            yield Job(f"environment/{path.stem}", _Environment(str(path)), 30)
    for kind in ("warehouse_empty", "warehouse_simple", "warehouse_complex"):
        yield Job(f"environment/of_{kind}", _Environment(kind, ("--seed", "5", "--set", "wind.cell_m=0.5")), 15)


@dataclass(frozen=True)
class _Environment:
    source: str
    words: tuple[str, ...] = ()

    def __call__(self) -> Entry:
        (made,) = gslcosim("environment", "generate", self.source, *self.words, "--out", "room", "--json").fields
        entry: Entry = {"notices": hash_of_fields(made["notices"])}
        for path in sorted(Path("room").rglob("*")):
            if path.name == "environment.yaml":
                # How it was made has versions of packages.
                content = {k: v for k, v in yaml.safe_load(path.read_text()).items() if k != "made_from"}
                entry |= {key: hash_of_fields(value) for key, value in content.items() if key != "content_hash"}
                entry["content_hash"] = content["content_hash"]
            elif path.suffix == ".npy":
                entry[path.name] = _hash_of_array(np.load(path))
            elif path.is_file() and path.suffix != ".png":
                entry[path.name] = hash_of(path.read_bytes())
        return entry


# --- learning --------------------------------------------------------------------------------------------------------


def _learning_jobs() -> Iterator[Job]:
    yield Job("batch/open_halls", _Batch("open_halls", 3, ()), 40)
    yield Job("batch/cluttered_halls", _Batch("cluttered_halls", 1, ()), 60)
    yield Job("batch/open_halls_lockstep", _Batch("open_halls", 2, ("agents[0].mode=lockstep",)), 30)
    yield Job("train/open_halls_tiny", _train, 40)


@dataclass(frozen=True)
class _Batch:
    family: str
    n_cases: int
    overrides: tuple[str, ...]

    def __call__(self) -> Entry:
        import learning

        return learning.batch_and_single(self.family, self.n_cases, self.overrides)


def _train() -> Entry:
    gslcosim("train", "open_halls_tiny", "--out", "trained", "--record", "0", "--json")
    with np.load("trained/policy.npz") as arrays:
        # The card of a policy says with which versions it was made.
        return {name: _hash_of_array(arrays[name]) for name in arrays.files if arrays[name].dtype.kind == "f"}


def _hash_of_array(array: Any) -> str:
    return f"{hash_of(array.tobytes())} {array.dtype} {'x'.join(map(str, array.shape))}"


# --- suites ----------------------------------------------------------------------------------------------------------


def _bench_jobs() -> Iterator[Job]:
    yield Job("bench/smoke", _Bench("smoke", ()), 20, has_parts=True)
    # Every bundled method once, among obstacles, and every swarm.
    once = ("--only", "repetition=0", "--only")
    yield Job("bench/methods", _Bench("methods", (*once, "scenario=racks")), 100, has_parts=True)
    yield Job("bench/swarms", _Bench("swarms", (*once, "scenario=racks")), 60, has_parts=True)


# What differs from call to call, machine to machine, or with where code lies.
LEFT_OUT = re.compile(r"wall_|trial$|sandbox$")


@dataclass(frozen=True)
class _Bench:
    suite: str
    words: tuple[str, ...]

    def __call__(self) -> dict[str, Entry]:
        gslcosim(
            "bench", "run", self.suite, *self.words, "--results", "results", "--jobs", "1", "--no-report", "--json"
        )
        rows = parquet.read_table("results/trials.parquet").to_pylist()
        tracks = {row["trial"]: {} for row in rows}
        for track in parquet.read_table("results/tracks.parquet").to_pylist():
            trial = track.pop("trial")
            tracks[trial][track.pop("agent")] = track
        entries = {}
        for row in rows:
            name = f"{row['case']}/{row['repetition']}/{row['entry']}{'/control' if row['is_control'] else ''}"
            kept = {key: value for key, value in row.items() if not LEFT_OUT.match(key) and value not in (None, "")}
            entries[name] = {key: str(value) for key, value in kept.items()}
            entries[name]["tracks"] = hash_of_fields(tracks[row["trial"]])
        return entries


# --- texts: the contract, lists, resolved scenarios, errors ----------------------------------------------------------


def _text_jobs() -> Iterator[Job]:
    yield Job("wire/contract", _contract, 2, is_portable=True)
    yield Job("wire/past_contracts", _past_contracts, 1, is_portable=True)
    yield Job("list", _listed, 2, is_portable=True, has_parts=True)
    yield Job("resolved", _resolved, 5, is_portable=True, has_parts=True)
    yield Job("error", lambda: errors_of(bad_inputs()), 10, is_portable=True, has_parts=True)


def _contract() -> Entry:
    gslcosim("schema", "export", "contract")
    files = sorted(path for path in Path("contract").rglob("*") if path.is_file())
    return {path.relative_to("contract").as_posix(): hash_of(path.read_bytes()) for path in files}


def _past_contracts() -> Entry:
    return {path.name: hash_of(path.read_bytes()) for path in sorted(PAST_CONTRACTS.glob("contract_*.json"))}


def _listed() -> dict[str, Entry]:
    kinds = gslcosim("list", "--json").fields
    return {kind: {each["name"]: hash_of_fields(_without_files(each)) for each in kinds[kind]} for kind in kinds}


def _without_files(listed: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in listed.items() if key != "file"}


def _resolved() -> dict[str, Entry]:
    """Every scenario with all defaults, a hash for each of its blocks."""
    files = [path for path in sorted(SCENARIOS.rglob("*.yaml")) if _is_scenario(path)]
    files += [path for path in sorted(END_TO_END.glob("*.yaml")) if _is_scenario(path)]
    entries = {}
    for path in files:
        text = gslcosim("validate", path, "--resolved").output
        name = path.relative_to(ROOT).with_suffix("").as_posix().removeprefix("scenarios/")
        entries[name] = {key: hash_of_fields(value) for key, value in yaml.safe_load(text).items()}
    return entries


def _is_scenario(path: Path) -> bool:
    return path.read_text().lstrip().startswith("schema: gslcosim/scenario/") or "\nschema: gslcosim/scenario/" in (
        path.read_text()
    )


def errors_of(cases: list[dict[str, Any]]) -> dict[str, Entry]:
    """Return what the command line says of bad inputs, each with its files in a folder of its own."""
    entries = {}
    for case in cases:
        folder = Path(case["name"])
        folder.mkdir(parents=True)
        for name, text in case["files"].items():
            (folder / name).write_text(text, encoding="utf-8")
        entries[case["name"]] = _refusal(folder, case["call"])
    return entries


def bad_inputs() -> list[dict[str, Any]]:
    """Return the bad inputs of the tests: a name, the files that are there, and the call."""
    return [json.loads(line) for line in BAD_INPUTS.read_text(encoding="utf-8").splitlines()]


def _refusal(folder: Path, call: list[str]) -> Entry:
    with contextlib.chdir(folder):
        ended = gslcosim(*call, expected=tuple(range(6)))
    text = f"{ended.output}{ended.errors}".replace(str(folder.resolve()), "HERE").replace(str(ROOT), "ROOT")
    return {"exit_code": str(ended.exit_code), "text": text.strip()}
