"""Sealed seeds: the commitment fixes them, nothing that is written shows them, and what was changed is found."""

import json
import stat
from pathlib import Path

import pytest

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.cli.main import main
from gslcosim_archive import sealing
from gslcosim_archive.sealing import Seal, load_sealed_suite, read_seal, reveal_suite, seal_suite, write_seal
from gslcosim_bench.cases import build_plan, load_suite
from gslcosim_bench.cases.suite_files import write_suite
from gslcosim_bench.execution.runner import build_manifest
from gslcosim_bench.studies.target import collect_bundled_seeds, collect_seeds

SUITE = """schema: gslcosim/suite/1
name: contest
scenarios: [{source: tiny_room, set: {'agents[0].vehicle.start_m': random, gas.seed: null}}]
vary: [{environment.layout.seed: {draw: 2}}]
entries: [{name: beetle, start: {python: dung_beetle}}]
anchors: []
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    (tmp_path / "contest.yaml").write_text(SUITE)
    return tmp_path / "contest.yaml"


@pytest.fixture
def sealed(suite: Path, tmp_path: Path) -> tuple[Seal, sealing.SealFiles]:
    seal = seal_suite(suite)
    return seal, write_seal(seal, tmp_path / "seal")


def test_only_the_owner_reads_the_secret_and_the_commitment_does_not_tell_it(sealed) -> None:
    seal, files = sealed
    assert stat.S_IMODE(files.secret.stat().st_mode) == 0o600
    assert read_seal(files.secret) == seal
    text = files.commitment.read_text()
    assert seal.commitment in text
    assert str(seal.seed) not in text
    assert seal.nonce not in text


def test_a_suite_is_sealed_once_in_a_folder(sealed) -> None:
    seal, files = sealed
    with pytest.raises(UsageError, match="A second seal would let you choose"):
        write_seal(seal, files.secret.parent)


def test_nothing_that_is_written_of_a_sealed_run_shows_the_seed(suite: Path, sealed, tmp_path: Path) -> None:
    seal, files = sealed
    plan = build_plan(load_sealed_suite(suite, files.secret))
    assert plan.loaded.suite.seed == seal.seed
    write_suite(plan.loaded, tmp_path / "results")
    written = "".join(path.read_text() for path in (tmp_path / "results").rglob("*") if path.is_file())
    written += json.dumps(build_manifest(plan, [], recorded=()))
    written += "".join(trial.scenario_json + trial.case + trial.varied for trial in plan.trials)
    assert str(seal.seed) not in written
    assert seal.commitment in written
    assert load_suite(tmp_path / "results", needs_seed=False).suite.sealed == seal.commitment


def test_sealed_results_are_planned_again_with_the_secret_alone(suite: Path, sealed, tmp_path: Path) -> None:
    _, files = sealed
    plan = build_plan(load_sealed_suite(suite, files.secret))
    write_suite(plan.loaded, tmp_path / "results")
    with pytest.raises(ScenarioError, match="sealed: expected the secret of commitment"):
        load_suite(tmp_path / "results" / "suite.yaml")
    with pytest.raises(ScenarioError, match="sealed: expected the secret of commitment"):
        load_suite(tmp_path / "results" / "suite.yaml", seed=1)
    again = build_plan(load_sealed_suite(tmp_path / "results" / "suite.yaml", files.secret))
    assert [trial.id for trial in again.trials] == [trial.id for trial in plan.trials]


def test_a_suite_that_includes_the_sealed_one_flies_its_cases(suite: Path, sealed, tmp_path: Path) -> None:
    _, files = sealed
    mine = tmp_path / "mine.yaml"
    mine.write_text(
        "schema: gslcosim/suite/1\nname: mine\ninclude: [contest.yaml]\nanchors: []\n"
        "entries: [{name: cast, start: {python: surge_cast}}]\n"
    )
    theirs, own = (build_plan(load_sealed_suite(each, files.secret)) for each in (suite, mine))
    assert [trial.case_hash for trial in own.trials] == [trial.case_hash for trial in theirs.trials]


def test_revealing_writes_the_suite_with_its_seed(suite: Path, sealed, tmp_path: Path) -> None:
    seal, files = sealed
    reveal_suite(suite, files.secret, files.commitment, tmp_path / "revealed")
    plan = build_plan(load_suite(tmp_path / "revealed"))
    flown = build_plan(load_sealed_suite(suite, files.secret))
    assert plan.loaded.suite.seed == seal.seed
    assert [trial.id for trial in plan.trials] == [trial.id for trial in flown.trials]
    with pytest.raises(UsageError, match="expected a new folder"):
        reveal_suite(suite, files.secret, files.commitment, tmp_path / "revealed")


def test_another_seed_and_changed_cases_are_refused(suite: Path, sealed, tmp_path: Path) -> None:
    seal, files = sealed
    values = json.loads(files.secret.read_text())
    files.secret.write_text(json.dumps({**values, "seed": seal.seed + 1}))
    with pytest.raises(UsageError, match="The file was changed"):
        read_seal(files.secret)
    other = Seal(suite=seal.suite, recipe=seal.recipe, seed=seal.seed + 1, nonce=seal.nonce)
    swapped = write_seal(other, tmp_path / "other")
    with pytest.raises(UsageError, match="not the one that was committed to"):
        reveal_suite(suite, swapped.secret, files.commitment, tmp_path / "revealed")
    suite.write_text(SUITE.replace("draw: 2", "draw: 3"))
    with pytest.raises(UsageError, match="expected the cases of contest as they were sealed"):
        load_sealed_suite(suite, swapped.secret)


def test_no_room_plume_or_noise_of_a_sealed_suite_is_one_that_is_public(suite: Path, monkeypatch) -> None:
    public = load_suite(suite)
    drawn = iter([public.suite.seed, 123456789])
    monkeypatch.setattr(sealing.secrets, "randbits", lambda _: next(drawn))
    assert seal_suite(suite).seed == 123456789
    assert not collect_seeds(load_suite(suite, seed=123456789)) & (collect_seeds(public) | collect_bundled_seeds())


def test_cases_with_seeds_of_their_own_cannot_be_sealed(suite: Path) -> None:
    suite.write_text(SUITE.replace(", gas.seed: null}", "}, seeds: [11, 12]"))
    with pytest.raises(UsageError, match="some have seeds of their own"):
        seal_suite(suite)


OTHER_SCHEMA = '{"schema": "gslcosim/seal/9", "suite": "a", "recipe": "b", "commitment": "c", "seed": 1, "nonce": "d"}'


@pytest.mark.parametrize("odd", ["", "[]", '{"schema": 1}', OTHER_SCHEMA])
def test_files_that_are_no_seal_are_refused(suite: Path, sealed, tmp_path: Path, odd: str) -> None:
    _, files = sealed
    files.commitment.write_text(odd)
    with pytest.raises(UsageError):
        reveal_suite(suite, files.secret, files.commitment, tmp_path / "revealed")
    files.secret.write_text(odd)
    with pytest.raises(UsageError):
        read_seal(files.secret)


def test_the_commands_seal_plan_and_reveal(suite: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "seal", str(suite)]) == 0
    assert "Commitment: " in capsys.readouterr().out
    assert main(["bench", "plan", str(suite), "--sealed", "contest.secret.json", "--json"]) == 0
    seed = read_seal(Path("contest.secret.json")).seed
    assert str(seed) not in capsys.readouterr().out
    assert main(["bench", "plan", str(suite), "--sealed", "contest.secret.json", "--seed", "1"]) == 2
    capsys.readouterr()
    assert main(["bench", "reveal", str(suite), "contest.secret.json", "contest.commitment.json"]) == 0
    assert str(seed) in capsys.readouterr().out
    assert load_suite("contest_revealed").suite.seed == seed


def test_the_seed_of_a_seal_that_counted_lines_for_editors_is_revealed(tmp_path: Path) -> None:
    study = Path(__file__).parents[4] / "docs" / "studies" / "open_2026"
    suite, files = study / "suite_d.yaml", [study / f"seed_d.{kind}.json" for kind in ("secret", "commitment")]
    revealed = reveal_suite(suite, *files, tmp_path / "revealed")
    assert revealed.suite.seed == read_seal(files[0]).seed
    assert sealing.hash_recipe(revealed) == sealing.hash_recipe(load_suite(suite))
