"""The order in which every search agent decides: a leg under way, then belief, declaration, and the next leg."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from briefings import briefing, observation, task_of

from gslcosim.agent_kit import Command, RadioMessage
from gslcosim.agent_kit.commands import waypoint
from gslcosim.scenario.models.success import DeclarationSuccess
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion.declaration import Estimate
from gslcosim_search.search_agent import SearchAgent, extract_settings


class Searcher(SearchAgent):
    """Notes which of its parts was asked; the source is found at the third stop, and on the way at tick 1."""

    def __init__(self, mission=None, **settings) -> None:
        super().__init__(mission or briefing(), SimpleNamespace(**settings))
        self.grid = CellGrid((0.0, 0.0), 1.0, (2, 2))
        self.asked: list[str] = []
        self.n_stops = 0

    @property
    def p(self):
        return np.full((2, 2), 0.25)

    def observe(self, observation):
        self.asked.append("observe")

    def continue_leg(self, observation):
        return Command(tick=observation.tick, kind="noop") if observation.tick == 1 else None

    def learn(self, observation):
        self.asked.append("learn")
        self.n_stops += 1

    def estimate(self, observation):
        return Estimate(position_m=(3.0, 4.0), confidence=0.8) if self.n_stops > 2 else None

    def next_leg(self, observation):
        self.asked.append("next_leg")
        return waypoint(observation, 1.0, 2.0, 2.0)

    def outgoing(self, observation):
        return (RadioMessage(channel="radio", text=str(self.n_stops)),)


def test_a_leg_under_way_goes_on_before_anything_is_decided():
    agent = Searcher()
    command = agent.decide(observation(tick=1))
    assert (command.kind, command.belief, command.outgoing) == ("noop", None, ())
    assert agent.asked == ["observe"]


def test_at_a_stop_it_learns_then_goes_on_and_says_what_it_believes():
    agent = Searcher()
    command = agent.decide(observation(tick=10))
    assert agent.asked == ["observe", "learn", "next_leg"]
    assert command.position_world_m == (1.0, 2.0, 2.0)
    assert command.belief.probability.to_array().tolist() == [[0.25, 0.25], [0.25, 0.25]]
    assert command.outgoing[0].text == "1"


def test_what_is_found_is_declared_once_at_the_search_height():
    agent = Searcher()
    commands = [agent.decide(observation(tick=10 * i)) for i in range(1, 6)]
    assert [command.kind for command in commands] == ["waypoint", "waypoint", "declare_source", "waypoint", "waypoint"]
    assert commands[2].declaration.position_world_m == (3.0, 4.0, 2.0)
    assert commands[2].outgoing[0].text == "3"


def test_a_method_that_declares_nothing_goes_on():
    agent = Searcher(declares=False)
    assert {agent.decide(observation(tick=10 * i)).kind for i in range(1, 6)} == {"waypoint"}


@dataclass(frozen=True, kw_only=True)
class Part:
    """Two settings, one with a default."""

    margin_m: float
    step_m: float = 0.5


def test_a_part_of_settings_takes_its_own_and_keeps_defaults_of_the_rest():
    assert extract_settings(Part, SimpleNamespace(margin_m=2.0, other=1)) == Part(margin_m=2.0)
    assert extract_settings(Part, SimpleNamespace(margin_m=2.0, step_m=3.0)) == Part(margin_m=2.0, step_m=3.0)


class Believer(Searcher):
    """Believes in one cell, notes the gas that it meets, and has a rule of its own that never declares."""

    @property
    def p(self):
        return np.array([[0.7, 0.1], [0.1, 0.1]])

    def observe(self, observation):
        SearchAgent.observe(self, observation)

    def estimate(self, observation):
        return None


def test_near_the_time_limit_the_belief_is_declared_once_where_the_mission_asks_for_it():
    def kinds(**changes):
        one = Believer(
            mission=briefing(sensors=(("pid", "nose"), ("anemometer", "vane")), task=task_of(DeclarationSuccess())),
            **{"deadline": "by_mission", **changes},
        )
        seen = [
            observation(tick=tick, readings={"nose": 2.0, "vane": (0.5, 0.0)}).model_copy(update={"time_s": time_s})
            for tick, time_s in ((10, 100.0), (20, 269.0), (30, 271.0), (40, 280.0))
        ]
        return [one.decide(each).kind for each in seen]

    assert kinds() == ["waypoint", "waypoint", "declare_source", "waypoint"]
    assert set(kinds(deadline="never")) == set(kinds(declares=False)) == {"waypoint"}


def test_where_the_mission_asks_no_belief_is_declared_before_there_was_gas():
    class Sure(Believer):
        """Declares by a rule of its own at once."""

        def estimate(self, observation):
            return Estimate(position_m=(3.0, 4.0), confidence=0.8)

    def kinds(ppm, **settings):
        mission = briefing(sensors=(("pid", "nose"), ("anemometer", "vane")), task=task_of(DeclarationSuccess()))
        one = Sure(mission=mission, **settings)
        return [one.decide(observation(tick=10, readings={"nose": ppm, "vane": (0.5, 0.0)})).kind]

    assert kinds(2.0, deadline="by_mission") == ["declare_source"]
    assert kinds(0.2, deadline="by_mission") == ["waypoint"]
    assert kinds(0.2, deadline="never") == ["declare_source"]
