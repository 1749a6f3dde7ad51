import pytest

from gslcosim.scenario import load_scenario
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim_services.sensing.briefing import find_method_problems


def problems_with(*overrides):
    """Return the lines about a bundled scenario with these overrides."""
    try:
        start = ("agents[0].start={python: surge_cast}",)
        load_scenario("tiny_room", overrides=(*start, *overrides), checks=(find_method_problems,))
    except InvalidScenarioError as error:
        return [str(problem) for problem in error.problems]
    return []


def test_a_bundled_scenario_has_what_its_method_needs():
    assert problems_with() == []


def test_an_argument_may_be_longer_than_the_name_of_a_file():
    assert problems_with(f"agents[0].start={{command: [python3, -c, {'x' * 300}]}}") == []


def test_a_missing_sensor_is_reported_before_the_run():
    (text,) = problems_with("agents[0].sensors=[{model: pid, name: nose}]")
    assert "agents[0].sensors: expected at least 1 of kind" in text


def test_an_unknown_parameter_is_reported_with_its_place():
    (text,) = problems_with("agents[0].parameters={wings: 2}")
    assert text.startswith("--set agents[0].parameters") or "agents[0].parameters" in text
    assert "expected a parameter of" in text


def test_a_knowledge_that_is_not_granted_is_reported():
    (text,) = problems_with("agents[0].start={python: oracle}")
    assert "source: true" in text


def test_other_problems_do_not_hide_those_of_methods():
    texts = problems_with("agents[0].parameters={wings: 2}", "gas.gas=etanol")
    assert any("wings" in text for text in texts)
    assert any("etanol" in text for text in texts)


@pytest.mark.parametrize("parameters", ["{Step: 1}", "{step: {a: 1}}", "{step: null}", "[1]"])
def test_parameters_are_names_with_scalars_or_lists(parameters):
    assert problems_with(f"agents[0].parameters={parameters}")


def test_a_file_that_a_parameter_names_is_looked_for(tmp_path):
    (text,) = problems_with("agents[0].start={python: learned}", "agents[0].parameters={policy: nowhere.npz}")
    assert "parameters.policy: expected a file, or a name without an ending, was 'nowhere.npz'" in text
    policy = tmp_path / "policy.npz"
    policy.touch()
    assert problems_with("agents[0].start={python: learned}", f"agents[0].parameters={{policy: {policy}}}") == []
    assert problems_with("agents[0].start={python: learned}", "agents[0].parameters={policy: tabular_q}") == []
