"""`bench place`, as docs/benchmark/running.md shows it: its rows are rows of the suite, and a race goes on."""

import json
import re
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from page_commands import type_block

from gslcosim.base.checksums import write_checksums
from gslcosim.cli.main import main
from gslcosim_bench import Results, run

PAGE = Path(__file__).parents[4] / "docs" / "benchmark" / "running.md"
SECTION = PAGE.read_text().partition("## A place without the whole suite\n")[2].partition("\n## ")[0]
(SUITE,), (COMMANDS,) = (re.findall(rf"```{kind}\n(.*?)```", SECTION, re.DOTALL) for kind in ("yaml", "sh"))


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The page's commands, walked one by one; what each has printed."""
    folder = tmp_path_factory.mktemp("walked")
    (folder / "my_entry.yaml").write_text(SUITE)
    printed = []
    for command in COMMANDS.splitlines():
        ended = type_block(command, folder)
        assert ended.returncode == 0, f"{command}\n{ended.stdout}\n{ended.stderr}"
        printed.append(ended.stdout)
    return folder, printed


@pytest.mark.end_to_end
@pytest.mark.slow
def test_the_page_places_an_entry_and_flies_the_rest(walked: tuple[Path, list[str]]) -> None:
    folder, (_, text, told, rest) = walked
    assert "PLACE" in text
    found = json.loads(told)
    assert (found["flown_now"], found["entries"], found["flights_of_suite"]) == (0, 4, 2)
    assert found["first"] <= found["place"] <= found["last"]
    assert f"the place of mine is {found['place']}" in text
    assert len(found["estimates"]) == 1
    # What the race has flown is not flown again.
    assert f"{found['n_flown']} were there already" in rest
    results = Results.load(folder / "results" / "my_entry")
    assert len(results.select(entry="mine")) == 4


@pytest.mark.end_to_end
@pytest.mark.slow
def test_rows_of_a_race_are_those_of_the_suite(walked: tuple[Path, list[str]], tmp_path: Path, capsys) -> None:
    folder, _ = walked
    (tmp_path / "my_entry.yaml").write_text(SUITE)
    place = ["bench", "place", str(tmp_path / "my_entry.yaml"), "--entry", "mine", "--jobs", "1", "--json"]
    place += ["--against", str(folder / "results" / "smoke"), "--results", str(tmp_path / "race")]
    assert main([*place, "--places", "1", "--budget", "1", "--batch", "1"]) == 0
    first = json.loads(capsys.readouterr().out)
    assert (first["n_flown"], first["stopped_by"]) == (1, "budget")
    assert main([*place, "--places", "1", "--budget", "2", "--batch", "1"]) == 0
    second = json.loads(capsys.readouterr().out)
    # The budget changes bets, but no draw; two runs are the suite's two, so that nothing is open.
    assert (second["flown_now"], second["low"]) == (1, pytest.approx(second["high"]))
    assert second["first"] == second["last"]
    raced, flown = (Results.load(each) for each in (tmp_path / "race", folder / "results" / "my_entry"))
    digests = dict(zip(flown.trials["trial"].to_pylist(), flown.trials["digest"].to_pylist(), strict=True))
    rows = raced.trials.to_pylist()
    assert {row["entry"] for row in rows} == {"mine"}
    assert all(digests[row["trial"]] == row["digest"] for row in rows)
    assert second["score"] == pytest.approx(sum(row["score"] for row in rows) / 2)


@pytest.mark.end_to_end
@pytest.mark.slow
def test_what_cannot_be_raced_is_refused(walked: tuple[Path, list[str]], tmp_path: Path, capsys) -> None:
    folder, _ = walked
    mine, smoke = str(folder / "my_entry.yaml"), str(folder / "results" / "smoke")
    other = tmp_path / "other"
    run("smoke", other, jobs=1, only=["entry=oracle", "control=yes"])
    odd = shutil.copytree(smoke, tmp_path / "odd")
    table = pq.read_table(odd / "trials.parquet")
    i = table.schema.get_field_index("score")
    pq.write_table(table.set_column(i, table.schema.field(i), [[2.0] * len(table)]), odd / "trials.parquet")
    write_checksums(odd, "trials.parquet")
    for words, text in (
        (
            [mine, "--entry", "mina", "--against", smoke],
            "(mine, oracle, random_walker), was 'mina'. Did you mean mine?",
        ),
        (["open_2026_quick", "--entry", "sweep", "--against", smoke], "expected results of the cases of"),
        ([mine, "--entry", "mine", "--against", str(other)], "with rows of all 2 flights with gas"),
        ([mine, "--entry", "mine", "--against", str(tmp_path / "none")], "expected a folder of results"),
        ([mine, "--entry", "mine", "--against", str(odd)], "expected scores from 0 to 1, was 2.0"),
        ([mine, "--entry", "mine", "--against", smoke, "--minutes", "0"], "minutes above 0"),
    ):
        assert main(["bench", "place", *words]) == 2
        assert text in capsys.readouterr().err
