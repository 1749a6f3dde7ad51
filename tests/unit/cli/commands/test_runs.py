"""`gslcosim runs`: a table of run folders, chosen, removed and made whole."""

import json
import os
import shutil
import socket
import threading
import time

import pytest

from gslcosim.cli.commands.runs import format_age
from gslcosim.cli.main import main

RESULT = {
    "schema": "gslcosim/result/1",
    "scenario": "tiny_room",
    "real_time_factor": 80.0,
    "faults": [],
    "agents": [],
}


@pytest.fixture
def runs(tmp_path):
    """Make a folder with three runs that have ended, one that is broken, and something else."""
    for i, (reason, time_s) in enumerate((("success", 10.0), ("collision", 5.0), ("time_limit", 60.0))):
        folder = tmp_path / f"run_{i}"
        (folder / "logs").mkdir(parents=True)
        (folder / "manifest.json").write_text(json.dumps({"run_id": folder.name, "seed": i}))
        (folder / "result.json").write_text(
            json.dumps(RESULT | {"seed": i, "end_reason": reason, "sim_time_s": time_s})
        )
    (tmp_path / "killed" / "logs").mkdir(parents=True)
    (tmp_path / "killed" / "manifest.json").write_text('{"run_id": "killed", "seed": 9}')
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.png").write_bytes(b"0")
    return tmp_path


def listed(capsys, *words):
    assert main(["runs", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_runs_are_listed_as_what_they_are(runs, capsys):
    rows = {row["run"]: row for row in listed(capsys, runs)}
    states = {name: row["state"] for name, row in rows.items()}
    assert states == {"run_0": "ended", "run_1": "ended", "run_2": "ended", "killed": "broken", "photos": "foreign"}
    assert main(["runs", str(runs), "--sort", "-time"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:5] == ["run", "scenario", "method", "seed", "outcome"]
    assert [line.split()[0] for line in lines[1:4]] == ["run_2", "run_0", "run_1"]
    assert "broken: no result.json" in "\n".join(lines)


def test_conditions_and_a_limit_choose(runs, capsys):
    words = (runs, "--where", "state=ended", "--where", "time<30", "--sort", "time")
    assert [row["run"] for row in listed(capsys, *words)] == ["run_1", "run_0"]
    assert [row["run"] for row in listed(capsys, *words, "--limit", "1")] == ["run_1"]
    assert [row["run"] for row in listed(capsys, runs / "run_2")] == ["run_2"]


def test_removing_says_what_it_would_do_and_does_it_with_yes(runs, capsys):
    words = ["runs", "remove", str(runs), "--where", "outcome!=success"]
    assert main(words) == 0
    output = capsys.readouterr().out
    assert "Would remove 2 runs" in output
    assert (runs / "run_1").is_dir()
    assert main([*words, "--yes"]) == 0
    output = capsys.readouterr().out
    assert "Removed 2 runs" in output
    assert "photos: not a run" in output
    assert "killed: it has no result and was written to in the last 10 minutes" in output
    assert sorted(path.name for path in runs.iterdir()) == ["killed", "photos", "run_0"]


def test_a_broken_run_that_is_quiet_is_removed_and_what_a_link_leads_to_stays(runs, capsys):
    elsewhere = shutil.move(runs / "run_0", runs.parent / f"{runs.name}_elsewhere")
    (runs / "run_0").symlink_to(elsewhere)
    for path in (runs / "killed" / "manifest.json", runs / "killed" / "logs", runs / "killed"):
        os.utime(path, (time.time() - 7200,) * 2)
    assert main(["runs", "remove", str(runs), "--where", "run!=none", "--yes"]) == 0
    assert "run_0: not a run" in capsys.readouterr().out
    assert sorted(path.name for path in runs.iterdir()) == ["photos", "run_0"]
    assert (elsewhere / "result.json").is_file()


def test_a_run_that_goes_on_is_shown_so_and_never_removed(runs, capsys, monkeypatch):
    """Its window is one of ours, behind which this test stands."""
    windows = runs / "w"
    windows.mkdir()
    monkeypatch.setattr("gslcosim.runtime.status.get_status_folder", lambda: windows)
    facts = {
        "run_id": "killed", "run_dir": str((runs / "killed").resolve()), "began_at": "", "state": "flying", "text": "",
        "processes": "one", "wall_s": 1.0, "time_limit_s": 60.0, "sim_time_s": 7.5, "real_time_factor": 50.0,
        "participants": [],
    }  # fmt: skip
    monkeypatch.chdir(windows)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as window:
        window.bind("a.flight")
        window.listen()

        def tell():
            for _ in range(2):
                connection, _ = window.accept()
                with connection:
                    connection.sendall(json.dumps(facts).encode())

        teller = threading.Thread(target=tell)
        teller.start()
        (row,) = [row for row in listed(capsys, runs) if row["run"] == "killed"]
        assert (row["state"], row["outcome"], row["time_s"]) == ("running", "flying", 7.5)
        assert main(["runs", "remove", str(runs), "--where", "run=killed", "--yes"]) == 0
        teller.join()
    assert "it goes on; gslcosim runs stop ends it" in capsys.readouterr().out
    assert (runs / "killed").is_dir()


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (["--where", "size>1"], ""),
        (["--where", "colour=red"], "expected one of the columns run, folder, state"),
        (["--sort", "colour"], "expected one of the columns run, folder, state"),
        (["--yes"], "expected --yes with remove only"),
        (["--limit", "0"], "expected a whole number of at least 1"),
    ],
)
def test_wrong_words_are_reported(runs, capsys, words, output):
    assert main(["runs", str(runs), *words]) == (2 if output else 0)
    assert output in capsys.readouterr().err


def test_removing_without_a_condition_and_folders_that_are_none_are_refused(runs, capsys):
    assert main(["runs", "remove", str(runs)]) == 2
    assert "expected --where, which says what to remove" in capsys.readouterr().err
    assert main(["runs", str(runs / "nowhere")]) == 2
    assert "expected a folder of runs, found none" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("age_h", "text"), [(0.005, "18 s"), (0.5, "30 min"), (5.0, "5 h"), (47.0, "47 h"), (72.0, "3 d")]
)
def test_ages_are_reported_in_the_unit_that_people_use(age_h, text):
    assert format_age(age_h) == text


