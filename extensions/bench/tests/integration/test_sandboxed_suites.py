"""Suites that demand a sandbox: the same rows as without, no way to the truth, and nobody ranked beside them unseen."""

import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gslcosim.base.checksums import CHECKSUMS_FILE
from gslcosim.base.errors import UsageError
from gslcosim.base.rng import stream
from gslcosim.cli.main import main
from gslcosim.runtime.processes.sandbox.selection import find_strongest_sandbox
from gslcosim_archive.submissions import rank
from gslcosim_bench import run
from gslcosim_bench.cases import build_plan, load_suite
from gslcosim_bench.execution import verification
from gslcosim_bench.store import is_machine_dependent

HOSTILE = Path(__file__).parent / "hostile"
# Three entries of which one is honest, one a team in one process, and one a thief.
CASES = """
schema: gslcosim/suite/1
name: cases
scenarios: [{source: tiny_room, set: {referee.stop.time_limit_s: 30}}]
set: {gas.tape: true, 'agents[0].seed': 7}
anchors: []
entries:
  - {name: dung_beetle, start: {python: dung_beetle}}
  - {name: calling_beetle, start: {python: calling_beetle}, sensors: by_method, robots: 2}
  - {name: thief, start: {python: thief.py}}
"""
REQUIRED = "schema: gslcosim/suite/1\nname: required\ninclude: [cases]\nsandbox: required\n"

pytestmark = pytest.mark.skipif(find_strongest_sandbox() == "none", reason="this machine has no sandbox")


def suites(folder: Path) -> tuple[Path, Path]:
    """Write a suite, and one that includes it and demands a sandbox."""
    for name, text in (("cases", CASES), ("required", REQUIRED)):
        (folder / name).mkdir(parents=True)
        (folder / name / "suite.yaml").write_text(text.replace("[cases]", "[../cases]"))
    shutil.copy(HOSTILE / "thief.py", folder / "cases")
    return folder / "cases" / "suite.yaml", folder / "required" / "suite.yaml"


def rows_of(folder: Path) -> dict[str, dict[str, Any]]:
    return {row["entry"]: row for row in pq.read_table(folder / "trials.parquet").to_pylist()}


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same cases, flown with Python agents in the worker and with all agents in sandboxes."""
    root = tmp_path_factory.mktemp("s")
    for path, name in zip(suites(root / "suites"), ("trusting", "sealed"), strict=True):
        run(path, root / name, jobs=1)
    return root / "trusting", root / "sealed"


@pytest.mark.end_to_end
@pytest.mark.slow
def test_honest_agents_run_the_same_and_a_thief_finds_nothing(flown: tuple[Path, Path]) -> None:
    """The columns that say who and where differ; the thief reads the source from its process's memory."""
    trusting, sealed = (rows_of(folder) for folder in flown)
    assert {row["status"] for row in (*trusting.values(), *sealed.values())} == {"flown"}
    for entry in ("dung_beetle", "calling_beetle"):
        differing = {name for name in trusting[entry] if trusting[entry][name] != sealed[entry][name]}
        assert {name for name in differing if not is_machine_dependent(name)} == {"trial"}
    assert {row["sandbox"] for row in trusting.values()} == {"none: in this process"}
    assert all(row["sandbox"].startswith(find_strongest_sandbox()) for row in sealed.values())
    assert trusting["thief"]["success"]
    assert not sealed["thief"]["success"]
    assert sealed["thief"]["path_length_m"] < 2.5
    hashes = [json.loads((folder / "manifest.json").read_text())["suite_hash"] for folder in flown]
    assert hashes[0] == hashes[1]


