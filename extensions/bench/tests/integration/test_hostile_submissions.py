"""Results that somebody sends who wants more than a rank: to run a program here, or to be believed."""

import json
import os
import re
import shutil
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import pytest

from gslcosim.base.checksums import CHECKSUMS_FILE
from gslcosim.base.errors import UsageError
from gslcosim.base.files import user_state_folder
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.cli.main import main
from gslcosim.runtime.processes.sandbox.selection import find_strongest_sandbox
from gslcosim.scenario import load_scenario
from gslcosim.scenario.serialization import dump_values, plain_values
from gslcosim_archive.submissions import rank
from gslcosim_bench import run
from gslcosim_bench.execution import verification
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.verification_marks import find_mark, results_hash

# Whatever of it runs says so outside, as far as it gets there.
AGENT = """
import os
from pathlib import Path
from gslcosim.agent_kit import Agent, run
from gslcosim.contract.messages import Command

def reach(how):
    for folder in (Path({outside!r}), Path({state!r})):
        try:
            folder.mkdir(exist_ok=True, parents=True)
            (folder / how).write_text("by the submission")
        except OSError:
            pass

reach("imported")
os.system("touch {outside}/shell 2> /dev/null")

class Holding(Agent):
    def __init__(self, briefing):
        reach("begun")

    def decide(self, observation):
        reach("decided")
        return Command(tick=observation.tick, kind="hold")

if __name__ == "__main__":
    run(Holding)
"""
PROGRAM = """
import contextlib
from pathlib import Path
with contextlib.suppress(OSError):
    (Path({outside!r}) / "command").write_text("by the submission")
"""
SUITE = """
schema: gslcosim/suite/1
name: sent
scenarios: [{source: room.yaml}]
repetitions: 2
anchors: []
entries:
  - {name: python, start: {python: agent.py}}
  - {name: command, start: {command: [PYTHON, program.py], door: stdio}}
"""

pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.slow,
    pytest.mark.skipif(find_strongest_sandbox() == "none", reason="this machine has no sandbox"),
]


def scenario_text(**of_agent):
    values = plain_values(load_scenario("tiny_room", overrides=["referee.stop.time_limit_s=8"]).scenario)
    values["agents"][0] |= of_agent
    return dump_values(values)


@pytest.fixture(scope="module")
def sent(tmp_path_factory):
    """Results as they come, flown by their author, and the places that their programs want to write to."""
    root = tmp_path_factory.mktemp("sent")
    outside = root / "outside"
    (root / "suite").mkdir()
    outside.mkdir()
    names = {"outside": str(outside), "state": str(user_state_folder() / "verified")}
    (root / "suite" / "agent.py").write_text(AGENT.format(**names))
    (root / "suite" / "program.py").write_text(PROGRAM.format(**names))
    (root / "suite" / "room.yaml").write_text(scenario_text(sandbox="none"))
    (root / "suite" / "suite.yaml").write_text(
        SUITE.replace("PYTHON", shutil.which("python3", path="/usr/bin") or "python3")
    )
    run(root / "suite" / "suite.yaml", root / "results", jobs=1)
    assert {path.name for path in outside.iterdir()} == {"imported", "shell", "begun", "decided", "command"}
    return root / "results", outside


@pytest.fixture
def here(sent, tmp_path):
    """A copy of them, and nothing reached yet."""
    results, outside = sent
    for reached in (*outside.iterdir(), *(user_state_folder() / "verified").glob("*")):
        reached.unlink()
    folder = tmp_path / "sent"
    shutil.copytree(results, folder)
    return folder, outside


def verify(folder, *words):
    return main(["bench", "verify", str(folder), "--jobs", "1", "--sample", "4", *words])


def change_manifest(folder, **fields):
    path = ResultsFolder(folder).manifest
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))
    # As a forger does.
    (folder / CHECKSUMS_FILE).unlink(missing_ok=True)


def reached(outside):
    return {path.name for path in outside.iterdir()}


def test_programs_of_results_reach_nothing_while_they_are_verified(here, capsys):
    folder, outside = here
    assert verify(folder, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["same"], printed["sample"], printed["missing"]) == (4, 4, 0)
    assert all(kind.startswith(find_strongest_sandbox()) for kind in printed["sandboxes"])
    assert reached(outside) == set()
    assert sorted((user_state_folder() / "verified").iterdir()) == [
        user_state_folder() / "verified" / f"{results_hash(folder)}.json"
    ]


