"""The suite of measured logs: what estimators see, how claims are scored, and the folder of results."""

import dataclasses
import json
import math

import pyarrow.parquet as pq
import pytest
from mast_campaigns import FIRST, LAST, PLACES_M, write_campaign

from gslcosim.base.errors import UsageError
from gslcosim_bench.results import Results
from gslcosim_bench.store import ResultsFolder
from gslcosim_validation import read_measured
from gslcosim_validation.measured_suite import estimators, run
from gslcosim_validation.measured_suite.estimators import ENTRIES, Claim, Entry
from gslcosim_validation.measured_suite.logs import LogRow, LogSite, load_log_cases
from gslcosim_validation.measured_suite.run import run_entry, run_measured
from gslcosim_validation.measured_suite.scores import score_claims

NETWORK = next(entry for entry in ENTRIES if entry.name == "leak_network")


def case_of(folder):
    (case,) = load_log_cases(read_measured(folder))
    return case


def test_the_leak_network_finds_place_time_and_rate(yard):
    case = case_of(yard)
    result = run_entry(NETWORK, case)
    (scored,) = result.score.releases
    assert not result.fault
    assert scored.outcome == "exact"
    assert scored.rate_ratio == pytest.approx(1.0, abs=0.2)
    assert scored.place_error_m == 0.0
    assert scored.overlap_frac > 0.6
    assert result.score.false_claims == ()


def test_what_is_claimed_does_not_depend_on_the_truth(tmp_path, yard):
    other = case_of(write_campaign(tmp_path / "yard", place="well", truth="tank", rate_kg_h=2.0))
    told, of_yard = run_entry(NETWORK, other), run_entry(NETWORK, case_of(yard))
    assert told.score.claims == of_yard.score.claims
    assert (told.score.releases[0].outcome, of_yard.score.releases[0].outcome) == ("touched", "exact")


def test_nothing_that_an_estimator_gets_has_a_release_in_it(yard):
    site, row = {field.name for field in dataclasses.fields(LogSite)}, {f.name for f in dataclasses.fields(LogRow)}
    assert not {name for name in site | row if "release" in name or "truth" in name or "rate" in name}
    assert set(case_of(yard).site.places_m) == set(PLACES_M)


def test_a_release_without_the_name_of_its_place_is_judged_by_its_point(tmp_path):
    folder = write_campaign(tmp_path / "yard")
    path = folder / "releases.csv"
    path.write_text(path.read_text().replace(",place,", ",spot,"))
    done = run_measured(folder, ResultsFolder(tmp_path / "results"), only=["leak_network"], has_report=False)
    assert {result.score.releases[0].outcome for result in done.results} == {"exact"}


def test_the_only_place_of_a_site_is_not_told(tmp_path):
    folder = write_campaign(tmp_path / "yard")
    site = json.loads((folder / "site.json").read_text())
    site["candidate_places"]["tank"] = {**site["candidate_places"]["well"], "height_m": 5.0}
    (folder / "site.json").write_text(json.dumps(site))
    case = case_of(folder)
    assert not case.site.places_m
    assert case.releases[0].place is None
    assert score_claims(case, [claim(case, 0, 100, position_m=(30.0, 10.0))]).releases[0].is_exact
    assert not score_claims(case, [claim(case, 0, 100, position_m=(40.0, 10.0))]).releases[0].is_exact


def claim(case, first_min, last_min, **values):
    """Return a claim by minutes since the release began."""
    begin_s = case.releases[0].start_s
    return Claim(start_s=begin_s + 60.0 * first_min, end_s=begin_s + 60.0 * last_min, **values)