@pytest.mark.end_to_end
@pytest.mark.slow
def test_verify_says_what_agents_were_in_and_refuses_rows_without_the_sandbox_that_is_demanded(
    flown: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trusting, sealed = flown
    assert main(["bench", "verify", str(sealed), "--sample", "3", "--jobs", "1"]) == 0
    assert f"Sandbox of agents: 3 {find_strongest_sandbox()}" in capsys.readouterr().out
    assert main(["bench", "verify", str(trusting), "--sample", "3", "--jobs", "1", "--trusted"]) == 0
    assert "3 none: in this process. Agents without one could read the truth" in capsys.readouterr().out
    changed = tmp_path / "changed"
    shutil.copytree(trusting, changed)
    text = (changed / "suite.yaml").read_text()
    (changed / "suite.yaml").write_text(text.replace("sandbox: optional", "sandbox: required"))
    assert main(["bench", "verify", str(changed), "--sample", "1", "--jobs", "1"]) == 2
    output = capsys.readouterr().err
    assert "expected agents in a sandbox, as the suite demands (sandbox: required), was none: in this process" in output


@pytest.mark.end_to_end
@pytest.mark.slow
def test_a_ranking_refuses_runs_outside_a_sandbox_where_one_folder_demands_it_or_who_ranks(
    flown: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the thief digests are equal, so that only the rows tell."""
    trusting, sealed = (honest(folder, tmp_path / folder.name) for folder in flown)
    with pytest.raises(UsageError, match=r"as the suite of .*sealed demands, was none: in this process in 2 of 2"):
        rank([trusting, sealed])
    rank([trusting])
    assert main(["bench", "rank", str(trusting), "--sandboxed"]) == 2
    assert "as --sandboxed asks, was none: in this process" in capsys.readouterr().err
    assert main(["bench", "rank", str(sealed), "--sandboxed"]) == 0


BEETLE = """
schema: gslcosim/suite/1
name: beetle
sandbox: required
scenarios: [{source: tiny_room, set: {referee.stop.time_limit_s: 6}}]
repetitions: 2
anchors: []
entries: [{name: dung_beetle, start: {python: dung_beetle}}]
"""


@pytest.mark.end_to_end
@pytest.mark.slow
def test_seeds_of_agents_follow_from_a_secret_of_the_results_that_verify_and_merge_know(tmp_path: Path) -> None:
    """Other results have others; a run that goes on and its shards keep theirs."""
    suite = tmp_path / "suite.yaml"
    suite.write_text(BEETLE)
    folders = [tmp_path / name for name in ("whole", "1", "2", "merged")]
    for folder, words in zip(folders, ([], ["--shard", "1/2"], ["--shard", "2/2"]), strict=False):
        assert main(["bench", "run", str(suite), "--results", str(folder), "--jobs", "1", *words]) == 0
    assert main(["bench", "merge", str(folders[1]), str(folders[2]), "--out", str(folders[3])]) == 0
    secrets = [json.loads((folder / "agent_secrets.json").read_text())["secrets"] for folder in folders]
    assert secrets[3] == secrets[1] | secrets[2]
    assert [len(each) for each in secrets] == [2, 1, 1, 2]
    digests = [{row["repetition"]: row["digest"] for row in all_rows(folder)} for folder in (folders[0], folders[3])]
    assert not set(digests[0].values()) & set(digests[1].values())
    assert main(["bench", "verify", str(folders[3]), "--jobs", "1"]) == 0
    trial = all_rows(folders[0])[0]["trial"]
    assert main(["bench", "show", str(folders[0]), "--trial", trial, "--no-view"]) == 0
    # Their runs of a case are not those of one program with one seed.
    rank([folders[0], folders[3]])
    table = pq.read_table(folders[0] / "trials.parquet")
    pq.write_table(table.slice(0, 1), folders[0] / "trials.parquet")
    (folders[0] / "checksums.json").unlink()
    assert main(["bench", "run", str(suite), "--results", str(folders[0]), "--jobs", "1"]) == 0
    assert json.loads((folders[0] / "agent_secrets.json").read_text())["secrets"].keys() == secrets[0].keys()
    assert main(["bench", "verify", str(folders[0]), "--jobs", "1"]) == 0


def all_rows(folder: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.read_table(folder / "trials.parquet").to_pylist()
    return rows


def test_no_seed_of_a_run_is_found_by_trying(tmp_path: Path) -> None:
    """A briefing gave away each run's seed below twenty thousand within seconds."""
    suite = tmp_path / "suite.yaml"
    suite.write_text(BEETLE)
    trial = next(iter(build_plan(load_suite(suite)).trials))
    assert trial.demands_sandbox
    secret, other = trial.with_agent_secret("a" * 32), trial.with_agent_secret("b" * 32)
    (seed,) = (agent.seed for agent in secret.resolved.agents)
    assert seed not in {int(stream(i, f"agent.{secret.resolved.agents[0].name}").integers(2**31)) for i in range(2000)}
    assert (secret.id, secret.resolved.seed) == (trial.id, trial.resolved.seed)
    assert seed != other.resolved.agents[0].seed
    assert trial.with_agent_secret(None) is trial
    # What a scenario sets stays.
    suite.write_text(BEETLE.replace("set: {", "set: {'agents[0].seed': 7, "))
    chosen = next(iter(build_plan(load_suite(suite)).trials)).with_agent_secret("a" * 32)
    assert chosen.resolved.agents[0].seed == 7


def honest(folder: Path, to: Path) -> Path:
    """Copy results without the thief's."""
    shutil.copytree(folder, to)
    rows = [row for row in pq.read_table(to / "trials.parquet").to_pylist() if row["entry"] != "thief"]
    schema = pq.read_schema(to / "trials.parquet")
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), to / "trials.parquet")
    (to / CHECKSUMS_FILE).unlink()
    return to


