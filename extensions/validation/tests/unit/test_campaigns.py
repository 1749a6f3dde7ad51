"""Anchors and goals of published campaigns stand beside their data alone, whatever folders are called."""

import hashlib
import math
import shutil

import numpy as np
import pytest
from laser_campaigns import write_lasers
from mast_campaigns import write_campaign

from gslcosim_validation import read_measured
from gslcosim_validation.cases import load_case
from gslcosim_validation.page import make_storable, render_page, summarise_goals
from gslcosim_validation.readers import folder as folders
from gslcosim_validation.results import CaseResult, Comparison, Goal, plain_estimate


@pytest.mark.parametrize("name", ["metec", "stanford", "our_yard"])
def test_masts_of_others_have_neither_anchors_nor_goals_of_a_campaign(tmp_path, name):
    data = read_measured(write_campaign(tmp_path / name))
    for case in ("network-events", "network-forward"):
        rows = load_case(case).run(data, "quick").rows
        assert rows
        assert not [row.anchor for row in rows if row.anchor]
        assert not [row.goal.text for row in rows if row.goal is not None and " of " in row.goal.text]
        page = render_page([make_storable(load_case(case), "quick", CaseResult(rows=rows))])
        assert "METEC's first eight" not in page


@pytest.mark.parametrize("name", ["chilbolton", "field"])
def test_lasers_of_others_have_neither_anchors_nor_goals_of_a_campaign(tmp_path, name):
    data = read_measured(write_lasers(tmp_path / name, "source_1"))
    rows = load_case("laser-source").run(data, "quick").rows
    assert {(row.anchor, row.goal) for row in rows} == {("", None)}
    rows = load_case("laser-forward").run(data, "quick").rows
    assert {row.anchor for row in rows} == {"", "acceptance of Hanna and Chang 2012"}


def test_a_campaign_is_known_by_its_table_and_not_by_its_folder(tmp_path, monkeypatch):
    folder = write_campaign(tmp_path / "some_weeks")
    digest = hashlib.sha256((folder / "releases.csv").read_bytes()).hexdigest()
    monkeypatch.setitem(folders._CAMPAIGNS, digest, "metec")
    shutil.copytree(folder, tmp_path / "renamed")
    data = read_measured(tmp_path)
    assert [each.campaign for each in data.sets] == ["metec", "metec"]
    rows = load_case("network-events").run(data, "quick").rows
    assert {row.anchor for row in rows} > {"DLQ's two runs: 6 and 8"}
    assert {row.goal.text for row in rows if row.goal} > {"≥ 7 of 8", "≤ 4"}


def test_figures_that_are_undefined_are_neither_met_nor_missed():
    values = (math.nan, 0.7, 0.4, np.inf)
    rows = [
        Comparison(
            measured_set="yard", quantity=f"{x}", ours=plain_estimate(x), goal=Goal.parse("≥ 0.5"), if_missed="!"
        )
        for x in values
    ]
    assert [row.is_met for row in rows] == [None, True, False, True]
    stored = make_storable(load_case("laser-forward"), "full", CaseResult(rows=rows))
    assert summarise_goals([stored]) == "2 of 3 goals are met. 1 has an undefined figure."
    page = render_page([stored])
    assert "| yard | nan |  | undefined | ≥ 0.5 | undefined |" in page
    assert "Missed: yard, nan" not in page
