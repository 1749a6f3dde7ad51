"""Text of a recording: the task, a legend of the views, and in the end the result."""

from collections.abc import Mapping

from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.messages import AgentResult, Verdict
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario

# More agents than this are counted, not named.
MAX_NAMED = 3


def summary_text(
    scenario: Scenario,
    environment: Environment,
    verdict: Verdict | None = None,
    sandboxes: Mapping[str, str] | None = None,
) -> str:
    """Return the recording's text as Markdown; with a verdict it begins with the result, sandboxes are its end."""
    parts = [_result(scenario, verdict)] if verdict else []
    parts += [_mission(scenario, environment)]
    if sandboxes:
        parts.append("\n".join(f"- sandbox of {name}: {words}" for name, words in sandboxes.items()))
    return "\n\n".join(parts) + "\n"


def title(scenario: Scenario) -> str:
    """Return one line that says what is run."""
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


def legend_text(scenario: Scenario) -> str:
    """Return as Markdown what each element of the views is; only of those that a run of this scenario can have."""
    agents, success = scenario.agents, scenario.referee.success
    rows = [
        ("cloud", "filaments of gas, each drawn at its size; bright yellow is strong, violet weak"),
        ("map", "mixing ratio at search height, logarithmic, by the scale at its left; grey: solid there; "
                "grey edges: ends below"),
        ("blue arrows", "wind at search height; the longer the faster"),
        ("blue and violet frames", "inlets with their speed, and outlets; lines at the sides of the map"),
        ("red ball", "source" + ("; red lines around it: where success counts" if success.drawn_radius_m else "")),
        ("line", "track of a vehicle, in its colour"),
        ("small dots", "waypoints that it was sent to"),
        ("start, first gas", "where it took off, and where its nose first met gas" + (
            "; points in its colour, named when the mouse is over them" if len(agents) > 1 else "")),
    ]  # fmt: skip
    if any(agent.vehicle.avoidance != "none" for agent in agents):
        rows.append(("pale line", "path that it has planned around obstacles"))
    rows.append(("declared", "where an agent has declared the source"))
    rows.append(("orange point", "where a vehicle began to touch something; all touches are in Contacts"))
    rows.append(("Belief of …", "where an agent believes the source to be: white is most probable; only of agents that "
                                "publish beliefs"))  # fmt: skip
    if any(agent.sensors and any(hasattr(sensor, "max_range_m") for sensor in agent.sensors) for agent in agents):
        rows.append(("thin rays, points", "what range finders, lasers and lidars see"))
    if scenario.environment.doors:
        rows.append(("brown boxes", "doors, while they are closed"))
    if scenario.events:
        rows.append(("named points", "events of the scenario, where they happen"))
    if scenario.channels:
        rows.append(("Radio", "texts between agents and who heard them"))
    if any(agent.sensors for agent in agents):
        rows.append(("curves", "the true gas at a sensor, what it reports, and the wind speed at an anemometer, the "
                               "true one in grey; several vehicles in the colours of the distances"))  # fmt: skip
    rows.append(("Distance", "to the nearest source; in pale, where an agent publishes beliefs, the mean distance of "
                             "the places that it believes in"))  # fmt: skip
    rows.append(("Control error", "behind the tab of the distance: how far a vehicle is from where its controller "
                                  "wants it"))  # fmt: skip
    rows.append(("Decision time", "how long an agent took for each answer, by the machine's clock; not in a replay"))
    rows.append(("Faults", "what agents did wrong, at their tick: bad answers, late ones, ends of their processes"))
    rows.append(("Run", "the result, what is flown, and the sandbox that each agent flew in"))
    rows.append(("Referee", "what the referee noted; orange is a fault, a refusal or a collision"))
    scales = {agent.vehicle.model: agent.vehicle.facts.drawn_scale for agent in agents}
    larger = [f"{model} {scale:g} times its size" for model, scale in scales.items() if scale != 1]
    if larger:
        rows.append(("vehicles", f"drawn larger: {', '.join(larger)}"))
    return "\n".join(f"- **{what}**: {how}" for what, how in rows) + "\n"


def _result(scenario: Scenario, verdict: Verdict) -> str:
    time_s = seconds_from_ticks(verdict.tick, scenario.tick_ns)
    # Bold, as a heading would take the room of three lines on a small screen.
    heading = f"**{verdict.end_reason.replace('_', ' ').capitalize()} after {time_s:g} s**"
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
