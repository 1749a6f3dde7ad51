"""Cases on the reference data: what they reach, which must not get lost."""

import pytest
from reference_data import MEASURED, needs_measured

from gslcosim_validation import read_measured
from gslcosim_validation.cases import load_case
from gslcosim_validation.measured_suite.estimators import ENTRIES
from gslcosim_validation.measured_suite.logs import load_log_cases
from gslcosim_validation.measured_suite.run import run_entry

pytestmark = needs_measured


def rows_of(case, folder, effort="full"):
    """Return the rows of a case on one reference set, by quantity."""
    result = load_case(case).run(read_measured(MEASURED / folder), effort)
    assert all(row.is_met is not False or row.if_missed for row in result.rows)
    return {row.quantity: row for row in result.rows}


def test_the_plume_from_measured_wind_meets_its_goals():
    judged = [row for row in rows_of("laser-forward", "chilbolton").values() if row.goal]
    assert len(judged) == 4
    assert all(row.is_met for row in judged)
    assert all(row.ours.low < row.ours.value < row.ours.high for row in judged)


def test_puffs_agree_with_masts_above_the_background_of_the_hour():
    rows = rows_of("network-forward", "metec")
    shares = {name.split(":")[0]: row for name, row in rows.items() if "FAC2" in name and "the hour" in name}
    assert set(shares) == {"largest mast", "paired"}
    assert all(row.is_met for row in shares.values())


def test_a_measured_record_is_scored_as_plumes_are():
    rows = rows_of("roof-tracer", "roof_tracer", "quick")
    assert rows["measured: share of the time above 20 ppm"].ours.value == pytest.approx(0.127, abs=0.03)
    assert rows["measured: exponent of blanks"].ours.value == pytest.approx(1.5, abs=0.3)


@pytest.mark.slow
def test_the_suite_of_logs_finds_the_leaks_of_masts():
    found = {
        case.name: run_entry(next(entry for entry in ENTRIES if entry.name == "leak_network"), case).score
        for name in ("metec", "stanford")
        for case in load_log_cases(read_measured(MEASURED / name))
    }
    assert sum(each.is_exact for each in found["metec"].releases) >= 7
    assert len(found["metec"].false_claims) <= 4
    assert sum(each.is_touched for each in found["stanford"].releases) >= 8
    assert len(found["stanford"].false_claims) <= 2


@pytest.mark.slow
def test_the_suite_of_logs_finds_the_leaks_of_lasers():
    (case,) = load_log_cases(read_measured(MEASURED / "chilbolton"))
    scored = run_entry(next(entry for entry in ENTRIES if entry.name == "leak_network"), case).score.releases
    assert [each.is_exact for each in scored] == [True, True]
    assert [each.rate_ratio for each in scored] == pytest.approx([1.0, 1.0], abs=0.06)
