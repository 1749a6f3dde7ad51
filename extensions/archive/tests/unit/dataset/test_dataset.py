"""Datasets of results: every row once, no name of a machine, the same bytes again, and a description that is valid."""

import hashlib
import json
import math
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic

from gslcosim.base.errors import GslCosimError, UsageError
from gslcosim.cli.main import main
from gslcosim_archive.dataset.datasheet import EXAMPLE
from gslcosim_archive.dataset.tables import ORIGIN_COLUMNS, remove_folders
from gslcosim_archive.dataset.writer import write_dataset
from gslcosim_bench.store import SERIES, TRACK_COLUMNS, TRACKS, TRIAL_COLUMNS, TRIALS

PAGE = Path(__file__).parents[5] / "docs" / "benchmark" / "dataset.md"
COMMITMENT = "5e" * 32
SUITE = (
    "schema: gslcosim/suite/1\nname: synthetic\nquestion: Who finds it?\nanchors: []\nscenarios: [tiny_room]\n"
    "entries: [{name: infotaxis, start: {python: dung_beetle}}]\n"
)
METHODS = (synthetic.USUAL[2], synthetic.Method(name="a|b", faults=0.5))
PLAN = synthetic.Plan(methods=METHODS, starts_m=synthetic.STARTS_M[:2], repetitions=2, n_points=5)


def make_results(folder, *, seed=None, prefix="", **plan):
    """Write results of a suite with an open seed, or with a sealed one."""
    synthetic.make_results(folder, synthetic.Plan(**{**vars(PLAN), "seed": seed or 1, **plan}))
    change(folder / "manifest.json", '"suite": "synthetic"', f'"seed": {json.dumps(seed)}, "suite": "synthetic"')
    (folder / "suite.yaml").write_text(SUITE + (f"seed: {seed}\n" if seed is not None else f"sealed: {COMMITMENT}\n"))
    for name in ("trials", "tracks"):
        rewrite(folder, name, "trial", lambda trial: prefix + trial)
    return folder


def change(path, before, after):
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def rewrite(folder, name, column, edit):
    table = pq.read_table(folder / f"{name}.parquet")
    values = pa.array([edit(value) for value in table[column].to_pylist()])
    pq.write_table(table.set_column(table.schema.names.index(column), column, values), folder / f"{name}.parquet")


def plain(value):
    """Return a value that equals itself, NaN too, as Croissant and as pandas give it."""
    if isinstance(value, bytes):
        return value.decode()
    return None if isinstance(value, float) and math.isnan(value) else value


def fail_somewhere(text):
    return 'File "/home/ada/gsl co/agent.py", line 3, in decide at 2 m/s near /var/tmp/x' if text else text


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    root = tmp_path_factory.mktemp("results")
    folders = [make_results(root / "open", seed=7, prefix="a"), make_results(root / "sealed", prefix="b")]
    rewrite(folders[0], "trials", "agent_faults", fail_somewhere)
    return folders


@pytest.fixture(scope="module")
def dataset(results, tmp_path_factory):
    return write_dataset(results, tmp_path_factory.mktemp("dataset") / "d", authors=["Ada", "Bo"]).folder


def test_every_flight_and_sample_is_there_once_with_where_it_is_from(results, dataset):
    trials, tracks = (pq.read_table(dataset / f"{name}.parquet") for name in ("trials", "tracks"))
    given = [pq.read_table(folder / "trials.parquet") for folder in results]
    for column in TRIAL_COLUMNS:
        values = [value for table in given for value in table[column.name].to_pylist()]
        if column.name == "wall_worker":
            assert column.name not in trials.schema.names
        elif column.name == "agent_faults":
            shortened = 'File "gsl co/agent.py", line 3, in decide at 2 m/s near x'
            assert set(trials[column.name].to_pylist()) == {"", shortened, *(v for v in values if "decide()" in v)}
        else:
            assert trials[column.name].to_pylist() == values
    n = given[0].num_rows
    assert trials["results"].to_pylist() == ["open"] * n + ["sealed"] * n
    assert trials["suite_seed"].to_pylist() == [7] * n + [None] * n
    assert trials["commitment"].to_pylist() == [None] * n + [COMMITMENT] * n
    series = [row for folder in results for row in pq.read_table(folder / "tracks.parquet").to_pylist()]
    for name in SERIES:
        assert list(map(plain, tracks[name].to_pylist())) == [plain(value) for row in series for value in row[name]]
    assert tracks["trial"].to_pylist() == [row["trial"] for row in series for _ in row["t_s"]]
    assert trials.schema.field("time_to_source_s").metadata[b"unit"] == b"s"


