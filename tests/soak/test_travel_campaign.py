"""Random runs repeat: replayed, from snapshots and forked; four of each among the tests, 200 in the soak."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from travel_campaign import KINDS, campaign, table


@pytest.mark.slow
@pytest.mark.end_to_end
@pytest.mark.timeout(300)
@pytest.mark.parametrize("kind", KINDS)
def test_four_random_travels_are_equal(kind):
    trials = campaign(kind, 4, seed=2)
    assert [each for each in trials if not each.is_equal] == []


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_200_random_travels_are_equal(kind, capsys):
    trials = campaign(kind, 200, seed=1)
    with capsys.disabled():
        print(f"\n{table(trials)}")  # noqa: T201 - it is what the campaign is for
    assert [each for each in trials if not each.is_equal] == []
