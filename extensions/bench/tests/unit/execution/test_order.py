"""The order in which trials are flown is drawn, and nothing that an entry is or does changes it."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from gslcosim_bench.cases.models import Trial
from gslcosim_bench.execution.runner import shuffle_trials

N_CASES, N_REPETITIONS = 6, 10


def make_trials(entry="beetle"):
    cases = [(case, repetition) for case in range(N_CASES) for repetition in range(N_REPETITIONS)]
    return [
        Trial(
            id=f"{entry}{i}", index=i, case=f"case_{case}", scenario="room", family="", varied="",
            repetition=repetition, entry=entry, is_control=False, scenario_json="{}", directory=Path(),
            room=f"room_{case}", tape=None, case_hash="",
        )
        for i, (case, repetition) in enumerate(cases)
    ]  # fmt: skip


def order_of(trials, seed=1):
    return [(trial.case, trial.repetition) for trial in shuffle_trials(trials, seed=seed)]


def test_a_repetition_rarely_follows_another_of_its_case():
    order = order_of(make_trials())
    assert sorted(order) == sorted(order_of(make_trials(), seed=2))
    n_alike = sum(before[0] == after[0] for before, after in pairwise(order))
    assert n_alike < 2 * len(order) / N_CASES
    repetitions = [repetition for case, repetition in order if case == "case_0"]
    assert repetitions != sorted(repetitions)


def test_the_order_is_the_suites_whoever_flies_it():
    trials = make_trials()
    assert order_of(trials) == order_of(make_trials("another"))
    assert order_of(trials) == order_of(trials[::-1])
    assert order_of(trials) == order_of([replace(trial, id="0", case_hash="f") for trial in trials])
    assert order_of(trials) != order_of(trials, seed=2)


def test_a_run_that_goes_on_keeps_the_order():
    order = order_of(make_trials())
    left = [trial for trial in make_trials() if (trial.case, trial.repetition) in order[17:]]
    assert order_of(left) == order[17:]
