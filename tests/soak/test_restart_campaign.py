"""A run of which services are killed at random ticks is the run itself."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from restart_campaign import campaign, table


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_two_hundred_kills_change_no_digest(capsys):
    trials = campaign(200, seed=1)
    with capsys.disabled():
        print(f"\n{table(trials)}")  # noqa: T201 - it is what the campaign is for
    assert [trial for trial in trials if not trial.is_equal] == []
    assert sum(trial.is_restarted for trial in trials) > 100
