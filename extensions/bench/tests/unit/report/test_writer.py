import builtins
import csv
import importlib
import json
import re
from dataclasses import replace

import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pytest
import synthetic
from page_content import Page, data_of

from gslcosim.base.errors import UsageError
from gslcosim_bench.report.writer import write_report
from gslcosim_bench.statistics.rates import wilson
from gslcosim_bench.store import TRIALS
from gslcosim_bench.verification_marks import VerificationMark, results_hash, save_mark

SMALL = synthetic.Plan(
    n_scenarios=1, n_families=1, starts_m=synthetic.STARTS_M[:2], repetitions=2, controls_frac=0.5, n_points=8
)


def rows_of(folder):
    return pq.read_table(folder / "trials.parquet").to_pylist()


def page_of(folder):
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def read_csv(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_success_on_the_page_is_that_of_the_rows(usual):
    page, rows = page_of(usual), rows_of(usual)
    views = {"0": rows} | {str(1 + i): [row for row in rows if row["family"] == f"family_{1 + i}"] for i in range(2)}
    for view, some in views.items():
        for name in {row["entry"] for row in some}:
            flown = [row["success"] for row in some if row["entry"] == name and not row["is_control"]]
            cell = page.board[view, name][5]
            shown = wilson(sum(flown), len(flown))
            assert float(cell["v"]) == pytest.approx(shown.value, abs=1e-6)
            assert cell["title"] == f"n = {len(flown)}"
            assert f"{100 * shown.high:.0f}" in cell["text"]


def test_score_is_the_mean_of_the_means_of_cases_and_the_worst_quarter_stands_beside_it(usual):
    page, rows = page_of(usual), rows_of(usual)
    means = {}
    for row in rows:
        if row["entry"] == "e_coli" and not row["is_control"]:
            means.setdefault(row["case"], []).append(row["score"])
    cells = np.sort([np.mean(scores) for scores in means.values()])
    assert float(page.board["0", "e_coli"][2]["v"]) == pytest.approx(cells.mean(), rel=1e-5)
    board = json.loads((usual / "leaderboard.json").read_text(encoding="utf-8"))
    found = next(row for row in board["views"][0]["rows"] if row["entry"] == "e_coli")
    assert found["worst"]["value"] == pytest.approx(cells[: -(-len(cells) // 4)].mean())


def test_curves_and_starts_are_those_of_the_rows(usual):
    data, rows = data_of((usual / "report.html").read_text(encoding="utf-8")), rows_of(usual)
    names = [entry["name"] for entry in data["entries"]]
    chart = data["views"][0]["charts"]["success_over_time"]
    for line in chart["lines"]:
        flown = [row for row in rows if row["entry"] == names[line["entry"]] and not row["is_control"]]
        for t, value in zip(chart["shared_x"], line["value"], strict=True):
            share = np.mean([row["success"] and row["time_s"] <= t for row in flown])
            assert value == pytest.approx(share, abs=6e-4)
    for start in data["starts"]:
        room, entry, x_m, y_m, shown = (start[key] for key in ("room", "entry", "x_m", "y_m", "success"))
        flown = [
            row["success"]
            for row in rows
            if row["scenario"] == data["rooms"][room]["scenario"] and row["entry"] == names[entry]
            and (row["start_x_m"], row["start_y_m"]) == (x_m, y_m) and not row["is_control"]
        ]  # fmt: skip
        assert shown[0] == pytest.approx(np.mean(flown), abs=1e-4)
        assert shown[3] == len(flown)


def test_anchors_are_zero_and_one_when_normalised(usual):
    page = page_of(usual)
    assert float(page.board["0", "random_walker"][4]["v"]) == pytest.approx(0.0)
    assert float(page.board["0", "oracle"][4]["v"]) == pytest.approx(1.0)


def test_tracks_begin_and_end_where_they_did(usual):
    data = data_of((usual / "report.html").read_text(encoding="utf-8"))
    tracks = {row["trial"]: row for row in pq.read_table(usual / "tracks.parquet").to_pylist()}
    assert len(data["tracks"]) > 100
    for shown in data["tracks"][:50]:
        _, xy_m = synthetic.unpack_track(shown["packed"], data["quanta"])
        flown = tracks[shown["id"]]
        for axis, key in enumerate(("x_m", "y_m")):
            assert xy_m[[0, -1], axis] == pytest.approx([flown[key][0], flown[key][-1]], abs=data["quanta"][1])


def test_nothing_is_fetched_from_anywhere(usual):
    html = (usual / "report.html").read_text(encoding="utf-8")
    page = Page(html)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert set(re.findall(r"https?://[^\s\"'<]+", html)) <= {"http://www.w3.org/2000/svg"}
    assert "default-src 'none'" in html
    assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|import\(", html)


def test_ids_are_unique_and_links_lead_somewhere(usual):
    page = page_of(usual)
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    assert set(page.labelled_by) <= set(page.ids)


def test_names_are_escaped_everywhere(tmp_path):
    nasty = '<b>"it\'s"&</script><script>alert(1)</script>'
    methods = (synthetic.Method(name=nasty, faults=0.5), synthetic.WALKER)
    plan = replace(SMALL, methods=methods, title=nasty, question="<img src=x onerror=alert(1)>")
    folder = synthetic.make_results(tmp_path, plan)
    heads, rows = write_report(folder).leaderboard
    assert heads[:3] == ["#", "Entry", "Score"]
    assert nasty in [row[1] for row in rows]
    summary = (folder / "summary.md").read_text(encoding="utf-8")
    assert "| " + " | ".join(heads) + " |\n|--:|---|--:|" in summary
    html = (folder / "report.html").read_text(encoding="utf-8")
    page = Page(html)
    assert "img" not in page.tags
    assert '<b>"it' not in html
    assert "<script>alert" not in html
    assert "<img" not in html
    assert html.count("</script>") == 2
    assert nasty in "".join(page.text)
    assert data_of(html)["entries"][0]["name"] == nasty
    assert "<script>" not in summary


def test_the_formula_and_every_column_are_on_the_page(usual):
    text = " ".join("".join(page_of(usual).text).split())
    assert (
        "q = S (1 \N{MINUS SIGN} 0.5 t \N{DIVISION SLASH} T), halved for each false declaration, 0 after a collision"
        in text
    )
    assert all(name in text for name in TRIALS.names)


def test_each_failure_has_its_command(usual):
    failed = [row for row in rows_of(usual) if not row["success"] and not row["is_control"]]
    shown = read_csv(usual / "tables" / "failures.csv")
    assert {row["trial"] for row in failed} <= {row["trial"] for row in shown}
    assert all(row["command"].endswith(f"--trial {row['trial']}") for row in shown)
    commands = [text for text in page_of(usual).text if text.startswith("gslcosim bench show ")]
    assert commands
    assert all(re.search(r"--trial [0-9a-f]{16}$", command) for command in commands)


def test_tables_read_back(usual):
    shown = read_csv(usual / "tables" / "trials.csv")
    for row, line in zip(rows_of(usual), shown, strict=True):
        for name in ("time_s", "score", "travel_overhead", "belief_mass_near", "time_to_source_s"):
            assert (line[name] and float(line[name])) == ("" if row[name] is None else row[name])
        assert (line["trial"], line["success"], int(line["seed"])) == (row["trial"], str(row["success"]), row["seed"])
    tables = {path.name: read_csv(path) for path in (usual / "tables").glob("*.csv")}
    assert len(tables) == 15
    assert all(tables.values())
    board = {(row["view"], row["entry"]): row for row in tables["leaderboard.csv"]}
    page = page_of(usual)
    for name in ("surge_cast", "infotaxis"):
        assert float(board["all", name]["time_s"]) == pytest.approx(float(page.board["0", name][10]["v"]), rel=1e-5)
    pairs = [row for row in tables["pairs.csv"] if row["view"] == "all"]
    assert len(pairs) == 15
    assert {row["better"] for row in pairs} <= {"", *(row["entry"] for row in board.values())}


def record(required, **properties):
    return {"type": "object", "required": required.split(), "properties": properties}


FIGURES = (
    "score worst normalised success declared_05 declared_1 declared_2 lift time_s spl overhead false_alarms decision_ms"
)
END = {"type": ["number", "null"]}
FIGURE = record("value low high n", value={"type": "number"}, low=END, high=END, n={"type": "integer", "minimum": 1})
PLACE, NAMES = {"type": "integer", "minimum": 1}, {"type": ["array", "null"]}
ROW = record(
    f"rank last_rank entry knows anchor agent_hash n beats same_as {FIGURES}",
    rank=PLACE, last_rank=PLACE, beats=NAMES, same_as=NAMES,
    **{name: {"oneOf": [{"type": "null"}, FIGURE | {"additionalProperties": False}]} for name in FIGURES.split()},
)  # fmt: skip
SENTENCES = {"type": "array", "items": {"type": "string", "minLength": 1}}
LEADERBOARD = record(
    "schema suite suite_hash complete n_trials n_planned verified views conclusions smallest_difference_points",
    schema={"const": "gslcosim/leaderboard/1"},
    smallest_difference_points={"type": "number", "exclusiveMinimum": 0},
    conclusions=record("holds limits") | {"additionalProperties": SENTENCES},
    views={"type": "array", "items": record(
        "key kind label drawn n_rooms n_plumes rows",
        drawn={"enum": ["rooms", "plumes", "flights"]}, rows={"type": "array", "items": ROW},
    )},
)  # fmt: skip


def test_leaderboard_for_programs_keeps_its_schema(usual):
    shown = json.loads((usual / "leaderboard.json").read_text(encoding="utf-8"))
    jsonschema.validate(shown, LEADERBOARD)
    rows = shown["views"][0]["rows"]
    assert shown["complete"]
    assert [view["kind"] for view in shown["views"]] == ["all", "family", "family"]
    scores = [row["score"]["value"] for row in rows]
    assert scores == sorted(scores, reverse=True)
    assert rows[0]["entry"] == "oracle"
    assert rows[0]["anchor"] == "lower"


def test_summary_has_question_leaderboard_and_verdicts(usual):
    text = (usual / "summary.md").read_text(encoding="utf-8")
    assert text.startswith("# A suite that was never flown\n\n> Does the page say what the rows say?\n")
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len(lines) == 2 + 6
    assert len({line.count("|") for line in lines}) == 1
    assert "- oracle: better than" in text
    assert "q = S (1 - 0.5 t / T)" in text
    assert text.index("## What may be concluded") < text.index("## What may not") < text.index("| # | Entry")


@pytest.mark.slow
def test_the_same_rows_make_the_same_report(tmp_path):
    folder = synthetic.make_results(tmp_path / "results", SMALL)
    write_report(folder)
    first = {path.name: path.read_bytes() for path in folder.rglob("*.*") if path.is_file()}
    write_report(folder)
    assert first == {path.name: path.read_bytes() for path in folder.rglob("*.*") if path.is_file()}


ONE = synthetic.Method(name="alone", success=0.5)
ANCHORED = (synthetic.ORACLE, synthetic.WALKER)
# A folder, what its page says, and the sections that it lacks.
TINY = {
    "one trial": (replace(SMALL, methods=(ONE,), starts_m=((3, 3),), repetitions=1, controls_frac=0.0), "", set()),
    "no success at all": (replace(SMALL, methods=(replace(ONE, success=0.0), replace(ONE, name="b", success=0.0))),
                          "", set()),
    "nothing but success": (replace(SMALL, methods=(replace(ONE, success=1.0, luck=1.0), synthetic.ORACLE)), "", set()),
    "no controls": (replace(SMALL, controls_frac=0.0), "There are no flights without gas", set()),
    "no oracle": (replace(SMALL, methods=(*synthetic.USUAL, synthetic.WALKER)), "The oracle has not flown",
                  {"profile"}),
    "no walker": (replace(SMALL, methods=(*synthetic.USUAL, synthetic.ORACLE)), "", set()),
    "one entry": (replace(SMALL, methods=(ONE,)), "", {"pairs"}),
    "only faults": (replace(SMALL, methods=(replace(ONE, faults=1.0),)), "ended without a result", {"pairs"}),
    "no maps and tracks": (replace(SMALL, maps=False, tracks=False), "There are no tracks", {"tracks"}),
    "not complete": (replace(SMALL, missing=7), "Not complete: ", set()),
    "nothing flown": (
        replace(SMALL, methods=(ONE,), repetitions=1, starts_m=((3, 3),), controls_frac=0.0, missing=1),
        "No trial has been flown yet", {"leaderboard", "curves", "pairs", "failures"}),
    "sixty entries": (replace(SMALL, methods=(*synthetic.many(58), *ANCHORED)), "", set()),
}  # fmt: skip


# The smallest of each kind of folder is quick enough to be tried each time.
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in ("one trial", "only faults") else [pytest.mark.slow]) for name in TINY],
)
def test_every_folder_gets_a_page_that_says_what_is_missing(name, tmp_path):
    plan, said, left_out = TINY[name]
    folder = synthetic.make_results(tmp_path / "results", plan)
    page = Page(write_report(folder).page.read_text(encoding="utf-8"))
    assert said in "".join(page.text)
    assert not left_out & set(page.ids)
    n_entries = 0 if name == "nothing flown" else len(plan.methods)
    assert sum(view == "0" for view, _ in page.board) == n_entries
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids) | {"leaderboard"}
    assert "nan" not in re.sub(r"[a-z_]*nan[a-z_]+|[a-z_]+nan", "", " ".join(page.text).lower())
    data = data_of(page.html)
    assert all(chart["lines"] for view in data["views"] for chart in view["charts"].values())
    jsonschema.validate(json.loads((folder / "leaderboard.json").read_text(encoding="utf-8")), LEADERBOARD)
    summary = (folder / "summary.md").read_text(encoding="utf-8")
    assert not re.search(r"^## .*\n+## ", summary, re.MULTILINE), "a heading has nothing below it"


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(UsageError, match="expected a folder of results"):
        write_report(tmp_path)


@pytest.mark.parametrize("name", ["manifest.json", "maps.json", "suite.yaml", "trials.parquet", "tracks.parquet"])
def test_a_damaged_file_is_named(name, tmp_path):
    folder = synthetic.make_results(tmp_path / "results", SMALL)
    (folder / name).write_text("{[")
    with pytest.raises(UsageError, match=name):
        write_report(folder)


def test_maps_that_do_not_hold_what_they_say_are_named(tmp_path):
    folder = synthetic.make_results(tmp_path / "results", SMALL)
    maps = json.loads((folder / "maps.json").read_text())
    maps["maps"][0]["shape"] = [3, 3]
    (folder / "maps.json").write_text(json.dumps(maps))
    with pytest.raises(UsageError, match=r"maps\.json"):
        write_report(folder)


@pytest.mark.slow
def test_figures_are_written_and_always_the_same(tmp_path):
    plan = replace(SMALL, methods=(*SMALL.methods, replace(ONE, name="costs $5_a^b")))
    folder = synthetic.make_results(tmp_path / "results", plan)
    write_report(folder, figures=True)
    first = {path.name: path.read_bytes() for path in (folder / "figures").iterdir()}
    assert {"leaderboard.svg", "success_over_time.pdf", "pairs.svg", "roc.pdf", "profile.svg", "beliefs.svg"} <= {
        *first
    }
    write_report(folder, figures=True)
    assert first == {path.name: path.read_bytes() for path in (folder / "figures").iterdir()}


@pytest.mark.slow
def test_merged_results_say_whose_and_which_are_not_verified(tmp_path):
    folder = synthetic.make_results(tmp_path / "results", SMALL)
    manifest = json.loads((folder / "manifest.json").read_text())
    for entry in manifest["entries"]:
        # What a folder says of itself is not believed.
        entry |= {"submission": "of alice" if entry["name"] == "e_coli" else "bob", "verified": True}
    manifest |= {"merged_from": ["of alice", "bob"], "n_planned": 10_000}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    mark = VerificationMark(entries={entry["name"]: entry["name"] != "e_coli" for entry in manifest["entries"]})
    save_mark(results_hash(folder), mark)
    text = "".join(Page(write_report(folder).page.read_text(encoding="utf-8")).text)
    assert "Not verified by flying a sample again: e_coli." in text
    assert "Not complete" not in text
    rows = json.loads((folder / "leaderboard.json").read_text(encoding="utf-8"))["views"][0]["rows"]
    shown = {row["entry"]: (row["submission"], row["verified"]) for row in rows}
    assert shown["e_coli"] == ("of alice", False)
    assert shown["infotaxis"] == ("bob", True)
    commands = {row["entry"]: row["command"] for row in read_csv(folder / "tables" / "failures.csv")}
    assert commands["random_walker"].startswith("gslcosim bench show bob --trial ")
    assert commands["e_coli"].startswith("gslcosim bench show 'of alice' --trial ")


def test_figures_without_matplotlib_name_the_extra(tmp_path, monkeypatch):
    folder = synthetic.make_results(tmp_path / "results", SMALL)
    real = importlib.import_module

    def refuse(name, *rest):
        if name.startswith("matplotlib"):
            raise builtins.ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(UsageError, match=r"gslcosim-bench\[report\]"):
        write_report(folder, figures=True)


@pytest.mark.slow
def test_the_page_of_ten_thousand_trials_has_at_most_ten_megabytes(tmp_path):
    plan = synthetic.Plan(n_scenarios=6, n_families=3, repetitions=22, controls_frac=0.4, n_points=150)
    folder = synthetic.make_results(tmp_path / "results", plan)
    assert len(rows_of(folder)) >= 10_000
    assert write_report(folder).page.stat().st_size < 10e6


def test_no_name_is_a_formula_or_markup_in_tables(tmp_path):
    """CSV files for spreadsheets, and the summary for pages that show Markdown."""
    formula = "=HYPERLINK(1);+2|<img src=x onerror=alert(1)>[a](javascript:alert(1))`\x1b[31m"
    methods = (synthetic.Method(name=formula, faults=0.5), replace(synthetic.WALKER, name="-1+1"))
    folder = synthetic.make_results(tmp_path, replace(SMALL, methods=methods, title=formula))
    write_report(folder)
    cells = [
        cell
        for path in (folder / "tables").glob("*.csv")
        for row in csv.reader(path.read_text(encoding="utf-8").splitlines())
        for part in row
        for cell in part.split(";")
    ]
    assert {"'=HYPERLINK(1)", "'-1+1"} <= set(cells)
    assert [cell for cell in cells if cell[:1] in "=+@\t" and cell] == []
    assert [float(cell) for cell in cells if cell.startswith("-")]
    assert not any("\x1b" in cell for cell in cells)
    summary = (folder / "summary.md").read_text(encoding="utf-8")
    assert "HYPERLINK" in summary
    assert "<img" not in summary
    assert "](" not in summary.replace("\\](", "")
    assert "\x1b" not in summary
