"""Learned parameters come back as they were written, and a wrong file is reported."""

import json
from types import SimpleNamespace

import pytest

from gslcosim.base.errors import MethodError
from gslcosim_search.learned.policy_files import (
    PARAMETERS_FILE,
    load_parameters,
    save_parameters,
    with_learned_parameters,
)

PARAMETERS = {"inertia": 0.271, "patience": 12}


def test_an_agent_gets_them_beside_its_settings(tmp_path):
    save_parameters(tmp_path, "dr_pso", PARAMETERS, {"seeds": [1], "command": "gslcosim train mine.yaml"})
    settings = with_learned_parameters(SimpleNamespace(near_m=1.5), str(tmp_path / "agent.py"))
    assert vars(settings) == {"near_m": 1.5, **PARAMETERS}
    card = json.loads((tmp_path / PARAMETERS_FILE).read_text())
    assert (card["method"], card["command"]) == ("dr_pso", "gslcosim train mine.yaml")


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"schema": "gslcosim/parameters/2", "parameters": {}}'])
def test_what_is_no_file_of_parameters_is_reported(tmp_path, text):
    (tmp_path / PARAMETERS_FILE).write_text(text)
    with pytest.raises(MethodError, match=r"parameters (that|of schema).*\nFile: .*parameters\.json"):
        load_parameters(tmp_path / PARAMETERS_FILE)


def test_a_file_that_is_not_there_is_reported(tmp_path):
    with pytest.raises(
        MethodError, match=r"expected a folder with parameters\.json, found none.*\nFile: .*parameters\.json"
    ):
        load_parameters(tmp_path / PARAMETERS_FILE)
