"""The page of `make reality`: rows, goals, misses; the checked-in one is that of its stored results."""

import math
import shutil
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_validation.cases import load_case, load_cases
from gslcosim_validation.page import (
    RESULTS,
    make_storable,
    read_stored,
    render_page,
    store_result,
    summarise,
    terminal_rows,
    write_page,
)
from gslcosim_validation.release_pairs import ReleasePairs
from gslcosim_validation.results import CaseResult, Comparison, Drawing, Goal

STUDIES = Path(__file__).parents[4] / "docs" / "studies"


def make_row(value, goal, **kwargs):
    ours = Estimate(value, value - 0.1, value + 0.1, 5)
    return Comparison(measured_set="yard", quantity="FAC2", ours=ours, goal=goal, anchor="theirs 0.4", **kwargs)


def test_goals_are_met_at_their_ends():
    assert Goal.parse("≥ 0.5").is_met(0.5)
    assert not Goal.parse("≤ 0.5").is_met(0.51)
    assert Goal.parse("-0.3 to 0.3").is_met(-0.3)
    assert Goal.parse("≥ 7 of 8") == Goal(7, math.inf, "≥ 7 of 8")


def test_goals_in_proportion_and_around_a_middle():
    assert Goal.parse("≥ 16/18 of 4") == Goal(4, math.inf, "≥ 4 of 4")
    assert Goal.parse("≥ 1/2 of 5") == Goal(3, math.inf, "≥ 3 of 5")
    assert Goal.parse("0.5 ± 20 %") == Goal(0.4, 0.6, "0.5 ± 20 %")
    assert Goal.parse("-5/3 ± 0.3") == Goal(-5 / 3 - 0.3, -5 / 3 + 0.3, "-5/3 ± 0.3")


def test_the_page_has_each_row_and_a_paragraph_for_each_miss():
    case = load_case("laser-forward")
    rows = [
        make_row(0.7, Goal.parse("≥ 0.5"), if_missed="never shown"),
        make_row(0.4, Goal.parse("≥ 0.5"), if_missed="The wind turns."),
        make_row(0.4, None),
    ]
    page = render_page([make_storable(case, "quick", CaseResult(rows=rows, remarks=["A remark."]))])
    assert "**1 of 2 goals are met.**" in page
    assert "| yard | FAC2 | theirs 0.4 | 0.4 [0.3, 0.5] | ≥ 0.5 | **no** |" in page
    assert "**Missed: yard, FAC2** (0.4 [0.3, 0.5], goal ≥ 0.5). The wind turns." in page
    assert "never shown" not in page
    assert "A remark." in page
    assert "Made with `--quick`" in page


def test_misses_for_one_reason_share_a_paragraph():
    rows = [make_row(value, Goal.parse("≥ 0.5"), if_missed="The wind turns.") for value in (0.3, 0.4)]
    page = render_page([make_storable(load_case("laser-forward"), "full", CaseResult(rows=rows))])
    assert page.count("The wind turns.") == 1
    assert (
        "**Missed: yard, FAC2** (0.3 [0.2, 0.4], goal ≥ 0.5); **yard, FAC2** (0.4 [0.3, 0.5], goal ≥ 0.5). The" in page
    )


def test_results_are_stored_with_their_figures_and_others_stay(tmp_path):
    case = load_case("laser-forward")
    drawing = Drawing(name="line", caption="A line.", draw=lambda figure: figure.subplots().plot([0, 1]))
    result = CaseResult(rows=[make_row(0.7, Goal.parse("≥ 0.5"))], drawings=[drawing])
    store_result(tmp_path, case, "full", result)
    assert (tmp_path / RESULTS / "laser-forward-line.png").read_bytes().startswith(b"\x89PNG")
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert "![A line.](reality/laser-forward-line.png)" in page


def test_the_checked_in_page_is_that_of_its_results(tmp_path):
    shutil.copytree(STUDIES / RESULTS, tmp_path / RESULTS)
    assert write_page(tmp_path).read_text(encoding="utf-8") == (STUDIES / "reality.md").read_text(encoding="utf-8")


def made_up_pairs(names, *, n=3):
    return [
        ReleasePairs(
            kind_of_air="open_ground",
            release=str(i),
            quantity="mean",
            modelled=[1.0 + 0.1 * k + 0.2 * i],
            measured=[1.0],
            measured_set=name,
        )
        for k, name in enumerate(names)
        for i in range(n)
    ]


def test_errors_of_runs_are_made_of_what_all_cases_have_left(tmp_path):
    for name, sets in (("laser-forward", ["field"]), ("network-forward", ["yard", "stack", "tank"])):
        store_result(tmp_path, load_case(name), "full", CaseResult(rows=[], pairs=made_up_pairs(sets)))
    (stored,) = summarise(read_stored(tmp_path), tmp_path)
    quantities = [row["quantity"] for row in stored["rows"]]
    assert quantities[0] == "coverage of 90 % intervals on sets held out, 12 means and intensities of releases"
    assert stored["rows"][0]["goal"] == "0.8 to 0.97"
    assert stored["rows"][2]["anchor"] == "field 3 of 3, stack 3 of 3, tank 3 of 3, yard 3 of 3"
    assert (tmp_path / RESULTS / "expected_errors.json").is_file()
    page = write_page(tmp_path).read_text(encoding="utf-8")
    assert "| open ground | 1.00 | 1.3 [" in page
    assert "| field (3), stack (3), tank (3), yard (3) | - | - |" in page
    assert terminal_rows([stored])[1][0][3] == "1"


def test_one_set_alone_says_nothing_of_runs(tmp_path):
    result = make_storable(load_case("laser-forward"), "full", CaseResult(rows=[], pairs=made_up_pairs(["field"])))
    assert summarise([result], tmp_path) == []
    assert not (tmp_path / RESULTS).exists()


def test_an_unknown_case_is_told_with_the_known_ones():
    with pytest.raises(UsageError, match=r"--only: expected cases among .*laser-forward.*, was windmill"):
        load_cases(["windmill"])
