"""Lasers' logs in which two sources were open at once, and beams and names that differ from the layout's."""

import dataclasses
import json

import numpy as np
import pytest
from laser_campaigns import write_lasers
from laser_minutes import INSTRUMENT_M, REFLECTORS_M, make_minutes

from gslcosim_search.fixed_sensors.laser_sources import find_sources
from gslcosim_validation import read_measured
from gslcosim_validation.cases.laser_source import match_places
from gslcosim_validation.laser_data import collect_laser_rows
from gslcosim_validation.measured_suite.logs import load_log_cases
from gslcosim_validation.measured_suite.run import score_oracle
from gslcosim_validation.measured_suite.scores import score_claims
from gslcosim_validation.readers.columns import MeasuredDataError
from gslcosim_validation.readers.laser_paths import LaserPaths, OpenSource

OTHER = OpenSource("other", (42.0, 30.0, 0.3), 2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("n_open", [1, 2])
def test_as_many_sources_are_found_as_were_open(n_open):
    minutes = make_minutes(beside=(OTHER,)[: n_open - 1])
    rows = collect_laser_rows(LaserPaths(instrument_m=INSTRUMENT_M, reflectors_m=REFLECTORS_M, sources=(minutes,)))
    found = find_sources(rows)
    assert len(found) == n_open
    truths = minutes.open_sources
    places_m, truths_m = np.array([each.position_m for each in found]), np.array([t.position_m[:2] for t in truths])
    for truth, j in zip(truths, match_places(places_m, truths_m), strict=True):
        assert np.hypot(*(np.array(found[j].position_m) - truth.position_m[:2])) < 1.0
        assert found[j].rate_kg_s == pytest.approx(truth.rate_kg_s, rel=0.2)
        assert not found[j].is_upper_bound


def test_each_place_stands_for_one_source():
    truths = np.array([[0.0, 0.0], [10.0, 0.0]])
    assert match_places(np.array([[9.0, 0.0], [1.0, 1.0]]), truths) == [1, 0]
    # The nearest pair first: the first source has what is left.
    assert match_places(np.array([[6.0, 0.0], [9.0, 0.0]]), truths) == [0, 1]
    assert match_places(np.array([[4.0, 0.0]]), truths) == [0, None]


def edit_layout(folder, change):
    layout = json.loads((folder / "layout.json").read_text())
    change(layout)
    (folder / "layout.json").write_text(json.dumps(layout))


def read_paths(folder):
    data = read_measured(folder)
    return data.read(data.sets[0], LaserPaths)


def test_a_layout_says_which_sources_were_open_together(tmp_path):
    folder = write_lasers(tmp_path / "field", "source_7")

    def rename(layout):
        truth = layout["sources"].pop("source_7")
        for name, x_m in (("valve", 30), ("flange", 50)):
            layout["sources"][name] = {**truth, "place_m": [x_m, 30, 0.3], "minutes": "source_7"}

    edit_layout(folder, rename)
    (minutes,) = read_paths(folder).sources
    assert [each.name for each in minutes.open_sources] == ["valve", "flange"]
    (case,) = load_log_cases(read_measured(folder))
    assert [(each.name, each.source) for each in case.releases] == [("valve", 0), ("flange", 0)]
    claims = score_oracle(case).score.claims
    assert [each.outcome for each in score_claims(case, claims[::-1]).releases] == ["exact", "exact"]
    # Two sources and one claim: it counts for the nearer one.
    scored = score_claims(case, claims[:1])
    assert [each.outcome for each in scored.releases] == ["exact", "missed"]
    more = score_claims(case, [*claims, dataclasses.replace(claims[0], position_m=(0.0, 0.0))])
    assert len(more.false_claims) == 1


def test_names_that_do_not_fit_are_told_with_what_to_do(tmp_path):
    folder = write_lasers(tmp_path / "field", "source_7")
    edit_layout(folder, lambda layout: layout["sources"].update(valve=layout["sources"].pop("source_7")))
    with pytest.raises(MeasuredDataError) as error:
        read_paths(folder)
    said = str(error.value).splitlines()[0]
    assert "expected source_7, of which minutes_source_7.csv has readings, was valve." in said
    assert said.endswith('where sources were open together, give each of them "minutes": "source_7".')


def test_beams_are_known_by_their_numbers(tmp_path):
    folder = write_lasers(tmp_path / "field")
    path = folder / "minutes_source_5.csv"
    path.write_text(path.read_text().replace("ch4_beam_2", "ch4_beam_9"))
    with pytest.raises(
        MeasuredDataError, match=r"expected beams with a reflector \(.*\), was ch4_beam_9_ppm\. Add its"
    ):
        read_paths(folder)
    edit_layout(folder, lambda layout: layout["reflectors_m"].update(reflector_9=[0, 0, 1.6]))
    paths = read_paths(folder)
    assert paths.reflectors_m[:, 0].tolist() == [60, 10, 0]
    # The beam of the second reflector has no column and read nothing.
    assert np.isfinite(paths.sources[0].beams_ppm).all(axis=0).tolist() == [True, False, True]
    path.write_text(path.read_text().replace("ch4_beam_1_ppm", "ch4_beam_1_ppb"))
    with pytest.raises(MeasuredDataError, match="Convert column ch4_beam_1_ppb"):
        read_paths(folder)
    edit_layout(folder, lambda layout: layout["reflectors_m"].update(north=[0, 0, 1.6]))
    with pytest.raises(MeasuredDataError, match=r"reflectors_m: expected names that end with _N, was north\."):
        read_paths(folder)
