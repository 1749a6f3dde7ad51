"""The recording's text: what is flown, how to read the picture, and in the end the result."""

from gslcosim.contract.messages import AgentResult, Verdict
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.ticks import seconds_from_ticks

# More agents than this are counted, not named.
MAX_NAMED = 3


def summary_text(scenario: Scenario, environment: Environment, verdict: Verdict | None = None) -> str:
    """Return the recording's text as Markdown; with a verdict it begins with the result."""
    parts = [_result(scenario, verdict)] if verdict else []
    parts += [_mission(scenario, environment), _key(scenario)]
    return "\n\n".join(parts) + "\n"


def title(scenario: Scenario) -> str:
    """Return one line that says what is flown."""
    names = [agent.name for agent in scenario.agents]
    who = " and ".join(names) if len(names) <= MAX_NAMED else f"{len(names)} agents"
    return f"{scenario.name}: {who} searching for {scenario.gas.gas}"


def _mission(scenario: Scenario, environment: Environment) -> str:
    size_m = [high - low for low, high in zip(environment.grid.origin_m, environment.grid.max_m, strict=True)]
    stop, success = scenario.referee.stop, scenario.referee.success
    lines = [f"**{scenario.name}**, seed {scenario.seed}, room {' x '.join(f'{s:.4g}' for s in size_m)} m", ""]
    lines += [
        f"- {scenario.gas.gas} leaks at {_point(source.position_m)}: {source.filaments_per_s:g} filaments/s "
        f"of {source.ppm:g} ppm, for {scenario.gas.warm_up_s:g} s before the start"
        for source in scenario.gas.sources
    ]
    lines += [
        f"- {agent.name}: {agent.vehicle.model} from {_point(agent.vehicle.start_m)}, searching at "
        f"{agent.vehicle.search_height_m:.3g} m height"
        for agent in scenario.agents
    ]
    lines.append(f"- success: {success.summary_text} in {stop.time_limit_s:g} s")
    return "\n".join(lines)


def _key(scenario: Scenario) -> str:
    scales = {agent.vehicle.model: agent.vehicle.facts.drawn_scale for agent in scenario.agents}
    larger = [f"{model} {scale:g} times its size" for model, scale in scales.items() if scale != 1]
    told = f" Drawn larger: {', '.join(larger)}." if larger else ""
    avoids = any(agent.vehicle.avoidance != "none" for agent in scenario.agents)
    planned = "; pale line: planned path" if avoids else ""
    return (
        "Cloud: filaments of gas, each drawn at its size. Map: mixing ratio at search height on a logarithmic scale. "
        f"Blue arrows: wind. Line: track{planned}; dots: waypoints.{told}"
    )


def _result(scenario: Scenario, verdict: Verdict) -> str:
    time_s = seconds_from_ticks(verdict.tick, scenario.tick_ns)
    heading = f"### {verdict.end_reason.replace('_', ' ').capitalize()} after {time_s:g} s"
    return "\n".join([heading, "", *(_figures(result) for result in verdict.agents)])


def _figures(result: AgentResult) -> str:
    shortest = "" if result.shortest_path_m is None else f" (shortest way {result.shortest_path_m:.1f} m)"
    commands = "1 command" if result.steps == 1 else f"{result.steps} commands"
    return (
        f"- **{result.name}**: {result.outcome.replace('_', ' ')}, {commands}, "
        f"{result.path_length_m:.1f} m flown{shortest}, ends {result.final_distance_m:.2f} m from the source"
    )


def _point(position_m: tuple[float, float, float]) -> str:
    return f"({', '.join(f'{c:g}' for c in position_m)}) m"
