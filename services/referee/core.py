"""Referee core: reads truth and commands, writes the score of every tick and one verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from gslcosim.base.errors import ModelError
from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    BodyState,
    Command,
    FieldSamples,
    MountSample,
    RefereeEvent,
    Score,
    Verdict,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.contract.record import build_unchecked_constructor
from gslcosim.environment.model import Environment
from gslcosim.environment.paths.scoring_paths import shortest_level_path_m, shortest_path_m
from gslcosim.environment.variants import DynamicEnvironment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import SourceMovesSpec
from gslcosim.scenario.models.scenario import find_due_events
from gslcosim.validity.conduct import CONDUCT_KEY
from gslcosim_services.referee.agent_evaluation import AgentEvaluation, EvaluationRules, Outcome, is_time_over
from gslcosim_services.referee.service import referee_spec

# The shortest way keeps this distance from solids: about the reach of an Iris with its propellers.
CLEARANCE_M = 0.35


_new_score = build_unchecked_constructor(Score)


@dataclass
class _RunEvaluation:
    """State of the evaluation of one run.

    `shortest_m` are the shortest ways from the starts to the sources, which are at `sources_m` now; `happened` are the
    scenario's events as `result.json`` lists them.
    """

    cases: list[AgentEvaluation]
    answers: dict[str, dict[int, Command]]
    sources_m: tuple[Vec3, ...]
    shortest_m: dict[str, float | None] = field(default_factory=dict[str, float | None])
    last_outcome: Outcome = "time_limit"
    is_over: bool = False
    happened: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    @classmethod
    def of(cls, names: Sequence[str], rules: EvaluationRules) -> "_RunEvaluation":
        """Return the score before the first tick."""
        return cls([AgentEvaluation(name, rules) for name in names], {name: {} for name in names}, rules.sources_m)


class RefereeCore:
    """Core that evaluates all agents of a run.

    Reads `truth/bodies`, `truth/samples` and every agent's commands (delay 0); writes `referee/score` every tick and
    `referee/verdict` once. A command counts at the tick at which it takes effect in the world (`latency_ticks` after
    the observation it answers), so that a slow agent's declaration is as late as its waypoints.

    The run ends at the first tick at which every agent has ended, or at which the simulated time reaches the limit;
    one agent's end does not end the others. The reason is `success` if any agent succeeded, otherwise that of the
    agent that ended last (of several in one tick: the last in the scenario).

    Where a scenario has events it reads `truth/events` of the last tick too: it reads each, and follows sources that
    move and doors. Distances are to where the sources are; in the result to where they were when the agent ended.

    Raises ModelError when the truth lacks an agent; the runtime then stops the run.
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        self._room = DynamicEnvironment(environment, scenario)
        self._limit_s = scenario.referee.stop.time_limit_s
        self._rules = _build_rules(scenario, environment)
        self._names = tuple(agent.name for agent in scenario.agents)
        self._drives = {agent.name: agent.vehicle.drives for agent in scenario.agents}
        self._heights_m = {agent.name: agent.vehicle.search_height_m for agent in scenario.agents}
        self._latency_ticks = {agent.name: agent.latency_ticks for agent in scenario.agents}
        self._free = {agent.name for agent in scenario.agents if agent.is_free}
        self.spec = referee_spec(scenario)
        self._scenario = scenario
        self._run = _RunEvaluation.of(self._names, self._rules)

    def reset(self, episode: Episode) -> Outbox:
        """Forget the last run; the referee draws no random numbers and writes nothing before tick 0."""
        del episode
        self._room.reset()
        self._run = _RunEvaluation.of(self._names, self._rules)
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Judge one tick; the score comes every tick, the verdict with the one that is final."""
        bodies = self._bodies(tick, inbox)
        if tick == 0:
            # Built here and not at the verdict: no process waits for the referee now, at the end all of them do.
            starts_m = {name: bodies[name].position_world_m for name in self._names}
            self._run.shortest_m = {name: self._shortest_path_m(name, at_m) for name, at_m in starts_m.items()}
        samples: dict[str, list[MountSample]] = {case.name: [] for case in self._run.cases}
        for sample in cast(FieldSamples, inbox[keys.SAMPLES]).samples:
            samples.setdefault(sample.agent, []).append(sample)
        events = self._obey_events(tick, inbox)
        for case in self._run.cases:
            events += self._judge(case, tick, bodies[case.name], samples[case.name], inbox)
        is_final = self._is_final(tick, events)
        score = _new_score(
            tick=tick,
            agents=tuple(case.score(bodies[case.name]) for case in self._run.cases),
            events=tuple(events),
            is_final=is_final,
        )
        if not is_final:
            return {keys.SCORE: score}
        self._run.is_over = True
        return {keys.SCORE: score, keys.VERDICT: self._verdict(tick)}

    def summary(self) -> dict[str, Any]:
        """Return the agents' conduct, and the scenario's events that have happened."""
        conduct = {case.name: case.conduct() for case in self._run.cases}
        events = {"events": self._run.happened} if self._scenario.events else {}
        return {CONDUCT_KEY: conduct, **events}

    # The sources of cases that are closed stay where they were then.
    def _obey_events(self, tick: int, inbox: Inbox) -> list[RefereeEvent]:
        marked: list[RefereeEvent] = []
        if self._room.obey(inbox):
            self._update_shortest_paths()
        for i, event in find_due_events(self._scenario, inbox):
            if isinstance(event, SourceMovesSpec):
                self._move_source(event.source, event.to_m)
            marked.append(RefereeEvent(agent=event.about_agent, kind="event", text=event.text))
            if not self._run.is_over:
                time_s = seconds_from_ticks(tick, self._rules.tick_ns)
                happened = {"event": i, "what": event.what, "tick": tick, "time_s": time_s, "text": event.text}
                self._run.happened.append({**happened, "agent": event.about_agent})
        return marked

    def _move_source(self, i_source: int, to_m: Vec3) -> None:
        run, gas = self._run, self._scenario.gas
        places_m = zip(gas.searched, run.sources_m, strict=True)
        run.sources_m = tuple(to_m if each is gas.sources[i_source] else at_m for each, at_m in places_m)
        for case in run.cases:
            if case.outcome is None:
                case.move_sources(run.sources_m)
        self._update_shortest_paths()

    # Of cases that are closed it is the way that there was then.
    def _update_shortest_paths(self) -> None:
        for case in self._run.cases:
            if case.outcome is None and (start_m := case.start_m) is not None:
                self._run.shortest_m[case.name] = self._shortest_path_m(case.name, start_m)

    def _bodies(self, tick: int, inbox: Inbox) -> dict[str, BodyState]:
        bodies = {body.agent: body for body in cast(BodyPoses, inbox[keys.BODIES]).bodies}
        for name in self._names:
            if name not in bodies:
                raise ModelError(f"referee, tick {tick}: expected a body for {name!r}, was {sorted(bodies)}.")
        return bodies

    def _judge(
        self, case: AgentEvaluation, tick: int, body: BodyState, samples: Sequence[MountSample], inbox: Inbox
    ) -> list[RefereeEvent]:
        if case.outcome is not None:
            return []
        events = case.observe(tick, body, samples, self._command_in_effect(case.name, tick, inbox))
        if case.outcome is not None:
            self._run.last_outcome = case.outcome
        return events

    def _command_in_effect(self, name: str, tick: int, inbox: Inbox) -> Command | None:
        answers = self._run.answers[name]
        answer = cast(Command | None, inbox.get(keys.command(name)))
        if answer is not None and not (name in self._free and _is_empty_noop(answer)):
            answers[tick + self._latency_ticks[name]] = answer
        return answers.pop(tick, None)

    # Appends the ends by time limit to the events of this tick.
    def _is_final(self, tick: int, events: list[RefereeEvent]) -> bool:
        if self._run.is_over:
            return False
        going_on = [case for case in self._run.cases if case.outcome is None]
        if going_on and is_time_over(tick, self._rules.tick_ns, self._limit_s):
            events += [case.end("time_limit") for case in going_on]
            self._run.last_outcome = "time_limit"
            return True
        return not going_on

    def _verdict(self, tick: int) -> Verdict:
        results = tuple(case.result(self._run.shortest_m[case.name]) for case in self._run.cases)
        has_success = any(result.success for result in results)
        return Verdict(tick=tick, end_reason="success" if has_success else self._run.last_outcome, agents=results)

    # To the source nearest by path, not through the air. Where a run ends at the success radius, so does the path: a
    # straight line could be shorter than the shortest path to the source itself. A rover cannot cross obstacles.
    def _shortest_path_m(self, name: str, start_m: Vec3) -> float | None:
        reach_m = self._rules.success.reach_m
        if reach_m is None:
            return None
        way_to = shortest_level_path_m if self._drives[name] else shortest_path_m
        # Where heights do not count, the shortest path leads to the height of the search.
        height_m = self._heights_m[name] if self._rules.success.is_horizontal else None
        lengths_m = (
            way_to(
                self._room.now,
                start_m,
                (x_m, y_m, z_m if height_m is None else height_m),
                clearance_m=CLEARANCE_M,
                within_m=reach_m,
            )
            for x_m, y_m, z_m in self._run.sources_m
        )
        return min((length_m for length_m in lengths_m if length_m is not None), default=None)


def _build_rules(scenario: Scenario, environment: Environment) -> EvaluationRules:
    return EvaluationRules(
        tick_ns=scenario.tick_ns,
        sources_m=tuple(source.position_m for source in scenario.gas.searched),
        success=scenario.referee.success,
        ends_on_collision=scenario.referee.stop.on_collision,
        floors=frozenset(box.name for box in environment.boxes if box.kind == "floor"),
        min_m=environment.grid.origin_m,
        max_m=environment.grid.max_m,
    )


# Command that the validator of an agent in free mode passes on where none has arrived.
def _is_empty_noop(command: Command) -> bool:
    return command.kind == "noop" and command.belief is None
