"""The study of what is lost from training to run runs, and its batch is what single runs are."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

STUDIES = Path(__file__).parents[4] / "docs" / "studies"


@pytest.fixture
def study(monkeypatch):
    """The script, beside which it imports."""
    monkeypatch.syspath_prepend(str(STUDIES))
    import training_to_flight

    yield training_to_flight
    sys.modules.pop("training_to_flight", None)


@pytest.mark.slow
def test_it_prints_every_agent_in_the_places_that_are_asked_for(study, monkeypatch, capsys):
    monkeypatch.setattr(
        sys,
        "argv",
        [
            "training_to_flight.py",
            "--n",
            "2",
            "--cases",
            "open_halls",
            "--places",
            "batch",
            "holonomic",
            "--agents",
            "recurrent_ppo",
        ],
    )
    study.main()
    output = capsys.readouterr().out
    assert "| open_halls | batch | `recurrent_ppo` | 2 |" in output
    for name in ("recurrent_ppo", *study.HAND_MADE):
        assert f"| open_halls | holonomic | `{name}` | 2 |" in output
    assert output.count("| open_halls | `recurrent_ppo` | batch | holonomic |") == 1
    assert "quadrotor" not in output


@pytest.mark.slow
def test_a_policy_does_in_the_batch_what_it_does_in_single_runs(study):
    """One search at a time: the last bits of products of matrices are others for many rows."""
    cases, flier = study.cases_of("open_halls", "batch", 3), study.learned_fliers()["recurrent_ppo"]
    alone = study.flown(cases, flier)
    stepped = [study.stepped([one], flier.policy) for one in cases]
    assert [bool(one.success[0]) for one in stepped] == alone.success.tolist()
    np.testing.assert_allclose([one.counted_s[0] for one in stepped], alone.counted_s, atol=1e-6)


def test_a_policy_runs_where_the_sensors_are_that_it_observes(study):
    case = study.cases_of("open_halls", "batch", 1)
    fliers = study.learned_fliers()
    assert study.can_fly(fliers["recurrent_ppo"], case)
    ranges = study.Flier(name="r", python="learned", policy=SimpleNamespace(observation_names=("ranges.closeness_0",)))
    assert not study.can_fly(ranges, case)