def test_claims_are_scored_by_overlap_place_and_rate(yard):
    case = case_of(yard)
    n = LAST - FIRST
    rate_kg_s = case.releases[0].rate_kg_s
    right = claim(case, 30, n - 1, place="well", position_m=PLACES_M["well"], rate_kg_s=0.5 * rate_kg_s)
    wrong = claim(case, 0, 10, place="tank", position_m=PLACES_M["tank"])
    far = claim(case, n + 60, n + 70, place="well")
    scored = score_claims(case, [far, right, wrong])
    (release,) = scored.releases
    assert (release.is_exact, release.is_partly, release.delay_s) == (False, True, 0.0)
    assert release.rate_ratio == pytest.approx(0.5)
    assert release.overlap_frac == pytest.approx((n - 30 + 11) / n)
    assert scored.false_claims == (far,)
    assert [len(day.claims) for day in scored.quiet_days] == [1]
    assert score_claims(case, [right]).releases[0].delay_s == 1800.0
    nothing = score_claims(case, []).releases[0]
    assert (nothing.outcome, nothing.overlap_frac, nothing.delay_s) == ("missed", 0.0, math.inf)


def test_claims_about_lasers_are_scored_by_the_source_that_was_open(yard):
    case = case_of(yard)
    site = dataclasses.replace(case.site, finds_events=False, places_m={})
    (release,) = case.releases
    releases = tuple(dataclasses.replace(release, place=None, source=i) for i in range(2))
    lasers = dataclasses.replace(case, site=site, releases=releases, within_m=3.0)
    x_m, y_m = PLACES_M["well"]
    near, far = (claim(case, 0, 1, position_m=(x_m + off_m, y_m), source=i) for i, off_m in ((1, 2.9), (0, 3.1)))
    assert {each.outcome for each in run.score_oracle(lasers).score.releases} == {"exact"}
    scored = score_claims(lasers, [near, far])
    assert [each.outcome for each in scored.releases] == ["touched", "exact"]
    assert scored.quiet_days == ()
    assert scored.false_claims == ()


def test_the_folder_of_results_is_that_of_a_suite(tmp_path, yard):
    names = ["leak_network", "nearest_sensor"]
    done = run_measured(yard, ResultsFolder(tmp_path / "results"), only=names)
    results = Results.load(done.folder)
    assert results.entries == ("leak_network", "nearest_sensor", "oracle")
    assert results.success("leak_network").value == results.success("oracle").value == 1.0
    assert results.select(is_control=True, entry="leak_network").trials["declared"].to_pylist() == [False]
    assert done.report is not None
    board = json.loads((done.folder / "leaderboard.json").read_text())
    assert {row["entry"] for row in board["views"][0]["rows"]} == {*names, "oracle"}
    assert "| our_yard | leak_network | 1 of 1" in done.page.read_text()
    assert (done.folder / "timeline-our_yard.png").stat().st_size > 5000
    events = json.loads((done.folder / "events.json").read_text())
    assert {event["place"] for event in events if event["entry"] == "leak_network"} == {"well"}


def test_rows_are_the_same_again(tmp_path, yard):
    only = ["source_term_estimation"]
    first, again = (run_measured(yard, ResultsFolder(tmp_path / name), only=only, has_report=False) for name in "ab")
    tables = [pq.read_table(done.folder / "trials.parquet") for done in (first, again)]
    kept = [name for name in tables[0].column_names if not name.startswith("wall_")]
    assert tables[0].select(kept).equals(tables[1].select(kept))


def test_an_entry_that_fails_leaves_the_others_alone(tmp_path, yard, monkeypatch):
    class Broken(estimators.HindsightEstimator):
        def claims(self, log):
            raise ValueError("no idea")

    broken = Entry(name="broken", title="", family="", build=Broken, can_take=lambda site: True)
    monkeypatch.setattr(run, "ENTRIES", (broken, NETWORK))
    done = run_measured(yard, ResultsFolder(tmp_path / "results"), only=["broken", "leak_network"], has_report=False)
    rows = Results.load(done.folder)
    assert set(rows.select(entry="broken").trials["outcome"].to_pylist()) == {"agent_failed"}
    assert set(rows.select(entry="broken").trials["agent_faults"].to_pylist()) == {"ValueError: no idea"}
    assert rows.success("leak_network").value == 1.0


def test_results_of_another_suite_are_not_written_over(tmp_path, yard):
    folder = ResultsFolder(tmp_path)
    folder.write_json(folder.manifest, {"suite": "smoke"})
    with pytest.raises(UsageError, match="was one of suite smoke"):
        run_measured(yard, folder)
