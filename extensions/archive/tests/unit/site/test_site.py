"""The site of results: pages whose links lead somewhere, names that are only names, and tracks as they were flown."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.main import main
from gslcosim_archive.site.file_names import assign_file_names
from gslcosim_archive.site.tracks import choose_format, encode_gas
from gslcosim_archive.site.writer import write_site
from gslcosim_bench.report.tracks import QUANTA, AgentTrack

NASTY = '../../"><img src=x onerror=alert(1)><script>alert(1)</script>'
METHODS = (
    synthetic.Method(name=NASTY, faults=0.3),
    synthetic.Method(name=NASTY.upper(), success=0.4),
    synthetic.ORACLE,
    synthetic.WALKER,
)
PLAN = synthetic.Plan(methods=METHODS, starts_m=synthetic.STARTS_M[:2], repetitions=2, controls_frac=0.5, n_points=20)


class Links(HTMLParser):
    """Tags, ids and links of a page, and its text outside of scripts."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.ids, self.links, self.text = set(), [], [], ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.add(tag)
        self.ids += [attributes["id"]] if "id" in attributes else []
        self.links += [attributes[key] for key in ("href", "src") if key in attributes]
        assert not any(key.startswith("on") for key in attributes)

    def handle_data(self, data):
        self.text += data


def rename(folder, column, change):
    path = folder / "trials.parquet"
    table = pq.read_table(path)
    values = [change(value) for value in table[column].to_pylist()]
    pq.write_table(table.set_column(table.schema.names.index(column), column, pa.array(values)), path)


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    """The site of results whose names somebody has chosen who means harm, and the results."""
    root = tmp_path_factory.mktemp("foreign")
    folder = synthetic.make_results(root / "results", PLAN)
    for column in ("case", "trial"):
        rename(folder, column, lambda value: f"{value}{NASTY}")
    tracks = pq.read_table(folder / "tracks.parquet")
    trials = pa.array([f"{value}{NASTY}" for value in tracks["trial"].to_pylist()])
    pq.write_table(tracks.set_column(0, "trial", trials), folder / "tracks.parquet")
    write_site([folder], root / "deep" / "site")
    return root


def data_of(path):
    return json.loads(re.fullmatch(r'flights\("[a-z0-9_-]+", (.*)\);\n', path.read_text())[1])


def test_every_link_leads_somewhere_and_names_are_only_names(foreign):
    site = foreign / "deep" / "site"
    assert sorted(path.name for path in foreign.iterdir()) == ["deep", "results"]
    assert [path.name for path in (foreign / "deep").iterdir()] == ["site"]
    pages = {path.resolve(): path.read_text() for path in site.rglob("*.html")}
    assert len(pages) == 1 + len(METHODS) + 4
    read = {path: Links(html) for path, html in pages.items()}
    trials = {flight[0] for path in (site / "tracks").iterdir() for flight in data_of(path)["flights"]}
    entries = {path.stem for path in (site / "methods").iterdir()}
    for path, page in read.items():
        assert "img" not in page.tags
        assert "<script>" not in pages[path]
        assert NASTY in page.text or "oracle" in path.name or "random_walker" in path.name
        assert len(page.ids) == len(set(page.ids))
        assert "default-src 'none'" in pages[path]
        for link in page.links:
            if link == "data:,":
                continue
            name, _, place = link.partition("#")
            target = (path.parent / unquote(name)).resolve() if name else path
            assert target.is_relative_to(site.resolve()), link
            assert target.is_file(), link
            places = {*read[target].ids, *trials, *(f"entry={entry}" for entry in entries)} if target in read else ()
            assert not place or unquote(place) in places, link


