"""What each agent is told before its first observation."""

from gslcosim.contract.messages import CONTRACT_VERSION, Bounds, Briefing, ChannelDescription
from gslcosim.contract.schema import contract_hash
from gslcosim.environment.model import Environment
from gslcosim.rng import stream
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.sensing.granted import map_for, nominal_plume
from gslcosim.sensing.table import descriptions_of

TIME_GOES_ON = " Time does not wait for answers: they take effect when they come."


def briefing_of(agent: AgentSpec, scenario: Scenario, environment: Environment, *, seed: int) -> Briefing:
    """Return an agent's briefing: task, room, limits, sensors, a seed of its own, and what it is granted to know.

    Args:
        agent: Whose briefing.
        scenario: The run's scenario.
        environment: The run's room; the agent learns its bounds, and the map only where it is granted.
        seed: The run's seed; the agent's own derives from it and does not reveal it.
    """
    grid = environment.grid
    return Briefing(
        tick=0,
        agent=agent.name,
        contract_version=CONTRACT_VERSION,
        mission=mission_text(scenario) + (TIME_GOES_ON if agent.is_free else ""),
        tick_ns=scenario.tick_ns,
        seed=_seed_of(agent, seed),
        # It is asked at its waypoints, too; the contract has no word for a question that nobody waits for.
        mode="on_request" if agent.mode_name == "free" else agent.mode_name,
        latency_ticks=agent.latency_ticks,
        gas=scenario.gas.gas,
        bounds=Bounds(min_m=_floats(grid.origin_m), max_m=_floats(grid.max_m)),
        search_height_m=agent.vehicle.search_height_m,
        hold_s=agent.vehicle.hold_s,
        time_limit_s=scenario.referee.stop.time_limit_s,
        sensors=descriptions_of(agent, scenario),
        contract_hash=contract_hash(),
        channels=_channels_of(agent, scenario),
        parameters=agent.parameters,
        known_map=map_for(agent, environment),
        plume=nominal_plume(scenario) if agent.knows.plume else None,
        known_sources=tuple(source.position_m for source in scenario.gas.sources) if agent.knows.source else (),
    )


def _seed_of(agent: AgentSpec, run_seed: int) -> int:
    return int(stream(run_seed, f"agent.{agent.name}").integers(2**31)) if agent.seed is None else agent.seed


def _channels_of(agent: AgentSpec, scenario: Scenario) -> tuple[ChannelDescription, ...]:
    return tuple(
        ChannelDescription(
            name=channel.name,
            members=scenario.members_of(channel),
            range_m=channel.range_m,
            delay_ticks=channel.delay_ticks,
            max_bytes=channel.max_bytes,
        )
        for channel in scenario.channels
        if agent.name in scenario.members_of(channel)
    )


def mission_text(scenario: Scenario) -> str:
    """Return the task in one sentence."""
    referee = scenario.referee
    return f"{referee.success.task_text(scenario.gas.gas)} in at most {referee.stop.time_limit_s:g} s."


def _floats(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))