def test_programs_of_results_reach_nothing_while_one_is_shown(here, capsys):
    folder, outside = here
    trials = {row["entry"]: row["trial"] for row in ResultsFolder(folder).rows()}
    for trial in trials.values():
        assert main(["bench", "show", str(folder), "--trial", trial, "--no-view"]) == 0
        assert "the same as in the row" in capsys.readouterr().out
    assert reached(outside) == set()


def test_who_trusts_them_runs_them_as_they_are(here):
    """Otherwise the tests above would prove nothing."""
    folder, outside = here
    assert verify(folder, "--trusted") == 0
    assert reached(outside) == {"imported", "shell", "begun", "decided", "command"}


def test_without_a_sandbox_nothing_is_started(here, monkeypatch, capsys):
    folder, outside = here
    monkeypatch.setattr(verification, "find_strongest_sandbox", lambda: "none")
    assert verify(folder) == 2
    assert "expected a machine that has a sandbox for the programs of these results" in capsys.readouterr().err
    assert main(["bench", "show", str(folder), "--trial", "", "--no-view"]) == 2
    assert reached(outside) == set()


def test_a_python_agent_that_does_nothing_as_a_program_is_refused(here):
    """In a worker its class is enough; as a process it would end at once, and its runs differ."""
    folder, outside = here
    program = folder / "alone.py"
    program.write_text(AGENT.format(outside=outside, state=outside).partition("if __name__")[0])
    start = f"agents[0].start={json.dumps({'python': str(program)})}"
    scenario = load_scenario("tiny_room", overrides=[start]).scenario
    trial: Any = SimpleNamespace(entry="e", directory=folder, resolved=scenario)
    with pytest.raises(UsageError, match=r"expected a Python agent that is also a program, .*: run\(MyAgent\)"):
        verification.check_confinable([trial], folder)
    assert reached(outside) == set()


def test_an_agent_that_is_a_card_is_a_program(tmp_path):
    scenario = load_scenario("tiny_room", overrides=["agents[0].start.python=infotaxis"]).scenario
    trial: Any = SimpleNamespace(entry="e", directory=tmp_path, resolved=scenario)
    verification.check_confinable([trial], tmp_path)


@pytest.mark.parametrize("of", ["agents", "participants"])
@pytest.mark.parametrize(
    ("value", "is_trusted", "expected"),
    [
        ("./mine.so", False, "was './mine.so'. If you trust"),
        (None, False, "was one that takes the value set here. Ask their author"),
        (None, True, "was one that takes the value set here. Ask their author"),
        ("./mine.so", True, ""),
    ],
)
def test_variables_of_results_are_for_who_trusts_them_and_ours_for_nobody(tmp_path, of, value, is_trusted, expected):
    programs = json.dumps([{"name": "fan", "start": {"command": ["true"]}, "writes": ["state"]}])
    change = f"{of}[0].environment={json.dumps({'LD_PRELOAD': value})}"
    scenario = load_scenario("tiny_room", overrides=[f"participants={programs}", change]).scenario
    trial: Any = SimpleNamespace(entry="e", directory=tmp_path, resolved=scenario)
    if not expected:
        verification.check_confinable([trial], tmp_path, is_trusted=is_trusted)
        return
    with pytest.raises(UsageError, match=rf"{of}\.\w+\.environment\.LD_PRELOAD: .*{re.escape(expected)}"):
        verification.check_confinable([trial], tmp_path, is_trusted=is_trusted)


def test_units_of_results_are_theirs_and_nobody_elses(tmp_path):
    folder, outside = tmp_path / "sent", tmp_path / "outside"
    for place in (folder, outside):
        place.mkdir()
        (place / "fan.fmu").write_bytes(b"not looked into")

    fan = {"name": "fan", "start": {"command": ["true"]}, "writes": ["state"]}
    scenario = load_scenario("tiny_room", overrides=[f"participants={json.dumps([fan])}"]).scenario
    own = scenario.participants[0]

    def trial_with(unit) -> Any:
        start = own.start.model_copy(update={"command": None, "fmu": str(unit)})
        resolved = scenario.model_copy(update={"participants": (own.model_copy(update={"start": start}),)})
        return SimpleNamespace(entry="e", directory=folder, resolved=resolved)

    verification.check_confinable([trial_with("fan.fmu")], folder)
    with pytest.raises(UsageError, match=r"participants\.fan\.start: expected a command that .*outside"):
        verification.check_confinable([trial_with(outside / "fan.fmu")], folder)