DAMAGED = {
    "empty": b"",
    "null": b"null",
    "deep": b"[" * 100_000,
    "wrong": b'{"schema": "gslcosim/result/1", "end_reason": [], "seed": "\xc2\xb2", "agents": [1, {"steps": {}}]}',
    "bare": b'{"schema": "gslcosim/result/1"}',
    "huge": b'{"schema": "gslcosim/result/1", "sim_time_s": 1e999, "seed": ' + b"9" * 5000 + b"}",
    "binary": bytes(range(256)),
}


@pytest.mark.parametrize("name", ["result.json", "manifest.json", "scenario.yaml"])
def test_one_damaged_folder_hides_no_other(runs, capsys, name):
    for kind, content in DAMAGED.items():
        folder = runs / kind
        (folder / "logs").mkdir(parents=True)
        (folder / "manifest.json").write_text(json.dumps({"run_id": kind}))
        (folder / name).write_bytes(content)
    pipe = runs / "pipe"
    (pipe / "logs").mkdir(parents=True)
    os.mkfifo(pipe / name)
    rows = {row["run"]: row for row in listed(capsys, runs)}
    assert set(rows) == {"run_0", "run_1", "run_2", "killed", "photos", "pipe", *DAMAGED}
    assert [rows[f"run_{i}"]["state"] for i in range(3)] == ["ended"] * 3
    if name == "result.json":
        output = {kind: rows[kind]["outcome"] for kind in ("empty", "null", "deep", "binary")}
        assert set(output.values()) == {"result.json cannot be read"}
    assert main(["runs", str(runs), "--sort", "-seed"]) == 0
    assert "run_1" in capsys.readouterr().out
