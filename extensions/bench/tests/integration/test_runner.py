"""A suite flown by real workers: the same whatever happens to them, and nothing lost."""

import contextlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import pytest
from deadlines import EVENT_S, PROCESS_S
from mounts import mounted
from real_runs import wait_a_moment

from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_bench.cases import build_plan, load_suite
from gslcosim_bench.cases.models import Selection
from gslcosim_bench.commands.suite_output import format_status_of_results
from gslcosim_bench.execution.runner import StaleRows, SuiteRun
from gslcosim_bench.results import read_state
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.verification_marks import find_mark

HOSTILE = Path(__file__).parent / "hostile"
HOSTILE_SUITE = """
schema: gslcosim/suite/1
name: hostile
scenarios: [tiny_room]
anchors: [oracle]
entries:
  - {name: crashes, start: {python: crashes.py}}
  - {name: eats, start: {python: eats.py}}
  - {name: floods, start: {python: floods.py}}
  - {name: raises, start: {python: raises.py}}
  - {name: stops, start: {python: stops.py}}
  - {name: leaves, start: {command: [sh, -c, "echo bye >&2; exit 3"], door: stdio}}
limits: {wall_s: 120, memory_mb: 500}
"""
HANGING_SUITE = """
schema: gslcosim/suite/1
name: hanging
scenarios: [tiny_room]
anchors: []
entries: [{name: hangs, start: {python: hangs.py}}]
limits: {wall_s: 2}
"""