@pytest.mark.parametrize(
    ("of_agent", "expected"),
    [
        ({"may_write": ["OUTSIDE"]}, r"asks for .*outside.* \(may_read, may_write\)"),
        ({"may_read": ["~"]}, r"asks for ~ \(may_read, may_write\)"),
    ],
)
def test_results_that_ask_for_folders_are_refused_before_anything_is_started(
    sent, tmp_path, monkeypatch, capsys, of_agent, expected
):
    results, outside = sent
    # A home of few files: its author's flights search all of what an agent may read for traces of the truth.
    monkeypatch.setenv("GSLCOSIM_CACHE", str(get_cache_root()))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    granted = json.loads(json.dumps(of_agent).replace("OUTSIDE", str(outside)))
    folder = flown_with(tmp_path, results, scenario_text(**granted), "")
    for path in outside.iterdir():
        path.unlink()
    assert verify(folder) == 2
    assert re.search(expected, capsys.readouterr().err)
    assert reached(outside) == set()


def test_a_command_that_names_a_folder_of_who_verifies_is_refused(sent, tmp_path, capsys):
    """The folders that a command names are seen in its sandbox."""
    results, _ = sent
    keys = tmp_path / "keys"
    keys.mkdir()
    entry = f"  - {{name: reader, start: {{command: [ls, {keys}], door: stdio}}}}\n"
    folder = flown_with(tmp_path, results, scenario_text(), entry)
    assert verify(folder, "--sample", "9") == 2
    assert f"was one that names something in {keys}" in capsys.readouterr().err


def flown_with(tmp_path, results, scenario, entry):
    """The same suite with another scenario and one more entry, flown by its author."""
    suite = tmp_path / "suite"
    shutil.copytree(results.parent / "suite", suite)
    (suite / "room.yaml").write_text(scenario)
    (suite / "suite.yaml").write_text((suite / "suite.yaml").read_text() + entry)
    run(suite / "suite.yaml", tmp_path / "results", jobs=1)
    return tmp_path / "results"


def test_a_program_that_is_a_link_to_a_file_of_who_verifies_is_refused(here, tmp_path, capsys):
    folder, outside = here
    # Behind the other in the order of paths, so that the hash of the program stays.
    private = tmp_path / "z_private"
    private.mkdir()
    program = folder / "agents" / "command" / "program.py"
    shutil.move(program, private / "program.py")
    program.symlink_to(private / "program.py")
    assert verify(folder) == 2
    assert "program.py: is a link" in capsys.readouterr().err
    trial = next(row["trial"] for row in ResultsFolder(folder).rows() if row["entry"] == "command")
    assert main(["bench", "show", str(folder), "--trial", trial, "--no-view"]) == 2
    assert f"was one that names something in {private}" in capsys.readouterr().err
    assert reached(outside) == set()


def test_what_a_folder_says_of_its_verification_is_not_believed(here):
    folder, _ = here
    change_manifest(folder, verified={"sample": 20, "same": 20, "at": "2026-01-01T00:00:00+00:00"})
    assert set(rank([folder]).verified.values()) == {None}
    # Nor what lies beside, whatever its name.
    for name in ("verified", ".gslcosim"):
        (folder / name).mkdir()
        (folder / name / f"{results_hash(folder)}.json").write_text('{"sample": 20, "same": 20, "at": ""}')
    assert find_mark(folder) is None


def test_a_mark_is_of_contents_and_not_of_a_place(here, tmp_path):
    """A copy is verified with its original; a changed row, program or manifest is not, and reports change nothing."""
    folder, _ = here
    assert verify(folder) == 0
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    assert set(rank([copy]).verified.values()) == {(4, 4)}
    assert main(["bench", "report", str(copy)]) == 0
    assert "4 of 4 trials flown again here gave the same digest" in (copy / "report.html").read_text()
    assert find_mark(copy) is not None
    table = pq.read_table(copy / "trials.parquet")
    i = table.schema.get_field_index("score")
    pq.write_table(table.set_column(i, table.schema.field(i), [[1.0] * table.num_rows]), copy / "trials.parquet")
    with pytest.raises(UsageError, match="expected the file as it was written, was changed since"):
        rank([copy])
    (copy / CHECKSUMS_FILE).unlink()
    assert set(rank([copy]).verified.values()) == {None}
    for change in (
        lambda path: (path / "agents_are_here.py").touch(),
        lambda path: change_manifest(path, title="best"),
    ):
        other = tmp_path / f"changed{len(list(tmp_path.iterdir()))}"
        shutil.copytree(folder, other)
        change(other)
        assert find_mark(other) is None


