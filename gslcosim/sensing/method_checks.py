"""Whether the agents of a scenario have what their methods need, by the cards beside their programs."""

from collections.abc import Iterator
from pathlib import Path

from gslcosim.errors import MethodError
from gslcosim.methods.card import CARD_FILE, MethodCard, card_beside
from gslcosim.methods.needs import shortages_of
from gslcosim.scenario import Scenario
from gslcosim.scenario.bundled import bundled_agents
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.problems import Problem
from gslcosim.sensing.models import sensor_names
from gslcosim.sensing.table import descriptions_of


def problems_of_methods(scenario: Scenario, directory: Path) -> Iterator[Problem]:
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
            card = _card_of(host, directory)
        except MethodError as error:
            text, _, file = str(error).rpartition("\nFile: ")
            yield Problem(
                path=f"agents[{i}].start",
                expected=f"an agent with a right {CARD_FILE}",
                found="one whose card is not",
                remedy=f"{file}: {text.rstrip('.')}.",
            )
        if card is not None and all(sensor.model in sensor_names() for sensor in agent.sensors):
            yield from _problems(i, agent, card, scenario)


def _problems(i: int, agent: AgentSpec, card: MethodCard, scenario: Scenario) -> Iterator[Problem]:
    shortages = shortages_of(
        card,
        sensors=descriptions_of(agent, scenario),
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


def _card_of(agent: AgentSpec, directory: Path) -> MethodCard | None:
    for program in _programs(agent, directory):
        if program.is_file() and (card := card_beside(program)) is not None:
            return card
    return None


def _programs(agent: AgentSpec, directory: Path) -> Iterator[Path]:
    if agent.start.python is not None:
        yield directory / agent.start.python
        if (bundled := bundled_agents().get(agent.start.python)) is not None:
            yield bundled
    for word in agent.start.command or ():
        yield directory / word
