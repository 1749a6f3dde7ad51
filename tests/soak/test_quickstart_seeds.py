"""The quickstart with many seeds; `make soak` runs it and prints the figures."""

import statistics

import pytest

from gslcosim.base.rng import stream
from gslcosim.runtime.run import run_scenario
from gslcosim.scenario import load_scenario

N_SEEDS = 20


@pytest.mark.soak
def test_the_dung_beetle_finds_the_source_from_most_of_20_random_seeds(tmp_path, record_testsuite_property):
    seeds = stream(2026, "soak.quickstart").integers(2**31, size=N_SEEDS).tolist()
    results = []
    for seed in seeds:
        loaded = load_scenario("warehouse_empty", seed=seed, overrides=["recording.enabled=false"])
        results.append(run_scenario(loaded, runs_dir=tmp_path, processes="one").result)
    assert all(result["valid"] for result in results)
    assert len({result["digest"] for result in results}) == N_SEEDS
    times_s = [agent["time_to_source_s"] for result in results for agent in result["agents"] if agent["success"]]
    record_testsuite_property("successes", len(times_s))
    record_testsuite_property("median_time_to_source_s", statistics.median(times_s) if times_s else None)
    assert len(times_s) > N_SEEDS / 2, f"{len(times_s)} of {N_SEEDS} found it: {times_s}"
