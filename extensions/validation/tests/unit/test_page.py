"""The page of `make reality`: rows, goals, misses; the checked-in one is that of its stored results."""

import math
import shutil
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_validation.cases import load_case, load_cases
from gslcosim_validation.page import RESULTS, make_storable, render_page, store_result, write_page
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


def test_an_unknown_case_is_told_with_the_known_ones():
    with pytest.raises(UsageError, match=r"--only: expected cases among .*laser-forward.*, was windmill"):
        load_cases(["windmill"])
