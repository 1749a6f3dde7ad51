"""Checks of where vehicles start, before anything moves."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Sequence

import mujoco

from gslcosim.errors import ScenarioError
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.physics.scene import Scene

# What may touch at the start: vehicles stand on what is below them [m].
_TOUCHES_WITHIN_M = 1e-3


def check_starts(
    agents: Sequence[AgentSpec], spaces: Sequence[FlightSpace], starts: Sequence[tuple[Vec3, bool]]
) -> None:
    """Check that vehicles start and rise in free places and apart from one another.

    Args:
        agents: All agents.
        spaces: Where each agent's vehicle may be sent.
        starts: Where each starts, world frame [m], and whether it hovers there.

    Raises:
        ScenarioError: all problems in one.
    """
    problems: list[str | None] = []
    for i, (agent, space, (start_m, is_flying)) in enumerate(zip(agents, spaces, starts, strict=True)):
        name = f"agents.{agent.name}.vehicle"
        problems.append(space.start_refusal(f"{name}.start_m", start_m))
        problems.append(_problem_of_height(name, agent, space, start_m, is_flying=is_flying))
        for other, other_space, (other_m, _) in list(zip(agents, spaces, starts, strict=True))[:i]:
            apart_m, needed_m = math.dist(start_m, other_m), space.radius_m + other_space.radius_m
            if apart_m < needed_m:
                problems.append(
                    f"{name}.start_m: expected at least {needed_m:g} m from {other.name}'s vehicle, was {apart_m:g} m."
                )
    if any(problems):
        raise ScenarioError("\n".join(problem for problem in problems if problem))


def check_overlaps(scene: Scene, data: mujoco.MjData, agents: Sequence[AgentSpec]) -> None:
    """Check that no vehicle at its start reaches into a box or another vehicle.

    Args:
        scene: The compiled scene.
        data: Its state, with contacts, all vehicles at their starts.
        agents: All agents.

    Raises:
        ScenarioError: all problems in one.
    """
    problems = []
    for i, (geom_a, geom_b) in enumerate(data.contact.geom.tolist()):
        depth_m = -float(data.contact.dist[i])
        for geom, other in ((geom_a, geom_b), (geom_b, geom_a)):
            if depth_m > _TOUCHES_WITHIN_M and scene.agent_of_geom[geom] >= 0:
                problems.append(
                    f"agents.{agents[scene.agent_of_geom[geom]].name}.vehicle.start_m: expected a start that touches "
                    f"nothing but what it stands on, was {depth_m:.3f} m inside {scene.thing_of_geom[other]}."
                )
    if problems:
        raise ScenarioError("\n".join(dict.fromkeys(problems)))


def _problem_of_height(
    name: str, agent: AgentSpec, space: FlightSpace, start_m: Vec3, *, is_flying: bool
) -> str | None:
    x_m, y_m, z_m = start_m
    if space.ground_height_m is None:
        return space.refusal(f"{name}.search_height_m", (x_m, y_m, agent.vehicle.search_height_m))
    if is_flying:
        return f"{name}.start_m: expected a start on the floor for a {agent.vehicle.model}, was {z_m:g} m high."
    return None
