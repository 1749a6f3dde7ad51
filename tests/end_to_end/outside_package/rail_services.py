"""Services of another package that replace all of gslcosim's own: vehicles on rails in air without any gas."""

import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from gslcosim.contract import keys
from gslcosim.contract.messages import (
    AgentResult,
    AgentScore,
    BodyPoses,
    BodyState,
    Bounds,
    Briefing,
    FieldSamples,
    Message,
    Observation,
    Score,
    Verdict,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec, Read, Write
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.runtime.services import ServiceKind, get_block_service, list_service_names
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.participants import ServiceSpec

STEP_M = 0.1
N_TICKS = 60
Vec3 = tuple[float, float, float]


class RailWorld:
    """Moves each vehicle a step towards its waypoint in each tick. State: positions and waypoints."""

    def __init__(self, spec: ParticipantSpec, setup: RunSetup) -> None:
        self.spec = spec
        self._starts = {agent.name: agent.vehicle.start_m for agent in setup.scenario.agents}
        self._positions: dict[str, Vec3] = {}
        self._waypoints: dict[str, Vec3] = {}
        self._lengths_m: dict[str, float] = {}

    def reset(self, episode: Episode) -> Outbox:
        """Put all vehicles at their starts."""
        self._positions, self._waypoints = dict(self._starts), dict(self._starts)
        self._lengths_m = dict.fromkeys(self._starts, 0.0)
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Take waypoints from commands and move."""
        for agent in self._positions:
            sent = inbox.get(keys.command(agent))
            if sent is not None and sent.position_world_m is not None:
                self._waypoints[agent] = sent.position_world_m
        return {keys.BODIES: BodyPoses(tick=tick, bodies=tuple(map(self._moved, self._positions)))}

    def _moved(self, agent: str) -> BodyState:
        here, there = self._positions[agent], self._waypoints[agent]
        left_m = math.dist(here, there)
        share = 1.0 if left_m <= STEP_M else STEP_M / left_m
        self._positions[agent] = tuple(a + share * (b - a) for a, b in zip(here, there, strict=True))
        self._lengths_m[agent] += share * left_m
        return BodyState(
            agent=agent,
            position_world_m=self._positions[agent],
            quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            velocity_world_m_s=(0.0, 0.0, 0.0),
            angular_velocity_body_rad_s=(0.0, 0.0, 0.0),
            phase="driving",
            awaiting_command=share == 1.0,
            path_length_m=self._lengths_m[agent],
        )


class StillFields:
    """Clean air that does not move. State: none."""

    def __init__(self, spec: ParticipantSpec, setup: RunSetup) -> None:
        self.spec = spec

    def reset(self, episode: Episode) -> Outbox:
        """Do nothing."""
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Return no samples: no sensor is asked."""
        return {keys.SAMPLES: FieldSamples(tick=tick, samples=())}


class PoseSensing:
    """Tells agents their poses and nothing else. State: none."""

    def __init__(self, spec: ParticipantSpec, setup: RunSetup) -> None:
        self.spec, self._setup = spec, setup

    def reset(self, episode: Episode) -> Outbox:
        """Brief all agents."""
        return {keys.briefing(name): each for name, each in build_briefings(self._setup).items()}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Return the observation of each agent."""
        bodies = inbox[keys.BODIES].bodies
        return {keys.observation(body.agent): self._observation(tick, body) for body in bodies}

    def _observation(self, tick: int, body: BodyState) -> Observation:
        return Observation(
            tick=tick,
            agent=body.agent,
            time_s=tick * self._setup.scenario.tick_ns * 1e-9,
            position_world_m=body.position_world_m,
            yaw_rad=0.0,
            velocity_world_m_s=body.velocity_world_m_s,
            status=body.phase,
            awaiting_command=body.awaiting_command,
            readings=(),
        )


class TimeReferee:
    """Ends the run after some ticks. State: none."""

    def __init__(self, spec: ParticipantSpec, setup: RunSetup) -> None:
        self.spec = spec

    def reset(self, episode: Episode) -> Outbox:
        """Do nothing."""
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Return the score, and at the end the verdict."""
        bodies = inbox[keys.BODIES].bodies
        scores = tuple(
            AgentScore(agent=b.agent, distance_to_source_m=0.0, path_length_m=b.path_length_m, n_commands=0)
            for b in bodies
        )
        out: dict[str, Message] = {keys.SCORE: Score(tick=tick, agents=scores, is_final=tick == N_TICKS)}
        if tick == N_TICKS:
            results = tuple(self._result(body) for body in bodies)
            out[keys.VERDICT] = Verdict(tick=tick, end_reason="success", agents=results)
        return out

    def _result(self, body: BodyState) -> AgentResult:
        return AgentResult(
            name=body.agent,
            success=True,
            outcome="success",
            time_to_source_s=1.0,
            steps=1,
            path_length_m=body.path_length_m,
            straight_line_m=1.0,
            shortest_path_m=None,
            movement_overhead=None,
            directness=None,
            final_distance_m=0.0,
            declared_error_m=None,
        )


def build_briefings(setup: RunSetup) -> Mapping[str, Briefing]:
    """Return the briefing of each agent."""
    scenario, grid = setup.scenario, setup.environment.grid
    return {
        agent.name: Briefing(
            tick=0,
            agent=agent.name,
            contract_version="1.2",
            mission="Go where you like.",
            tick_ns=scenario.tick_ns,
            seed=1,
            mode="on_request",
            latency_ticks=1,
            gas="none",
            bounds=Bounds(min_m=tuple(map(float, grid.origin_m)), max_m=tuple(map(float, grid.max_m))),
            search_height_m=1.0,
            hold_s=0.0,
            time_limit_s=6.0,
            sensors=(),
            contract_hash=CONTRACT_HASH,
        )
        for agent in scenario.agents
    }


def _commands(scenario: Scenario, delay: int) -> tuple[Read, ...]:
    return tuple(Read(port=keys.command(agent.name), delay_ticks=delay) for agent in scenario.agents)


def world_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of the rails."""
    write = Write(port=keys.BODIES, message_type=BodyPoses)
    return ParticipantSpec(name="world", reads=_commands(scenario, 1), writes=(write,))


def fields_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of the air."""
    write = Write(port=keys.SAMPLES, message_type=FieldSamples)
    return ParticipantSpec(name="fields", reads=(Read(port=keys.BODIES),), writes=(write,))


def sensing_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of the poses that agents get."""
    writes = [Write(port=keys.observation(agent.name), message_type=Observation) for agent in scenario.agents]
    for agent in scenario.agents:
        briefing = Write(port=keys.briefing(agent.name), message_type=Briefing, announced_in="once")
        writes = [*writes, briefing]
    return ParticipantSpec(name="sensing", reads=(Read(port=keys.BODIES),), writes=tuple(writes))


def referee_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of the referee."""
    score = Write(port=keys.SCORE, message_type=Score)
    verdict = Write(port=keys.VERDICT, message_type=Verdict, announced_in=keys.SCORE)
    reads = (Read(port=keys.BODIES), *_commands(scenario, 0))
    return ParticipantSpec(name="referee", reads=reads, writes=(score, verdict))


class WorldBlock(ServiceSpec):
    """Vehicles on rails."""

    name: str = "world"


class FieldsBlock(ServiceSpec):
    """Clean air."""

    name: str = "fields"


class SensingBlock(ServiceSpec):
    """Poses."""

    name: str = "sensing"


class RefereeBlock(ServiceSpec):
    """The end after some ticks."""

    name: str = "referee"


def _registered(block, spec_of, core, **more):
    def kind(settings: ServiceSpec) -> ServiceKind:
        build = lambda setup: _noted(core, spec_of(setup.scenario), setup)  # noqa: E731
        return ServiceKind(name=settings.name, build_spec=spec_of, build=build, **more)

    get_block_service.register(block, kind)


# All services of the run, and what of gslcosim's own this process has loaded, for the test that none has.
def _noted(core, spec, setup):
    loaded = sorted(name for name in sys.modules if re.fullmatch(r"gslcosim_services\.\w+\.core", name))
    Path(setup.run_dir.path, f"loaded_by_{spec.name}.txt").write_text("\n".join(loaded))
    Path(setup.run_dir.path, "services.txt").write_text(" ".join(list_service_names(setup.scenario)))
    return core(spec, setup)


_registered(WorldBlock, world_spec, RailWorld)
_registered(FieldsBlock, fields_spec, StillFields)
_registered(SensingBlock, sensing_spec, PoseSensing, build_briefings=build_briefings)
_registered(RefereeBlock, referee_spec, TimeReferee, follows_agents=True)
