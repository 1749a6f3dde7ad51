"""The case of a known leak seen by lasers, on the reference data."""

import os
from pathlib import Path

import pytest

from gslcosim.validation import read_measured
from gslcosim.validation.cases import load_case
from gslcosim.validation.results import ignore_progress

REFERENCE = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[4] / "shared" / "reference"))
CHILBOLTON = REFERENCE / "measured" / "chilbolton"


@pytest.mark.skipif(not CHILBOLTON.is_dir(), reason=f"GSLCOSIM_REFERENCE: no measured data in {REFERENCE}")
def test_the_plume_from_measured_wind_meets_its_goals():
    result = load_case("laser-forward").run(read_measured(CHILBOLTON), "full", ignore_progress)
    judged = [row for row in result.rows if row.goal]
    assert len(judged) == 4
    assert all(row.is_met for row in judged)
    assert all(row.ours.low < row.ours.value < row.ours.high for row in judged)
