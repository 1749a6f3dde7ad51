"""Variables that reach an agent: a short list, and what its scenario names."""

import sys

import pytest

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.runtime.processes.sandbox.selection import build_environment_variables
from gslcosim.scenario import load_scenario

AROUND = {
    "PATH": "/bin", "LANG": "C", "LC_ALL": "C", "TZ": "UTC", "HOME": "/root", "TMPDIR": "/tmp", "OMP_NUM_THREADS": "1",
    "PYTHONPATH": "/mine", "AWS_SECRET_ACCESS_KEY": "s", "GITHUB_TOKEN": "t", "SSH_AUTH_SOCK": "/x", "MINE": "m",
    "DBUS_SESSION_BUS_ADDRESS": "unix:", "GSLCOSIM_JOIN_of_another": "password", "LCD": "no language",
}  # fmt: skip
NEEDED = {"PATH", "LANG", "LC_ALL", "TZ", "HOME", "TMPDIR", "OMP_NUM_THREADS"}


def agent_with(environment):
    """Return the agent of a scenario with an environment, as YAML."""
    return load_scenario("tiny_room", overrides=[f"agents[0].environment={environment}"]).scenario.agents[0]


def test_only_what_every_program_needs_is_passed_on():
    """Python's own variables go to our Python, which finds its packages by them."""
    assert set(build_environment_variables(agent_with("{}"), ["./agent"], AROUND)) == NEEDED
    assert set(build_environment_variables(agent_with("{}"), [sys.executable, "a.py"], AROUND)) == NEEDED | {
        "PYTHONPATH"
    }


def test_a_scenario_adds_variables_with_its_own_values_or_passes_on_ours():
    found = build_environment_variables(agent_with("{MINE: , KEY: value, LANG: de}"), ["./agent"], AROUND)
    assert {name: found[name] for name in ("MINE", "KEY", "LANG")} == {"MINE": "m", "KEY": "value", "LANG": "de"}


def test_a_variable_without_a_value_that_is_not_set_is_an_error():
    with pytest.raises(UsageError, match=r"agents\.beetle\.environment\.GONE: expected a variable that is set"):
        build_environment_variables(agent_with("{GONE: }"), ["./agent"], AROUND)


@pytest.mark.parametrize("environment", ["{GSLCOSIM_TOKEN: x}", "{'a b': x}", "{A: 1}", '{A: "\\0"}', "{1A: x}", "[A]"])
def test_names_and_values_are_what_an_environment_can_hold(environment):
    with pytest.raises(ScenarioError, match=r"agents\[0\]\.environment.*: expected"):
        agent_with(environment)


def test_a_scenario_without_one_is_resolved_as_before():
    """Names of results are hashes of that text."""
    assert "environment" not in load_scenario("tiny_room").scenario.agents[0].model_dump(exclude_none=True)
