"""Search agent: evidence, belief, declaration and planner, over one machine of legs and stops."""

from abc import abstractmethod
from dataclasses import fields
from types import SimpleNamespace
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.agent_kit.commands import declaration
from gslcosim.agent_kit.settings import load_settings
from gslcosim.contract.messages import RadioMessage
from gslcosim_search import elementary
from gslcosim_search.beliefs import BeliefPublisher, CellGrid
from gslcosim_search.motion.deadline import DeadlineRule
from gslcosim_search.motion.declaration import DeclarationGuard, Estimate
from gslcosim_search.random_stream import RandomStream

Settings = TypeVar("Settings", bound=Any)


class SearchAgent(Agent):
    """An agent that goes by legs and decides at stops, in the order in which all search methods do so.

    1. evidence: `observe` takes note of every observation.
    2. leg: `continue_leg` answers as long as the last leg, or a wait at its end, is under way.
    3. belief: `learn` takes in what the stop has brought; `p` over the cells of `grid` is published with the answer.
    4. declaration: what `estimate` returns is declared, once for each place, and near the time limit what
       `deadline.DeadlineRule` finds in the belief; `declares: false` switches both off. Where that rule holds, nothing
       is declared before there was gas.
    5. planner: `next_leg` is the answer otherwise, with the radio messages of `outgoing`.

    A method is a subclass that fills in what it has of these; `next_leg` it must. Its `program` is its card that names
    it, or its `__file__` with the card beside it.

    State: the random stream of the method, when a belief was published, what was declared, and that of the deadline's
    rule.

    Held by:
        extensions/search/tests/unit/test_search_agent.py
    """

    program: ClassVar[str]
    grid: CellGrid

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        """Begin without anything declared.

        Args:
            briefing: The agent's briefing.
            settings: The method's settings; absent: by its card and the briefing.

        Raises:
            MethodError: the agent lacks something that its card asks for, or a parameter is wrong.
        """
        elementary.warm_up()
        self.settings = load_settings(briefing, self.program) if settings is None else settings
        self.draws = RandomStream(briefing.seed)
        self.height_m = briefing.search_height_m
        self.publisher, self.declared = BeliefPublisher(), DeclarationGuard()
        self.deadline = DeadlineRule.for_mission(briefing, self.settings)

    def observe(self, observation: Observation) -> None:
        """Take note of gas, for the rule of the deadline."""
        if self.deadline is not None:
            self.deadline.add(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the leg that goes on, or at a stop a declaration or the next leg."""
        self.observe(observation)
        command = self.continue_leg(observation)
        if command is not None:
            return command
        self.learn(observation)
        p = self.p
        belief = None if p is None else self.publisher.message(observation, p, self.grid, height_m=self.height_m)
        has_grounds = self.deadline is None or self.deadline.has_met_gas
        if has_grounds and getattr(self.settings, "declares", True):
            command = self.declare_late(observation)
            if command is None and (found := self.estimate(observation)) is not None:
                command = self.declare(observation, found)
        command = command or self.next_leg(observation)
        return command.model_copy(update={"belief": belief, "outgoing": self.outgoing(observation)})

    @property
    def p(self) -> NDArray[np.float64] | None:
        """The belief, in the shape of the grid; None of a method that has none."""
        return None

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while the last leg is under way; None at a stop, where a decision is due."""
        return None

    def learn(self, observation: Observation) -> None:
        """Take in what this stop has brought."""

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source, once the method's rule is satisfied."""
        return None

    def declare(self, observation: Observation, found: Estimate) -> Command | None:
        """Return the declaration of an estimate that is news, None for one that was declared."""
        passed = self.declared.passes(found)
        if passed is None:
            return None
        return declaration(observation, (*passed.position_m, self.height_m)[:3], passed.confidence)

    def declare_late(self, observation: Observation) -> Command | None:
        """Return the declaration of the belief's own estimate near the time limit, from wherever the vehicle is."""
        p = None if self.deadline is None else self.p
        if self.deadline is None or p is None:
            return None
        found = self.deadline.estimate(observation.time_s, p, self.grid)
        return None if found is None else SearchAgent.declare(self, observation, found)

    @abstractmethod
    def next_leg(self, observation: Observation) -> Command:
        """Return the command for the next leg."""

    def outgoing(self, observation: Observation) -> tuple[RadioMessage, ...]:
        """Return the messages to other robots that go with the command at a stop."""
        return ()


def extract_settings(kind: type[Settings], settings: object) -> Settings:
    """Return the part of a method's settings that a dataclass names; those that are missing keep their defaults."""
    return kind(**{each.name: getattr(settings, each.name) for each in fields(kind) if hasattr(settings, each.name)})