def test_nothing_is_asked_of_the_network(foreign):
    for path in (foreign / "deep" / "site").rglob("*"):
        if path.suffix in (".html", ".js", ".css"):
            text = path.read_text()
            assert set(re.findall(r"https?://[^\s\"'<]+", text)) <= {"http://www.w3.org/2000/svg"}, path
            assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|import\(|type=.module", text), path


def test_a_case_has_all_its_flights_as_they_were_flown(foreign):
    rows = pq.read_table(foreign / "results" / "trials.parquet").to_pylist()
    tracks = {row["trial"]: row for row in pq.read_table(foreign / "results" / "tracks.parquet").to_pylist()}
    shown = [data_of(path) for path in (foreign / "deep" / "site" / "tracks").iterdir()]
    begun = {flight[0]: flight for data in shown for flight in data["flights"]}
    assert len(begun) == len(rows)
    assert all(len([row for row in rows if row["trial"].startswith(trial)]) == 1 for trial in begun)
    for data in shown:
        assert data["name"].endswith(NASTY)
        for flight in data["flights"][:4]:
            t_s, xy_m = synthetic.unpack_track(flight[8][0], QUANTA)
            flown = next(track for trial, track in tracks.items() if trial.startswith(flight[0]))
            for axis, key in enumerate(("x_m", "y_m")):
                off = np.interp(flown["t_s"], t_s, xy_m[:, axis]) - np.array(flown[key])
                assert np.abs(off).max() < 0.1 + 2 * QUANTA[1]


def test_a_repetition_with_a_source_of_its_own_shows_that_one_without_the_mapped_gas(tmp_path):
    few = replace(PLAN, methods=METHODS[2:], n_scenarios=1, starts_m=synthetic.STARTS_M[:1], controls_frac=0.0)
    folder = synthetic.make_results(tmp_path / "results", few)
    places = iter([9.0, 9.0, synthetic.SOURCE_M[0], synthetic.SOURCE_M[0]])
    rename(folder, "source_x_m", lambda _: next(places))
    labels = json.dumps({"labels.wind": "gusting"})
    rename(folder, "varied", lambda _: labels)
    write_site([folder], tmp_path / "site")
    data = data_of(next((tmp_path / "site" / "tracks").iterdir()))
    own = {(flight[2], len(flight) > 11 and tuple(flight[11])) for flight in data["flights"]}
    assert own == {(0, (9.0, synthetic.SOURCE_M[1])), (1, False)}
    pictures = [data["plan"], data["plan_without_gas"]]
    assert sorted(path.stem for path in (tmp_path / "site" / "plans").iterdir()) == sorted(pictures)


def test_a_track_is_off_by_no_more_than_its_tolerance_at_any_time():
    rng = np.random.default_rng(3)
    t_s = np.arange(300.0)
    xy_m = np.cumsum(rng.normal(0.0, 0.3, (300, 2)), axis=0)
    track = AgentTrack(t_s=t_s, xy_m=xy_m, gas_ppm=np.zeros(300))
    for tolerance_m in (0.1, 0.8):
        kept_s, kept_m = synthetic.unpack_track(track.pack(tolerance_m), QUANTA)
        shown_m = np.stack([np.interp(t_s, kept_s, kept_m[:, axis]) for axis in (0, 1)], axis=1)
        assert np.hypot(*(shown_m - xy_m).T).max() <= tolerance_m + QUANTA[1]
    assert len(track.pack(0.8)) < 0.3 * len(track.pack(0.1))
    # A budget that all of them cannot keep is kept by fewer of them.
    short = AgentTrack(t_s=t_s[:40], xy_m=xy_m[:40], gas_ppm=np.zeros(40))
    assert choose_format({0: [short]}).tolerance_m == 0.1
    assert choose_format({row: [short] for row in range(20_000)}).tolerance_m > 0.1
    assert choose_format({row: [short] for row in range(400_000)}).every > 1


def test_gas_is_shown_on_a_logarithmic_scale():
    t_s = np.linspace(0.0, 59.0, 60)
    gas_ppm = np.where(t_s < 30, 0.0, np.where(t_s < 45, 0.1, 10.0))
    track = AgentTrack(t_s=t_s, xy_m=np.zeros((60, 2)), gas_ppm=gas_ppm)
    assert encode_gas([track], 60.0, 10.0) == "0" * 20 + "5" * 10 + "f" * 10
    assert encode_gas([replace(track, gas_ppm=np.zeros(60))], 60.0, 10.0) == ""


def test_file_names_are_plain_and_never_the_same():
    names = ["A", "a", "../../etc/passwd", "..", "", "é", "x" * 300, "x" * 301, 'a"b', "a<b"]
    files = assign_file_names(names)
    assert all(re.fullmatch(r"[a-z0-9_][a-z0-9_-]{0,63}", file) for file in files.values())
    assert len(set(files.values())) == len(names)
    assert files["../../etc/passwd"] == "etc-passwd"


def test_an_earlier_site_is_replaced_and_nothing_else(tmp_path, capsys):
    few = synthetic.Plan(
        methods=(synthetic.ORACLE, synthetic.WALKER), n_scenarios=1, starts_m=synthetic.STARTS_M[:1], repetitions=1,
        controls_frac=0.0, n_points=5, maps=False,
    )  # fmt: skip
    results, site = synthetic.make_results(tmp_path / "results", few), tmp_path / "site"
    assert main(["bench", "site", str(results), "--out", str(site), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["n_methods"], told["n_cases"], told["n_trials"]) == (2, 1, 2)
    first = {path: path.read_bytes() for path in site.rglob("*") if path.is_file()}
    assert told["n_bytes"] == sum(map(len, first.values())) - len((site / "site.json").read_bytes())
    (site / "CNAME").write_text("example.org")
    (site / "methods" / "gone.html").write_text("of an entry that is no more")
    write_site([results], site)
    assert {path: path.read_bytes() for path in site.rglob("*") if path.is_file()} == first | {
        site / "CNAME": b"example.org"
    }
    other = synthetic.make_results(tmp_path / "other", few)
    manifest = json.loads((other / "manifest.json").read_text())
    (other / "manifest.json").write_text(json.dumps(manifest | {"suite_hash": "cd" * 32}))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    (tmp_path / "empty").mkdir()
    refused = [
        ([tmp_path / "empty"], site, "expected a folder of results"),
        ([results, other], site, "cannot be ranked together"),
        ([results], tmp_path / "mine", "expected a new or empty folder"),
        ([results], results / "site", "expected a folder outside of the results"),
        ([results], tmp_path / "mine" / "thesis.tex", "expected a new or empty folder"),
    ]
    for folders, out, text in refused:
        with pytest.raises(UsageError, match=text):
            write_site(folders, out)
    assert main(["bench", "site", str(results), "--out", str(tmp_path / "mine")]) == ExitCode.USAGE
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.tex"]
    assert not (results / "site").exists()


def test_results_of_several_authors_are_one_site(tmp_path):
    plan = replace(PLAN, methods=(synthetic.USUAL[0], synthetic.ORACLE, synthetic.WALKER), tracks=True)
    ours = synthetic.make_results(tmp_path / "ours", plan)
    theirs = synthetic.make_results(tmp_path / "theirs", replace(plan, methods=(*synthetic.USUAL[1:2], *METHODS[2:])))
    for folder in (ours, theirs):
        rename(folder, "digest", lambda value: "" if value == "" else "ab" * 32)
    written = write_site([ours, theirs], tmp_path / "site")
    assert written.n_methods == 4
    page = (tmp_path / "site" / "methods" / "e_coli.html").read_text()
    assert "<dt>submission</dt><dd>theirs</dd>" in page
    assert "gslcosim bench show theirs --trial " in page
    flown = data_of(next((tmp_path / "site" / "tracks").iterdir()))
    assert {method["name"] for method in flown["methods"]} == {"surge_cast", "e_coli", "oracle", "random_walker"}


def test_pages_say_what_the_rows_say(foreign):
    site, results = foreign / "deep" / "site", foreign / "results"
    rows = [row for row in pq.read_table(results / "trials.parquet").to_pylist() if not row["is_control"]]
    board = json.loads((site / "leaderboard.json").read_text())["views"][0]["rows"]
    assert {row["entry"] for row in board} == {method.name for method in METHODS}
    files = assign_file_names(row["case"] for row in rows)
    for case, file in files.items():
        page = (site / "cases" / f"{file}.html").read_text()
        for entry in ("oracle", "random_walker"):
            flown = [row["success"] for row in rows if row["case"] == case and row["entry"] == entry]
            name = entry.replace("_", "_<wbr>")
            cell = re.search(rf'>{name}</a></th><td data-v="([^"]*)" title="n = (\d+)"', page)
            assert float(cell[1]) == pytest.approx(np.mean(flown))
            assert int(cell[2]) == len(flown)
    assert (site / "index.html").read_text().count('class="cell"') == len(files) * len(METHODS)
