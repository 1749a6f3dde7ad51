"""Learned agents: their files say how they are made again, and fit what makes them."""

import json

import pytest

from gslcosim.base.bundled import bundled_agents
from gslcosim.methods.card import find_card_beside
from gslcosim_search.learned.policy_agent import bundled_policies
from gslcosim_search.learned.policy_files import PARAMETERS_FILE, load_parameters, load_policy, read_policy_card

AGENTS = bundled_agents()["learned"].parents[1]
# The policy of `learned` was made by hand.
POLICIES = {name: path for name, path in bundled_policies(AGENTS).items() if name != "learned"}
SWARMS = ("evolved_pso", "evolved_pso_doped")


def card_of(name):
    if name in POLICIES:
        return read_policy_card(POLICIES[name])
    return json.loads(bundled_agents()[name].with_name(PARAMETERS_FILE).read_text())


@pytest.mark.parametrize("name", [*POLICIES, *SWARMS])
def test_a_card_shows_how_the_agent_is_made_again(name):
    card = card_of(name)
    assert {"data", "seeds", "budget", "training_time_s", "versions", "machine", "validation"} <= set(card)
    (*command, file) = card["command"].split()
    assert command == ["gslcosim", "train"]
    from gslcosim_training.train_file import load_train_file

    spec = load_train_file(file).spec
    assert card["trainer"] == json.loads(spec.trainer.model_dump_json())
    assert card["budget"]["round"] == card["trainer"].get("rounds", card["trainer"].get("settings", {}).get("rounds"))
    assert card["seeds"]["training"] == spec.seed
    assert card["seeds"]["cases"][1] - card["seeds"]["cases"][0] + 1 == spec.cases.training
    assert card["doping"] == (spec.doping is not False)
    if name in POLICIES:
        assert load_policy(POLICIES[name]).action == spec.action.settings


@pytest.mark.parametrize("name", SWARMS)
def test_evolved_parameters_are_those_of_s_pso_that_its_card_does_not_have(name):
    card, whole = (find_card_beside(bundled_agents()[one]) for one in (name, "s_pso"))
    parameters = load_parameters(bundled_agents()[name].with_name(PARAMETERS_FILE))
    assert set(parameters) == set(card_of(name)["trainer"]["ranges"])
    assert set(parameters) | set(card.parameters) == set(whole.parameters)
    assert not set(parameters) & set(card.parameters)
    assert all(whole.parameters[key].problem_of(value) is None for key, value in parameters.items())
    assert card.parameters == {key: whole.parameters[key] for key in card.parameters}
