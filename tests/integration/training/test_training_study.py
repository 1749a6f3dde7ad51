"""The study of what is lost from training to flight runs, and its batch is what single flights are."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="extra gym")

STUDIES = Path(__file__).parents[3] / "docs" / "studies"


@pytest.fixture
def study(monkeypatch):
    """The script, beside which it imports."""
    monkeypatch.syspath_prepend(str(STUDIES))
    import training_to_flight

    yield training_to_flight
    sys.modules.pop("training_to_flight", None)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_it_prints_every_agent_in_the_places_that_are_asked_for(study, monkeypatch, capsys):
    monkeypatch.setattr(
        sys,
        "argv",
        ["training_to_flight.py", "--n", "2", "--places", "batch", "holonomic", "--agents", "recurrent_ppo"],
    )
    study.main()
    told = capsys.readouterr().out
    assert "| batch | `recurrent_ppo` | 2 |" in told
    for name in ("recurrent_ppo", *study.HAND_MADE):
        assert f"| holonomic | `{name}` | 2 |" in told
    assert told.count("| `recurrent_ppo` | batch | holonomic |") == 1
    assert "quadrotor" not in told


@pytest.mark.slow
def test_a_policy_does_in_the_batch_what_it_does_in_single_flights(study):
    """One search at a time: the last bits of products of matrices are others for many rows."""
    cases = study.cases_of("batch", 3)
    policy = study.load_policy(study.bundled_policies(study.bundled_agents()["learned"].parents[1])["recurrent_ppo"])
    alone = study.flown(cases, "recurrent_ppo")
    stepped = [study.stepped([one], policy) for one in cases]
    assert [bool(one.success[0]) for one in stepped] == alone.success.tolist()
    np.testing.assert_allclose([one.counted_s[0] for one in stepped], alone.counted_s, atol=1e-6)