def test_a_suite_passes_its_demand_on_to_what_it_includes(tmp_path: Path) -> None:
    """Also through a suite between, and whatever the scenario says; programs of other languages stay as they are."""
    cases, required = suites(tmp_path)
    other = "{name: x, start: {command: [sh], door: tcp}}"
    text = cases.read_text().replace("{name: thief, start: {python: thief.py}}", other)
    cases.write_text(text.replace("gas.tape: true", "gas.tape: true, 'agents[0].sandbox': none"))
    (tmp_path / "outer").mkdir()
    outer = tmp_path / "outer" / "suite.yaml"
    outer.write_text(REQUIRED.replace("[cases]", "[../required]").replace("sandbox: required\n", ""))
    for path in (required, outer):
        plan = build_plan(load_suite(path))
        agents = [agent for trial in plan.trials for agent in trial.resolved.agents]
        assert [agent.sandbox for agent in agents] == ["required"] * 4
        assert [agent.start.door for agent in agents if not agent.start.process_of] == ["stdio", "stdio", "tcp"]
        assert plan.loaded.demands_sandbox
    assert {agent.sandbox for trial in build_plan(load_suite(cases)).trials for agent in trial.resolved.agents} == {
        "none"
    }


def test_a_machine_without_a_sandbox_is_reported_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, required = suites(tmp_path)
    monkeypatch.setattr(verification, "find_strongest_sandbox", lambda: "none")
    with pytest.raises(UsageError, match="sandbox: expected a machine that has a sandbox for agents"):
        run(required, tmp_path / "results", jobs=1)
    assert not (tmp_path / "results").exists()


PROGRAM = """
import json
from pathlib import Path

from gslcosim.agent_kit import run
from gslcosim_agents.dung_beetle.agent import DungBeetle

json.loads((Path(__file__).parent / "parts" / "data.json").read_text())

if __name__ == "__main__":
    run(DungBeetle)
"""


@pytest.mark.end_to_end
def test_a_bundle_is_flown_sealed_and_its_results_are_verified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that needs a file in a folder of its own finds it where it is flown, and where it is verified."""
    monkeypatch.setenv("GSLCOSIM_STATE", str(tmp_path / "state"))
    author, results = tmp_path / "author", tmp_path / "results" / "sealed"
    (author / "parts").mkdir(parents=True)
    (author / "parts" / "data.json").write_text("{}")
    (author / "agent.py").write_text(PROGRAM)
    (author / "method.yaml").write_text(
        "schema: gslcosim/method/1\ntitle: Mine\nfamily: reactive\nsummary: Flies.\npaper: none yet\n"
        "needs: {sensors: [gas, wind]}\n"
    )
    (author / "submission.yaml").write_text(
        "schema: gslcosim/submission/1\nentry: {name: mine, start: {python: agent.py}}\nbuild: []\nlock: []\n"
    )
    bundle = str(tmp_path / "mine.tar")
    assert main(["bench", "pack", str(author), "--out", bundle]) == 0
    shutil.rmtree(author)
    only = ["--only", "entry=mine", "--only", "repetition=0", "--only", "control=no"]
    fly = ["bench", "run", "smoke", "--bundle", bundle, "--results", str(results), "--jobs", "1", "--no-report"]
    assert main([*fly, *only]) == 0
    shutil.rmtree(tmp_path / "results" / "bundles")
    assert main(["bench", "verify", str(results), "--sample", "1", "--jobs", "1"]) == 0