def bench(*words: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    """Call the command in this process, which has imported everything; its workers are processes of their own."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.chdir(cwd), contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        exit_code = main(["bench", *words])
    return subprocess.CompletedProcess(words, exit_code, output.getvalue(), errors.getvalue())


def _command(*words: str) -> list[str]:
    return [sys.executable, "-m", "gslcosim", "bench", *words]


def rows_of(folder: Path) -> list[dict[str, Any]]:
    table = pq.read_table(folder / "trials.parquet")
    names = [name for name in table.schema.names if not name.startswith("wall_")]
    return table.select(names).to_pylist()


@pytest.fixture(scope="module")
def smoke(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the bundled suite `smoke` by one worker."""
    folder = tmp_path_factory.mktemp("smoke")
    ended = bench("run", "smoke", "--jobs", "1", cwd=folder)
    assert ended.returncode == 0, ended.stderr
    assert "Report: results/smoke/report.html" in ended.stdout
    return folder / "results" / "smoke"


@pytest.mark.end_to_end
def test_two_workers_bring_the_same_rows_and_tracks_as_one(smoke: Path, tmp_path: Path) -> None:
    ended = bench("run", "smoke", "--jobs", "2", "--no-report", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    other = tmp_path / "results" / "smoke"
    assert rows_of(other) == rows_of(smoke)
    assert (other / "tracks.parquet").read_bytes() == (smoke / "tracks.parquet").read_bytes()
    assert len(rows_of(smoke)) == 12
    assert "dung_beetle" in (smoke / "report.html").read_text()
    assert {row["entry"] for row in json.loads((smoke / "leaderboard.json").read_text())["views"][0]["rows"]} == {
        "dung_beetle", "oracle", "random_walker",
    }  # fmt: skip
    assert {row["status"] for row in rows_of(smoke)} == {"flown"}


@pytest.mark.end_to_end
def test_a_run_that_was_killed_goes_on_and_ends_the_same(smoke: Path, tmp_path: Path) -> None:
    folder = tmp_path / "results" / "smoke"
    run = subprocess.Popen(_command("run", "smoke", "--jobs", "2", "--no-report"), cwd=tmp_path, start_new_session=True)
    workers = _kill_after_first_row(run, folder / "rows.jsonl")
    psutil.wait_procs(workers, timeout=EVENT_S)
    assert not any(worker.is_running() for worker in workers)
    n_kept = len((folder / "rows.jsonl").read_bytes().splitlines())
    assert 0 < n_kept < 12
    assert bench("report", str(folder), cwd=tmp_path).returncode == 0
    ended = bench("run", "smoke", "--jobs", "1", "--json", "--no-report", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    printed = json.loads(ended.stdout)
    assert printed["n_flown_before"] >= n_kept - 1
    assert printed["n_flown"] + printed["n_flown_before"] == 12
    assert rows_of(folder) == rows_of(smoke)


def _kill_after_first_row(run: "subprocess.Popen[bytes]", journal: Path) -> list[psutil.Process]:
    deadline = time.monotonic() + PROCESS_S
    while not (journal.is_file() and journal.stat().st_size > 0):
        assert run.poll() is None
        assert time.monotonic() < deadline
        wait_a_moment()
    workers = psutil.Process(run.pid).children(recursive=True)
    run.send_signal(signal.SIGKILL)
    run.wait()
    return workers


@pytest.mark.end_to_end
def test_ctrl_c_leaves_whole_tables_and_no_worker(smoke: Path, tmp_path: Path) -> None:
    folder = tmp_path / "results" / "smoke"
    # Whoever runs the tests in the background may have had SIGINT ignored, which children inherit.
    run = subprocess.Popen(
        _command("run", "smoke", "--jobs", "1", "--no-report"), cwd=tmp_path, stdout=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    journal = folder / "rows.jsonl"
    deadline = time.monotonic() + PROCESS_S
    while not (journal.is_file() and journal.stat().st_size > 0):
        assert run.poll() is None
        assert time.monotonic() < deadline
        wait_a_moment()
    workers = psutil.Process(run.pid).children(recursive=True)
    run.send_signal(signal.SIGINT)
    text, _ = run.communicate(timeout=PROCESS_S)
    assert run.returncode == 130
    assert "Repeat the command to resume." in text
    psutil.wait_procs(workers, timeout=EVENT_S)
    assert not any(worker.is_running() for worker in workers)
    kept = rows_of(folder)
    assert 0 < len(kept) < 12
    assert all(row in rows_of(smoke) for row in kept)


@pytest.mark.end_to_end
@pytest.mark.slow
def test_each_hostile_agent_ends_in_a_row_that_says_so(tmp_path: Path) -> None:
    for file in HOSTILE.glob("*.py"):
        shutil.copy(file, tmp_path)
    (tmp_path / "suite.yaml").write_text(HOSTILE_SUITE)
    ended = bench("run", "suite.yaml", "--jobs", "2", "--no-report", cwd=tmp_path)
    assert ended.returncode == 1, ended.stderr
    rows = {row["entry"]: row for row in rows_of(tmp_path / "results" / "hostile")}
    assert {name: row["status"] for name, row in rows.items()} == {
        "crashes": "crashed", "eats": "out_of_memory", "floods": "flown", "raises": "flown",
        "leaves": "flown", "oracle": "flown", "stops": "crashed",
    }  # fmt: skip
    assert "code 7" in rows["crashes"]["fault"]
    assert "these are my last words" in rows["crashes"]["fault"]
    assert "500 MB" in rows["eats"]["fault"]
    assert "was stopped by a signal and not continued within 5 s" in rows["stops"]["fault"]
    assert re.search(r"worker_\d+ was stopped by a signal.*\. It is flown again\.", ended.stderr)
    assert rows["raises"]["outcome"] == rows["leaves"]["outcome"] == "agent_failed"
    assert "no idea" in rows["raises"]["agent_faults"]
    assert "bye" in rows["leaves"]["agent_faults"]
    assert rows["oracle"]["success"]


@pytest.mark.end_to_end
@pytest.mark.slow
def test_an_agent_that_hangs_ends_in_a_row_that_says_so(tmp_path: Path) -> None:
    shutil.copy(HOSTILE / "hangs.py", tmp_path)
    (tmp_path / "suite.yaml").write_text(HANGING_SUITE)
    ended = bench("run", "suite.yaml", "--jobs", "1", "--no-report", cwd=tmp_path)
    assert ended.returncode == 1, ended.stderr
    (row,) = rows_of(tmp_path / "results" / "hanging")
    assert row["status"] == "hung"
    assert "2 s by the clock" in row["fault"]


@pytest.mark.end_to_end
def test_a_second_run_in_the_folder_is_refused(smoke: Path, tmp_path: Path) -> None:
    with ResultsFolder(tmp_path / "results" / "smoke").locked():
        ended = bench("run", "smoke", cwd=tmp_path)
    assert ended.returncode == 2
    assert f"in use by process {os.getpid()}" in ended.stderr


@pytest.mark.end_to_end
def test_rows_of_another_seed_stay_where_the_answer_is_no(smoke: Path, tmp_path: Path) -> None:
    shutil.copytree(smoke, tmp_path / "smoke")
    rows, asked = rows_of(tmp_path / "smoke"), []

    def answer(stale: StaleRows) -> bool:
        asked.append((stale.n_stale, stale.n_rows, stale.changes))
        return False

    run = SuiteRun(
        build_plan(load_suite("smoke", seed=99)),
        ResultsFolder(tmp_path / "smoke"),
        lambda: pytest.fail("nothing is to be run"),
        selection=Selection(),
        confirm_put_aside=answer,
    )
    with pytest.raises(UsageError, match="The results are as they were"):
        run.fly()
    assert asked == [(len(rows), len(rows), ("cases or seeds of the suite",))]
    assert rows_of(tmp_path / "smoke") == rows
    assert not list((tmp_path / "smoke").glob("earlier-*"))


@pytest.mark.end_to_end
def test_the_state_of_a_folder_is_complete_or_not(smoke: Path, tmp_path: Path) -> None:
    state = read_state(smoke)
    assert (state["state"], state["n_rows"], state["n_planned"], state["run"]) == ("complete", 12, 12, None)
    assert state["entries"]["oracle"] == {"n": 2, "found": 2}
    copy = tmp_path / "smoke"
    shutil.copytree(smoke, copy, ignore=shutil.ignore_patterns("recordings", "trials.parquet", "tracks.parquet"))
    assert read_state(copy)["state"] == "not complete"
    assert "12 of 12 planned trials" in format_status_of_results(state)
    with ResultsFolder(copy).locked():
        assert read_state(copy)["state"] == "running"


@pytest.mark.end_to_end
def test_a_run_of_some_trials_keeps_the_rows_of_the_others(smoke: Path, tmp_path: Path) -> None:
    copy = tmp_path / "smoke"
    shutil.copytree(smoke, copy)
    ended = bench("run", "smoke", "--only", "entry=oracle", "--results", str(copy), "--json", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    printed = json.loads(ended.stdout)
    assert (printed["n_planned"], printed["n_chosen"], printed["n_flown"], printed["put_aside"]) == (12, 4, 0, None)
    for name in ("trials.parquet", "tracks.parquet", "manifest.json", "maps.json"):
        assert (copy / name).read_bytes() == (smoke / name).read_bytes(), name


@pytest.mark.end_to_end
def test_a_full_disk_is_reported_and_costs_nothing_that_was_run(smoke: Path, tmp_path: Path) -> None:
    with mounted(tmp_path / "results", "size=4m") as disk:
        folder = disk / "smoke"
        shutil.copytree(smoke, folder, ignore=shutil.ignore_patterns("recordings", "trials.parquet", "tracks.parquet"))
        filler = disk / "filler"
        # Room for what is written before the first row.
        filler.write_bytes(bytes(shutil.disk_usage(disk).free - 16_384))
        ended = bench("run", "smoke", "--jobs", "1", "--no-report", cwd=tmp_path)
        assert ended.returncode == 3
        assert "was no space left on device. Free room there" in ended.stderr
        assert "the same command again" in ended.stderr
        filler.unlink()
        assert bench("run", "smoke", "--jobs", "1", "--no-report", cwd=tmp_path).returncode == 0
        assert rows_of(folder) == rows_of(smoke)


@pytest.mark.end_to_end
def test_verify_finds_a_row_that_was_changed(smoke: Path, tmp_path: Path) -> None:
    folder = tmp_path / "changed"
    shutil.copytree(smoke, folder, ignore=shutil.ignore_patterns("recordings"))
    shown = bench("verify", str(folder), "--jobs", "1", "--sample", "2", "--json", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert json.loads(shown.stdout)["same"] == 2
    mark = find_mark(folder)
    assert mark is not None
    assert (mark.same, mark.sample, mark.n_missing) == (2, 2, 0)
    table = pq.read_table(folder / "trials.parquet")
    i = table.schema.get_field_index("time_s")
    flattered = table.set_column(i, table.schema.field(i), [[1.0] * table.num_rows])
    pq.write_table(flattered, folder / "trials.parquet")
    shown = bench("verify", str(folder), "--jobs", "1", "--sample", "1", cwd=tmp_path)
    assert shown.returncode == 5
    assert "time_s was 1.0, is" in shown.stdout
    mark = find_mark(folder)
    assert mark is not None
    assert mark.same < mark.sample == 1
