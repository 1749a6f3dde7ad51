"""Agents whose program is a class that their card names."""

import re
import sys

import pytest

from gslcosim.agent_kit import Agent
from gslcosim.agent_kit.card_agent import load_card_agent
from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim.runtime.agents.loader import build_program_command, load_python_agent
from gslcosim.scenario.loader import load_scenario

CARD = "schema: gslcosim/method/1\ntitle: Mine\nfamily: reactive\nsummary: Waits.\npaper: none\n"
MODULE = """from gslcosim.agent_kit import Agent, Command

class Waiting(Agent):
    def __init__(self, briefing): ...

    def decide(self, observation):
        return Command(tick=observation.tick, kind="hold")
"""


@pytest.fixture
def write_card(tmp_path, monkeypatch):
    """Write a card in a folder of its own, beside a package path that has the module `waiting_agent`."""
    (tmp_path / "waiting_agent.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "waiting_agent", raising=False)

    def write(program):
        folder = tmp_path / "mine"
        folder.mkdir()
        (folder / "method.yaml").write_text(CARD + (f"program: {program}\n" if program else ""))
        return folder / "method.yaml"

    return write


def test_a_card_is_an_agent_of_the_class_it_names(write_card):
    card = write_card("waiting_agent:Waiting")
    agent_type = load_python_agent(card)
    assert issubclass(agent_type, Agent)
    assert (agent_type.__name__, agent_type.program) == ("Waiting", str(card))
    assert build_program_command(card)[-3:] == ["-m", "gslcosim.agent_kit.card_agent", str(card)]


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (None, "expected module:Class in a card that is started, was missing"),
        ("no_such_module:Waiting", "expected an agent that can be imported, got ModuleNotFoundError"),
        ("waiting_agent:Missing", "expected an agent that can be imported, got AttributeError"),
        ("math:pi", "expected a class of gslcosim.agent_kit.Agent, was math:pi"),
        ("gslcosim.agent_kit:Agent", "expected a class of gslcosim.agent_kit.Agent"),
    ],
)
def test_a_program_that_is_no_agent_is_refused_with_its_card(write_card, program, words):
    card = write_card(program)
    with pytest.raises(UsageError, match=re.escape(words)) as caught:
        load_card_agent(card)
    assert str(card) in str(caught.value)


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (None, "agents[0].start.python: expected a card that names a program, was 'mine/method.yaml'."),
        ("waiting_agent", "the method card is wrong: program: string should match pattern"),
    ],
)
def test_a_card_that_cannot_be_started_is_a_problem_of_the_scenario(write_card, program, words, tmp_path, capsys):
    write_card(program)
    file = tmp_path / "hall.yaml"
    file.write_text(load_scenario("tiny_room").text.replace("{python: dung_beetle}", r"{python: mine/method.yaml}"))
    assert main(["validate", str(file)]) == 2
    assert words in capsys.readouterr().err
