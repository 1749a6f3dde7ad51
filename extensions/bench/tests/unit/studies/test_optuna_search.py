"""What is asked for depends on the seed and the scores told, and on nothing else."""

import builtins

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_bench.studies.target import ParameterRange
from gslcosim_bench.studies.tuning import OptunaSearch

RANGES = (
    ParameterRange(name="x", low=0.1, high=2.0),
    ParameterRange(name="n", low=1, high=8, is_whole=True),
    ParameterRange(name="f", low=0.01, high=100.0, is_log=True),
)


def score(values):
    return -((values["x"] - 0.7) ** 2) - 0.01 * abs(values["n"] - 5)


def searched(log, *, seed, batches):
    search = OptunaSearch(RANGES, seed=seed, log=log)
    asked = []
    for i, size in enumerate(batches):
        some = search.ask(size)
        asked += some
        search.tell([score(values) for values in some])
        if i == 0:
            search.add({"x": 1.0, "n": 4, "f": 1.0}, score({"x": 1.0, "n": 4}))
    return asked


@pytest.mark.extras
def test_equal_calls_ask_for_equal_settings(tmp_path):
    first = searched(tmp_path / "a.log", seed=3, batches=[4, 4, 4, 2])
    assert searched(tmp_path / "b.log", seed=3, batches=[4, 4, 4, 2]) == first
    assert searched(tmp_path / "a.log", seed=3, batches=[4, 4, 4, 2]) == first, "what is in the file does not matter"
    assert searched(tmp_path / "c.log", seed=4, batches=[4, 4, 4, 2]) != first


@pytest.mark.extras
def test_a_larger_budget_begins_with_what_a_smaller_one_asked_for(tmp_path):
    short = searched(tmp_path / "a.log", seed=3, batches=[4, 4, 3])
    assert searched(tmp_path / "b.log", seed=3, batches=[4, 4, 4, 4])[:11] == short


@pytest.mark.extras
def test_settings_are_within_their_ranges_and_short_to_write(tmp_path):
    for values in searched(tmp_path / "a.log", seed=1, batches=[4, 4, 4]):
        assert list(values) == ["x", "n", "f"]
        assert all(each.low <= values[each.name] <= each.high for each in RANGES)
        assert isinstance(values["n"], int)
        assert len(f"{values['x']!r}") <= 7


def test_without_optuna_one_sentence_says_what_to_install(tmp_path, monkeypatch, capsys):
    found = builtins.__import__

    def no_optuna(name, *args, **kwargs):
        if name.startswith("optuna"):
            raise ModuleNotFoundError(name)
        return found(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_optuna)
    with pytest.raises(UsageError, match=r"^tune: expected Optuna .* pip install 'gslcosim-bench\[tune\]'$"):
        OptunaSearch(RANGES, seed=0, log=tmp_path / "a.log")
    folder = tmp_path / "results"
    assert (
        main(["bench", "tune", "tiny_room", "--entry", "dung_beetle", "--budget", "12", "--results", str(folder)]) == 2
    )
    assert "pip install 'gslcosim-bench[tune]'" in capsys.readouterr().err
    assert not folder.exists()
