"""What travels to a node: the files that a trial reads, and the trial with the places where they are there."""

import json
import shutil
from pathlib import Path

import pytest

from gslcosim.base.bundled import bundled_agents
from gslcosim.base.errors import EnvironmentDataError
from gslcosim_bench.cases import Trial, build_plan, load_suite
from gslcosim_bench.execution.ray_worker import BundleBuilder, FileBundle, path_below, relocate_trial, unpack_bundle

SUITE = """
schema: gslcosim/suite/1
name: mine
anchors: []
scenarios: [tiny_room]
entries:
  - {name: bundled, start: {python: dung_beetle}}
  - {name: mine, start: {python: mine/agent.py}}
  - {name: shell, start: {command: [/bin/sh, mine/run.sh], door: stdio}}
"""


@pytest.fixture
def trials(tmp_path: Path) -> dict[str, Trial]:
    """A trial by a bundled program, by one beside the suite, and by a command."""
    mine = tmp_path / "suite" / "mine"
    mine.mkdir(parents=True)
    shutil.copy(bundled_agents()["dung_beetle"], mine / "agent.py")
    (mine / "tables.py").write_text("N = 1\n")
    (mine / "notes.txt").write_text("not read\n")
    (mine / "run.sh").write_text("exit 3\n")
    (mine / "run.sh").chmod(0o755)
    (tmp_path / "suite" / "suite.yaml").write_text(SUITE)
    return {trial.entry: trial for trial in build_plan(load_suite(tmp_path / "suite" / "suite.yaml")).trials}


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))


def names_in(bundle: FileBundle) -> set[str]:
    return {Path(path).name for path, _ in bundle.files}


def test_what_is_installed_does_not_travel(trials: dict[str, Trial]) -> None:
    """Neither a bundled agent nor the system's shell."""
    assert names_in(BundleBuilder().build_bundle(trials["bundled"])) == set()
    assert "sh" not in names_in(BundleBuilder().build_bundle(trials["shell"]))


def test_a_program_travels_with_what_its_hash_counts(trials: dict[str, Trial]) -> None:
    assert names_in(BundleBuilder().build_bundle(trials["mine"])) == {"agent.py", "tables.py"}
    assert "run.sh" in names_in(BundleBuilder().build_bundle(trials["shell"]))


def test_files_in_the_same_place_with_the_same_content_are_used_where_they_are(trials: dict[str, Trial]) -> None:
    bundle = BundleBuilder().build_bundle(trials["mine"])
    assert bundle.is_here()
    path = trials["mine"].resolved.agents[0].start.python
    assert path is not None
    Path(path).write_text("# Another program.\n")
    assert not bundle.is_here()
    assert BundleBuilder().build_bundle(trials["mine"]).key != bundle.key


@pytest.mark.parametrize("entry", ["mine", "shell"])
def test_an_unpacked_trial_reads_its_files_below_the_folder(trials: dict[str, Trial], entry: str) -> None:
    """All else of it stays as it was, to the last digit; files keep their mode; a second time nothing is unpacked."""
    trial = trials[entry]
    bundle = BundleBuilder().build_bundle(trial)
    contents = bundle.contents()
    root = unpack_bundle(bundle, contents)
    assert unpack_bundle(bundle, None if contents is None else {}) == root
    there = relocate_trial(trial, bundle, root)
    start = there.resolved.agents[0].start
    program = Path(start.python or (start.command or ())[-1])
    assert program.is_relative_to(root)
    original = Path("/") / program.relative_to(root)
    assert program.read_bytes() == original.read_bytes()
    assert program.stat().st_mode == original.stat().st_mode
    assert there.directory == path_below(root, trial.directory)
    assert there.directory.is_dir()
    before, after = json.loads(trial.scenario_json), json.loads(there.scenario_json)
    for values in (before, after):
        values["agents"][0].pop("start")
    assert after == before
    assert (there.id, there.room, there.tape) == (trial.id, trial.room, trial.tape)


def test_files_that_are_too_much_to_carry_are_named(trials: dict[str, Trial], monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = BundleBuilder().build_bundle(trials["mine"])
    monkeypatch.setattr("gslcosim_bench.execution.ray_worker._MOST_BYTES", 10)
    assert bundle.contents() is None
    (path, _), *_ = bundle.files
    Path(path).unlink()
    with pytest.raises(EnvironmentDataError, match=r"agent\.py: expected on this node the same file"):
        unpack_bundle(bundle, None)
