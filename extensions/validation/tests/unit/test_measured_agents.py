"""Agents on logs: what they are shown, how their answers become claims, and what they cannot see."""

import json
from pathlib import Path

import pytest
from mast_campaigns import PLACES_M

from gslcosim.base.errors import UsageError
from gslcosim.runtime.processes.sandbox.selection import find_strongest_sandbox
from gslcosim_bench.results import Results
from gslcosim_bench.store import ResultsFolder
from gslcosim_validation import read_measured
from gslcosim_validation.measured_suite.agents import find_agent_entries
from gslcosim_validation.measured_suite.logs import load_log_cases
from gslcosim_validation.measured_suite.run import choose_entries, run_entry, run_measured

# Goes by what it is shown alone: the place of its largest reading, a little upwind of it.
AGENT = """
import math
from gslcosim.agent_kit import Agent, run
from gslcosim.contract.messages import Command, Declaration


class Largest(Agent):
    def __init__(self, briefing):
        self.end_s = briefing.parameters.get("declares_after_s", math.inf)
        self.best = (0.0, briefing.bounds.min_m)
        {more}

    def decide(self, observation):
        ppm, (speed_m_s, upwind_rad) = (observation.reading(name).values for name in ("nose", "wind"))
        x_m, y_m, z_m = observation.position_world_m
        place_m = (x_m + 25.0 * math.cos(upwind_rad), y_m + 25.0 * math.sin(upwind_rad), z_m)
        self.best = max(self.best, (ppm[0], place_m))
        if observation.time_s < self.end_s:
            return Command(tick=observation.tick, kind="hold")
        declared = Declaration(position_world_m=self.best[1])
        return Command(tick=observation.tick, kind="declare_source", declaration=declared)


if __name__ == "__main__":
    run(Largest)
"""
EXAMPLE = Path(__file__).parents[4] / "docs" / "examples" / "leak_alarm" / "agent.py"
SUITE = """
schema: gslcosim/suite/1
name: ours
scenarios: [warehouse_empty]
entries:
  - {name: largest, start: {python: largest.py}, parameters: {declares_after_s: 5400.0}}
"""


def write_suite(folder, more=""):
    folder.mkdir()
    (folder / "largest.py").write_text(AGENT.replace("{more}", more))
    (folder / "suite.yaml").write_text(SUITE)
    return folder / "suite.yaml"


def find_entry(name, yard, *agents):
    (entry,) = choose_entries([name], agents, yard)
    return entry


def run_on(entry, yard):
    (case,) = load_log_cases(read_measured(yard))
    return run_entry(entry, case)


@pytest.mark.parametrize("name", ["kernel_dmv", "source_map"])
def test_beliefs_of_bundled_agents_become_claims(yard, name):
    result = run_on(find_entry(name, yard, name), yard)
    assert not result.fault
    (scored,) = result.score.releases
    assert scored.is_touched
    assert {claim.place for claim in scored.claims} <= set(PLACES_M)
    again = run_on(find_entry(name, yard, name), yard)
    assert again.score.claims == result.score.claims


def test_default_agents_take_part_and_keep_names_of_estimators_free(yard):
    (case,) = load_log_cases(read_measured(yard))
    entries = choose_entries([], ["source_term_estimation", "particle_filter"], yard)
    names = [entry.name for entry in entries if entry.can_take(case.site)]
    assert {"leak_network", "source_term_estimation", "source_term_estimation_agent", "pmfs"} <= set(names)
    assert len(set(names)) == len(names)


@pytest.mark.slow
def test_an_agent_of_a_user_runs_in_a_process_of_its_own_and_is_scored(yard, tmp_path):
    suite = write_suite(tmp_path / "ours")
    done = run_measured(yard, ResultsFolder(tmp_path / "out"), only=["largest"], agents=[str(suite)], has_report=False)
    rows = Results.load(done.folder).select(entry="largest", is_control=False).trials
    assert rows["declared"].to_pylist() == [True]
    assert rows["agent_faults"].to_pylist() == [""]
    assert rows["sandbox"].to_pylist()[0] != "none: in this process"
    manifest = json.loads((done.folder / "manifest.json").read_text())
    assert manifest["entries"][0]["parameters"] == {"declares_after_s": 5400.0}


@pytest.mark.slow
@pytest.mark.skipif(find_strongest_sandbox() == "none", reason="this machine has no sandbox")
def test_an_agent_in_a_sandbox_does_not_see_the_data(yard, tmp_path):
    look = f"assert not __import__('os').path.exists({str(yard / 'releases.csv')!r}), 'saw the truth'"
    suite = write_suite(tmp_path / "ours", look)
    result = run_on(find_entry("largest", yard, str(suite)), yard)
    assert result.fault == ""
    assert result.score.releases[0].is_touched


@pytest.mark.slow
def test_the_leak_alarm_declares_the_place_while_the_log_goes_on(yard):
    result = run_on(find_entry("leak_alarm", yard, str(EXAMPLE)), yard)
    assert result.fault == ""
    (scored,) = result.score.releases
    assert scored.outcome == "exact"
    assert scored.rate_ratio == pytest.approx(1.0, abs=0.3)
    assert result.score.false_claims == ()


@pytest.mark.slow
def test_an_agent_that_fails_says_why(yard, tmp_path):
    suite = write_suite(tmp_path / "ours", "raise ValueError('no idea')")
    result = run_on(find_entry("largest", yard, str(suite)), yard)
    assert "no idea" in result.fault
    assert result.score.claims == ()


@pytest.mark.parametrize(
    ("word", "sentence"),
    [
        ("sourcemap", "--agents sourcemap: expected a bundled agent, a Python file, or a suite"),
        ("oracle", "oracle needs to know the source"),
        ("vision_prior", "needs a sensor that logs do not have (camera)"),
        ("sniffy_squad", "sniffy_squad needs a radio"),
    ],
)
def test_agents_that_cannot_replay_a_log_are_refused(yard, word, sentence):
    with pytest.raises(UsageError) as raised:
        find_agent_entries([word], yard, taken=[], is_chosen=lambda name: True)
    assert sentence in str(raised.value)


def test_two_entries_of_one_name_are_refused(yard, tmp_path):
    (tmp_path / "leak_network.py").write_text(AGENT)
    with pytest.raises(UsageError, match="was leak_network twice"):
        choose_entries([], [str(tmp_path / "leak_network.py")], yard)
