"""Results of several authors in one table."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from gslcosim.base.checksums import CHECKSUMS_FILE, write_checksums
from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_archive.signing.keys import write_key
from gslcosim_archive.signing.signed_results import check_signature, sign_results
from gslcosim_archive.submissions import rank
from gslcosim_bench import Results, compare, run

MINE = """
schema: gslcosim/suite/1
name: mine
include: [smoke]
entries:
  - {name: mine, start: {python: surge_cast}}
  - {name: dung_beetle, start: {python: dung_beetle}, parameters: {leg_m: 0.5}}
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The bundled suite `smoke`, and a submission of someone else to it."""
    root = tmp_path_factory.mktemp("submissions")
    run("smoke", root / "base", jobs=1, only=["repetition=0"])
    (root / "mine.yaml").write_text(MINE)
    run(root / "mine.yaml", root / "mine", jobs=1)
    return root / "base", root / "mine"


@pytest.mark.end_to_end
def test_results_from_python(folders: tuple[Path, Path]) -> None:
    results = Results.load(folders[0])
    assert results.entries == ("dung_beetle", "oracle", "random_walker")
    assert results.success("oracle").value == 1.0
    assert len(results.select(is_control=True, entry="oracle")) == 2
    oracle_s, walker_s = results.paired("time_s", "oracle", "random_walker")
    comparison = compare(results, "oracle", "random_walker")
    assert comparison.time_s.value == pytest.approx(
        (oracle_s - walker_s)[[not c for c in results.select(entry="oracle").array("is_control")]].mean()
    )
    assert comparison.n == 2
    assert results.tracks().num_rows == 12
    with pytest.raises(UsageError, match="expected one of the entries"):
        results.success("nobody")
    with pytest.raises(UsageError, match="expected a column"):
        results.array("nothing")


@pytest.mark.end_to_end
def test_anchors_are_shared_and_equal_names_of_other_programs_are_distinguished(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    ranking = rank(folders, tmp_path / "merged")
    names = [row["entry"] for row in ranking.leaderboard["views"][0]["rows"]]
    assert sorted(names) == ["dung_beetle (base)", "dung_beetle (mine)", "mine", "oracle", "random_walker"]
    assert names[0] == "oracle"
    assert set(ranking.verified.values()) == {None}
    assert len(Results.load(tmp_path / "merged")) == 5 * 4
    assert (tmp_path / "merged" / "report.html").is_file()


@pytest.mark.end_to_end
def test_other_cases_and_other_runs_are_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "other"
    run("smoke", other, jobs=1, only=["entry=oracle"])
    manifest = json.loads((other / "manifest.json").read_text())
    (other / "manifest.json").write_text(json.dumps({**manifest, "suite_hash": "another"}))
    (other / CHECKSUMS_FILE).unlink()
    with pytest.raises(UsageError, match="with the hash another"):
        rank([folders[0], other])
    changed = tmp_path / "changed"
    shutil.copytree(folders[0], changed)
    table = pq.read_table(changed / "trials.parquet")
    i = table.schema.get_field_index("digest")
    pq.write_table(
        table.set_column(i, table.schema.field(i), [["0" * 32] * table.num_rows]), changed / "trials.parquet"
    )
    (changed / CHECKSUMS_FILE).unlink()
    with pytest.raises(UsageError, match="flown by different software"):
        rank([folders[0], changed])
    with pytest.raises(UsageError, match="Choose a new folder"):
        rank(folders, folders[0])


@pytest.mark.end_to_end
def test_a_stranger_ranks_and_audits_what_two_authors_have_signed(
    folders: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two authors sign, an organiser logs and ranks; an audit repeats a public draw, and finds rows that are false."""
    monkeypatch.setenv("GSLCOSIM_STATE", str(tmp_path / "state"))
    log, signed = str(tmp_path / "log.jsonl"), []
    for author, folder in zip(("ada", "bob"), folders, strict=True):
        write_key(tmp_path / author, author)
        signed.append(shutil.copytree(folder, tmp_path / f"machine of {author}" / "results"))
        sign_results(signed[-1], tmp_path / author, author=author, signed_at="2026-11-27T12:00:00+00:00")
        assert main(["bench", "log", log, "--add", str(signed[-1])]) == 0
    rank_them = ["bench", "rank", *map(str, signed), "--log", log, "--json"]
    capsys.readouterr()
    assert main(rank_them) == 0
    ranking = json.loads(capsys.readouterr().out)
    keys = {name: check_signature(folder).key.fingerprint for name, folder in zip("ab", signed, strict=True)}
    assert (ranking["keys"]["mine"], ranking["keys"]["oracle"]) == (keys["b"], keys["a"])
    audit = ["bench", "audit", str(signed[1]), "--log", log, "--beacon", "6 49 3", "--jobs", "1", "--trusted", "--json"]
    assert main([*audit, "--sample", "2", "--draw-only"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["drawn_places"], told["places"], len(told["drawn"])) == (2, 4, 8)
    assert (told["line"], told["signature"]["author"]) == (2, "bob")
    assert (told["draw_line"], told["lines_of_key"], told["keys_of_suite"], told["beacon_line"]) == (1, [2], 2, None)
    first = told["drawn"]
    assert main([*audit, "--sample", "2", "--draw-only", "--entry", "mine", "--suite", "smoke"]) == 0
    assert set(json.loads(capsys.readouterr().out)["drawn"]) < set(first)
    assert main([*audit, "--sample", "2", "--draw-only", "--suite", "open_2026_quick"]) == 2
    assert "Its author has flown other cases" in capsys.readouterr().err
    # Bob makes his method better than it is, and signs that; an audit of all rows finds each of them.
    table = pq.read_table(signed[1] / "trials.parquet")
    scores = [1.0 if row["entry"] == "mine" else row["score"] for row in table.to_pylist()]
    i = table.schema.get_field_index("score")
    pq.write_table(table.set_column(i, table.schema.field(i), [scores]), signed[1] / "trials.parquet")
    write_checksums(signed[1], "trials.parquet")
    assert main(rank_them) == 2
    assert "row of trial" in capsys.readouterr().err
    sign_results(signed[1], tmp_path / "bob", author="bob", signed_at="2026-11-27T13:00:00+00:00")
    assert main(rank_them) == 2
    assert "expected a line with the statement" in capsys.readouterr().err
    assert main(["bench", "log", log, "--add", str(signed[1])]) == 0
    capsys.readouterr()
    assert main([*audit, "--sample", "1000"]) == 5
    told = json.loads(capsys.readouterr().out)
    assert (told["line"], told["draw_line"], told["lines_of_key"]) == (3, 1, [2, 3])
    assert (told["lines_counted"], told["level"]) == (2, pytest.approx(0.975))
    assert set(first) <= set(told["drawn"])
    assert told["sample"] == told["rows"]
    assert told["max_false"] == told["entries"]["mine"]["different"] > 0
    assert told["entries"]["oracle"]["different"] == 0
    assert {each["entry"] for each in told["differences"]} == {"mine"}
    assert all(list(each["columns"]) == ["score"] for each in told["differences"])
    # Bob signs again until a draw misses what is false: every copy has the draw of the suite's first line.
    for hour in (14, 15):
        sign_results(signed[1], tmp_path / "bob", author="bob", signed_at=f"2026-11-27T{hour}:00:00+00:00")
        assert main(["bench", "log", log, "--add", str(signed[1])]) == 0
        capsys.readouterr()
        assert main([*audit, "--sample", "2", "--draw-only"]) == 0
        assert json.loads(capsys.readouterr().out)["drawn"] == first
    # Another key has the same draw, and the audit says that there are two.
    write_key(tmp_path / "second", "")
    sign_results(signed[1], tmp_path / "second", author="bob", signed_at="2026-11-27T16:00:00+00:00")
    assert main(["bench", "log", log, "--add", str(signed[1])]) == 0
    assert main(["bench", "log", log, "--note", "beacon: 6 49 3", "--key", str(tmp_path / "ada")]) == 0
    capsys.readouterr()
    assert main([*audit[:-1], "--sample", "2", "--draw-only"]) == 0
    out = capsys.readouterr().out
    assert "'bob' is the name beside 2 keys for this suite" in out
    assert all(trial in out for trial in first)
    assert "Beacon: line 7 of the log has it, after the results." in out
    sign_results(signed[1], tmp_path / "bob", author="bob", signed_at="2026-11-27T17:00:00+00:00")
    assert main(["bench", "log", log, "--add", str(signed[1])]) == 0
    assert main([*audit, "--sample", "2", "--draw-only"]) == 2
    assert "expected a beacon from after line 8" in capsys.readouterr().err


@pytest.mark.end_to_end
def test_entries_in_another_order_and_more_of_them_are_drawn_in_the_same_cases(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Positions of entries and their number are an author's to choose, so they decide nothing."""
    method, *_ = MINE.strip().splitlines()[4:5]
    (tmp_path / "more.yaml").write_text(
        MINE.replace(f"{method}\n", "").replace("name: mine\n", "name: more\n")
        + f"  - {{name: filler, start: {{python: dung_beetle}}}}\n{method}\n"
    )
    run(tmp_path / "more.yaml", tmp_path / "more", jobs=1, only=["entry=mine"])
    write_key(tmp_path / "ada", "")
    drawn = []
    for folder in (folders[1], tmp_path / "more"):
        signed = shutil.copytree(folder, tmp_path / f"signed {folder.name}")
        sign_results(signed, tmp_path / "ada", author="ada", signed_at="")
        assert main(["bench", "log", str(tmp_path / "log.jsonl"), "--add", str(signed)]) == 0
        capsys.readouterr()
        words = ["audit", str(signed), "--log", str(tmp_path / "log.jsonl"), "--beacon", "x", "--sample", "2"]
        assert main(["bench", *words, "--entry", "mine", "--draw-only", "--json"]) == 0
        rows = {row["trial"]: row for row in Results.load(signed).trials.to_pylist()}
        told = json.loads(capsys.readouterr().out)
        drawn.append({(rows[key]["case"], rows[key]["repetition"], rows[key]["is_control"]) for key in told["drawn"]})
    assert drawn[0] == drawn[1]
    assert len(drawn[0]) == 2
