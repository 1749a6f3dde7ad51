"""The study of what is lost from training to run runs, and its batch is what single runs are."""

import sys
from pathlib import Path

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
    words = "--n 2 --cases open_halls --places batch holonomic --agents recurrent_ppo"
    monkeypatch.setattr(sys, "argv", ["training_to_flight.py", *words.split()])
    study.main()
    output = capsys.readouterr().out
    assert "| open_halls | batch | `recurrent_ppo` | 2 |" in output
    for name in ("recurrent_ppo", *study.HAND_MADE):
        assert f"| open_halls | holonomic | `{name}` | 2 |" in output
    assert output.count("| open_halls | `recurrent_ppo` | batch | holonomic |") == 1
    assert "quadrotor" not in output
