"""Checks that the agents of a scenario have what their methods need, by the method cards beside their programs."""

from collections.abc import Iterator
from pathlib import Path

from gslcosim.base.errors import MethodError
from gslcosim.methods.card import CARD_FILE, MethodCard, find_card_beside
from gslcosim.methods.needs import find_unmet_needs
from gslcosim.scenario import Scenario
from gslcosim.scenario.bundled import bundled_agents
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.problems import Problem
from gslcosim_services.sensing.models import sensor_names
from gslcosim_services.sensing.sensor_descriptions import describe_sensors


def find_method_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield what keeps the methods of a scenario from flying; agents without a card are passed over.

    Args:
        scenario: What is to be flown.
        directory: The scenario's folder, where relative paths of agents start.
    """
    by_name = {agent.name: agent for agent in scenario.agents}
    for i, agent in enumerate(scenario.agents):
        host = by_name.get(agent.process, agent)
        card = None
        try:
            card = _find_card(host, directory)
        except MethodError as error:
            text, _, file = str(error).rpartition("\nFile: ")
            yield Problem(
                path=f"agents[{i}].start",
                expected=f"an agent with a right {CARD_FILE}",
                found="one whose card is not",
                remedy=f"{file}: {text.rstrip('.')}.",
            )
        if card is not None and all(sensor.model in sensor_names() for sensor in agent.sensors):
            yield from _find_problems(i, agent, card, scenario)


def _find_problems(i: int, agent: AgentSpec, card: MethodCard, scenario: Scenario) -> Iterator[Problem]:
    shortages = find_unmet_needs(
        card,
        sensors=describe_sensors(agent, scenario),
        knows=agent.knows.granted,
        n_channels=sum(agent.name in scenario.members_of(channel) for channel in scenario.channels),
        parameters=agent.parameters,
    )
    for shortage in shortages:
        yield Problem(
            path=f"agents[{i}].{shortage.part}",
            expected=shortage.expected,
            found=shortage.found,
            remedy=shortage.remedy,
        )


def _find_card(agent: AgentSpec, directory: Path) -> MethodCard | None:
    for program in _list_programs(agent, directory):
        if program.is_file() and (card := find_card_beside(program)) is not None:
            return card
    return None


def _list_programs(agent: AgentSpec, directory: Path) -> Iterator[Path]:
    if agent.start.python is not None:
        yield directory / agent.start.python
        if (bundled := bundled_agents().get(agent.start.python)) is not None:
            yield bundled
    for word in agent.start.command or ():
        yield directory / word