def test_a_merged_folder_keeps_its_marks_here_alone(here, tmp_path):
    folder, _ = here
    assert verify(folder) == 0
    rank([folder], tmp_path / "merged")
    rows = json.loads((tmp_path / "merged" / "leaderboard.json").read_text())["views"][0]["rows"]
    assert {row["verified"] for row in rows} == {True}
    change_manifest(tmp_path / "merged", title="forged")
    assert main(["bench", "report", str(tmp_path / "merged")]) == 0
    rows = json.loads((tmp_path / "merged" / "leaderboard.json").read_text())["views"][0]["rows"]
    assert {row["verified"] for row in rows} == {False}


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"suite_hash": "ab" * 12}, "expected suite_hash"),
        ({"entries": [{"name": "python", "agent_hash": "ab" * 12, "parameters": {}}]}, "expected agent_hash of python"),
        ({"entries": [{"name": "oracle", "agent_hash": None, "parameters": {}}]}, "parameters of oracle None"),
    ],
)
def test_a_manifest_that_claims_other_cases_or_programs_is_refused(here, capsys, fields, expected):
    """The hash of the suite decides with whom results are ranked: easier cases would stand beside the real ones."""
    folder, outside = here
    change_manifest(folder, **fields)
    assert verify(folder) == 2
    assert expected in capsys.readouterr().err
    assert reached(outside) == set()


def test_rows_that_were_left_out_are_reported_and_the_rest_is_not_verified(here, capsys):
    folder, _ = here
    table = pq.read_table(folder / "trials.parquet")
    pq.write_table(table.slice(0, 3), folder / "trials.parquet")
    assert verify(folder) == 0
    assert "1 trials of the suite have no row" in capsys.readouterr().out
    (folder / CHECKSUMS_FILE).unlink()
    assert set(rank([folder]).verified.values()) == {None}


def test_the_sample_is_not_known_before(here, capsys):
    """Otherwise the rest of the rows could be anything."""
    folder, _ = here
    seeds = set()
    for _ in range(2):
        assert verify(folder, "--sample", "1", "--json") == 0
        seeds.add(json.loads(capsys.readouterr().out)["seed"])
    assert len(seeds) == 2


def test_a_recording_that_came_along_is_not_shown(here, capsys):
    folder, _ = here
    trial = ResultsFolder(folder).rows()[0]["trial"]
    place = folder / "recordings" / trial
    place.mkdir(parents=True)
    (place / "recording.rrd").write_text("of another flight")
    assert main(["bench", "show", str(folder), "--trial", trial, "--no-view"]) == 0
    assert (place / "recording.rrd").read_bytes()[:4] == b"RRF2"


def test_recordings_that_would_lie_elsewhere_are_refused(here, tmp_path, capsys):
    folder, _ = here
    (tmp_path / "elsewhere").mkdir()
    shutil.rmtree(folder / "recordings", ignore_errors=True)
    (folder / "recordings").symlink_to(tmp_path / "elsewhere")
    trial = ResultsFolder(folder).rows()[0]["trial"]
    assert main(["bench", "show", str(folder), "--trial", trial, "--no-view"]) == 2
    assert "expected a folder of its own for recordings" in capsys.readouterr().err
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_pipes_and_links_among_results_are_not_opened(here):
    folder, _ = here
    before = results_hash(folder)
    os.mkfifo(folder / "pipe")
    assert results_hash(folder) == before
    (folder / "link").symlink_to("/dev/zero")
    with pytest.raises(UsageError, match="link: is a link"):
        results_hash(folder)


def test_a_state_that_cannot_be_written_is_reported_before_anything_is_started(here, monkeypatch, tmp_path, capsys):
    folder, outside = here
    (tmp_path / "a_file").touch()
    monkeypatch.setenv("GSLCOSIM_STATE", str(tmp_path / "a_file"))
    assert verify(folder) == 3
    assert "GSLCOSIM_STATE chooses another" in capsys.readouterr().err
    assert reached(outside) == set()