def test_no_file_names_a_machine_and_the_same_results_give_the_same_bytes(results, dataset, tmp_path):
    write_dataset(results, tmp_path / "again", authors=["Ada", "Bo"])
    names = sorted(path.relative_to(dataset).as_posix() for path in dataset.rglob("*") if path.is_file())
    assert names == [
        "README.md", "croissant.json", "suite/open/suite.yaml", "suite/sealed/suite.yaml", "tracks.parquet",
        "trials.parquet",
    ]  # fmt: skip
    for name in names:
        content = (dataset / name).read_bytes()
        assert content == (tmp_path / "again" / name).read_bytes()
        for private in (b"/home", str(results[0].parent).encode(), b"local-0"):
            assert private not in content


def test_croissant_names_each_file_by_its_hash_and_each_column(dataset):
    described = json.loads((dataset / "croissant.json").read_text())
    hashes = {each["contentUrl"]: each["sha256"] for each in described["distribution"]}
    files = {path.relative_to(dataset).as_posix(): path for path in dataset.rglob("*") if path.is_file()}
    del files["croissant.json"]
    assert hashes == {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    meanings = {column.name: column.meaning for column in (*ORIGIN_COLUMNS, *TRIAL_COLUMNS)}
    samples = {column.name: column.meaning for column in TRACK_COLUMNS}
    for table, expected in zip(described["recordSet"], (meanings, samples), strict=True):
        columns = [each["name"] for each in table["field"]]
        assert columns == pq.read_schema(dataset / f"{table['name']}.parquet").names
        assert all(each["description"] == expected[each["name"]] for each in table["field"])
    assert described["license"] == "https://spdx.org/licenses/CC-BY-4.0.html"
    assert described["datePublished"] == "2026-01-01"
    assert [each["name"] for each in described["creator"]] == ["Ada", "Bo"]


def test_the_datasheet_counts_and_says_how_the_data_came_to_be(results, dataset):
    sheet = (dataset / "README.md").read_text()
    n = sum(pq.read_metadata(folder / "trials.parquet").num_rows for folder in results)
    sections = ("Motivation", "Composition", "Collection process", "Uses", "Distribution", "Maintenance")
    assert [name for name in sections if f"\n## {name}\n" not in sheet] == []
    for line in (
        f"| flights | {n} |", "| entries | 2 |", "| cases | 8 |", "| rooms with their wind | 2 |", "| plumes | 4 |",
        "| open | 7 |  | not signed |", f"| sealed | sealed | {COMMITMENT} | not signed |", "Who finds it?",
        "the start is in a rack", "gslcosim 0.1.0, python 3.11.2, numpy 2.1.0", r"| `a\|b` | bundled |",
    ):  # fmt: skip
        assert line in sheet
    for column in (*TRIALS.names, *TRACKS.names):
        assert (f"| `{column}` |" in sheet) == (column != "wall_worker")
    assert EXAMPLE in sheet
    assert EXAMPLE in PAGE.read_text()


def unfinished(folder):
    make_results(folder / "a", seed=1, missing=3)


def of_other_cases(folder):
    make_results(folder / "a", seed=1)
    change(make_results(folder / "b", seed=2, prefix="b") / "suite.yaml", "[tiny_room]", "[gsl_bench_1]")


def of_other_programs(folder):
    make_results(folder / "a", seed=1)
    change(make_results(folder / "b", seed=2, prefix="b") / "manifest.json", "ef" * 32, "fe" * 32)


def flown_twice(folder):
    make_results(folder / "a", seed=1)
    make_results(folder / "b", seed=1)


def called_alike(folder):
    make_results(folder / "a", seed=1)
    make_results(folder / "b" / "a", seed=2, prefix="b")


def a_shard(folder):
    (make_results(folder / "a", seed=1) / "shard.json").write_text("{}")


def merged(folder):
    (make_results(folder / "a", seed=1) / "suite.yaml").unlink()


def undated(folder):
    change(make_results(folder / "a", seed=1) / "manifest.json", "2026-01-01T00:00:00+00:00", "")


def with_files_elsewhere(folder):
    make_results(folder / "a", seed=1)
    text = "schema: gslcosim/scenario/1\nname: x\nenvironment: {path: room}\n"
    (folder / "a" / "own.yaml").write_text(text)
    change(folder / "a" / "suite.yaml", "[tiny_room]", "[own.yaml]")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda _: None, r"a: expected a folder of results \(manifest.json, trials.parquet\), found none"),
        (unfinished, "a: expected finished results, 24 trials, were 21. Give the same gslcosim bench run again"),
        (of_other_cases, "b: expected the cases of .*a, of suite synthetic .* Write a dataset for each suite"),
        (of_other_programs, "b: expected the program and parameters of infotaxis as in .*a, were others"),
        (flown_twice, "b: expected trials that are nowhere else, was .* Leave one of the folders out"),
        (called_alike, "a: expected folders with different names, .* Rename one"),
        (a_shard, "a: expected the results of a whole suite, was a shard"),
        (merged, "a: expected the suite that was run .* not merged ones"),
        (undated, "--date: expected a day of publication"),
        (with_files_elsewhere, "scenarios: expected files that the results hold, was .*own.yaml"),
    ],
)
def test_results_that_cannot_be_published_are_refused_in_a_sentence(tmp_path, make, message):
    make(tmp_path)
    folders = sorted(path.parent for path in tmp_path.rglob("manifest.json")) or [tmp_path / "a"]
    with pytest.raises(GslCosimError) as refused:
        write_dataset(folders, tmp_path / "out")
    assert re.search(message, str(refused.value))
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_a_part_of_a_suite_is_published_without_tracks_where_that_is_asked_for(tmp_path, capsys):
    unfinished(tmp_path)
    words = ["--out", str(tmp_path / "d"), "--incomplete", "--no-tracks"]
    assert main(["bench", "dataset", str(tmp_path / "a"), *words]) == 0
    assert capsys.readouterr().out.startswith("21 flights, 0 samples, 4 files, ")
    assert not (tmp_path / "d" / "tracks.parquet").exists()
    assert len(pq.read_table(tmp_path / "d" / "trials.parquet")) == 21
    described = json.loads((tmp_path / "d" / "croissant.json").read_text())
    assert [each["name"] for each in described["recordSet"]] == ["trials"]
    assert "samples" not in described["description"]
    sheet = (tmp_path / "d" / "README.md").read_text()
    assert "| flights | 21 |" in sheet
    assert "| flights of the suites with all entries | 24 |" in sheet
    assert "A part of the suites was flown." in sheet
    assert "Tracks are not published" in sheet


def test_options_are_checked_before_anything_is_read(results, tmp_path):
    with pytest.raises(UsageError, match=r"--license: expected an SPDX identifier such as CC-BY-4.0, .* was 'mine !'"):
        write_dataset(results, tmp_path / "out", license="mine !")
    with pytest.raises(UsageError, match="--out: expected a folder outside of the results"):
        write_dataset(results, results[0] / "out")
    (tmp_path / "thesis.pdf").touch()
    with pytest.raises(UsageError, match=r"--out: expected a new or empty folder, was .* with something in it"):
        write_dataset(results, tmp_path)


def test_the_command_writes_a_dataset_with_its_terms(results, tmp_path, capsys):
    words = ["--license", "https://example.org/terms", "--url", "https://example.org/d", "--date", "2027-02-03"]
    assert main(["bench", "dataset", str(results[1]), "--out", str(tmp_path / "d"), "--json", *words]) == 0
    written = json.loads(capsys.readouterr().out)
    assert (written["n_flights"], written["n_files"]) == (24, 5)
    described = json.loads((tmp_path / "d" / "croissant.json").read_text())
    terms = [described[key] for key in ("license", "url", "datePublished")]
    assert terms == ["https://example.org/terms", "https://example.org/d", "2027-02-03"]
    assert described["creator"] == [{"@type": "sc:Organization", "name": "anonymous"}]
    assert written["n_bytes"] == sum(path.stat().st_size for path in (tmp_path / "d").rglob("*") if path.is_file())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/tmp/a/b.py:3", "b.py:3"), ("at 0.5 m/s, 3 km/h", "at 0.5 m/s, 3 km/h"), ("https://a.org/b/c", "https://a.org/b/c"),
        ("agents[0]/x/y", "agents[0]/x/y"), ("('/home/ada/x', 1)", "('x', 1)"), ("", ""),
    ],
)  # fmt: skip
def test_folders_are_removed_from_texts_and_nothing_else(text, expected):
    assert remove_folders(text) == expected


@pytest.mark.extras
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_validator_finds_nothing_and_reads_the_rows(dataset, caplog):
    mlcroissant = pytest.importorskip("mlcroissant")
    read = mlcroissant.Dataset(str(dataset / "croissant.json"))
    assert (read.metadata.ctx.issues.errors, read.metadata.ctx.issues.warnings, caplog.messages) == (set(), set(), [])
    for name in ("trials", "tracks"):
        expected = pq.read_table(dataset / f"{name}.parquet").to_pylist()
        found = [{key.split("/")[1]: plain(value) for key, value in row.items()} for row in read.records(name)]
        assert found == [{key: plain(value) for key, value in row.items()} for row in expected]
