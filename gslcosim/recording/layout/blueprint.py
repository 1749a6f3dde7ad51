"""The default layout of a recording in the viewer, so that a person understands the run without being told."""

from collections.abc import Sequence
from typing import Any

import rerun.blueprint as rrb

from gslcosim.environment.model import Environment
from gslcosim.recording import colors, entities
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import AgentEntities, entities_of
from gslcosim.recording.layout.eyes import eye_on_map, eye_on_room
from gslcosim.recording.layout.plots import cameras_in_flight, flight_plots, sensor_page
from gslcosim.recording.run_file import TICK_TIMELINE, TIME_TIMELINE
from gslcosim.recording.scene import floor_grid_m
from gslcosim.recording.summary import title
from gslcosim.scenario import Scenario

# How much higher pictures of cameras are than plots.
CAMERA_SHARE = 1.6
# The map shows one gas at its height, and nothing that would hide it.
_NOT_ON_MAP = (
    "+ /**",
    f"- /{entities.FILAMENTS}",
    f"- /{entities.SLICES}/**",
    f"- /{entities.SEEN}/**",
    f"- /{entities.BELIEFS}/**",
    "- /room/**",
    "- /plots/**",
)


def default_blueprint(scenario: Scenario, environment: Environment, *, believers: Sequence[str] = ()) -> rrb.Blueprint:
    """Return the layout: the room, the map at search height and the text left, cameras and curves right.

    Where vehicles have on-board sensors, each has a page of its own behind this one, with their pictures and curves.
    Panels are folded away and the time cursor stands at the end of the run, where the whole track is seen.

    Args:
        scenario: What is flown.
        environment: The room.
        believers: The agents that publish beliefs: each has a map of its own behind that of the gas.
    """
    agents = entities_of(scenario)
    flight = _flight_page(scenario, environment, agents, believers)
    pages = [page for agent in agents if (page := sensor_page(agent))]
    return rrb.Blueprint(
        rrb.Tabs(flight, *pages, active_tab=0) if pages else flight,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIME_TIMELINE, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _flight_page(
    scenario: Scenario, environment: Environment, agents: Sequence[AgentEntities], believers: Sequence[str]
) -> rrb.Horizontal:
    # Behind tabs, so that each has room for some lines on a small screen.
    logs = [_log_view(entities.EVENTS, "Referee"), _log_view(entities.CONTACTS, "Contacts")]
    if scenario.channels:
        logs.append(_log_view(entities.RADIO, "Radio"))
    logs.append(_log_view(entities.FAULTS, "Faults"))
    run = rrb.TextDocumentView(origin=entities.SUMMARY, name="Run")
    legend = rrb.TextDocumentView(origin=entities.LEGEND, name="Legend")
    texts = [rrb.Tabs(run, legend, active_tab=0), rrb.Tabs(*logs, active_tab=0)]
    believing = [agent for agent in agents if agent.agent.name in believers]
    n_maps = 2 if believing else 1
    maps: list[rrb.View | rrb.Tabs] = [_map_view(scenario, environment, agents, n_maps)]
    views = [_belief_view(environment, agents, agent) for agent in believing]
    if views:
        maps.append(rrb.Tabs(*views, active_tab=0) if len(views) > 1 else views[0])
    left = rrb.Vertical(
        _room_view(scenario, environment, agents),
        rrb.Horizontal(
            *maps,
            rrb.Vertical(*texts, row_shares=[1, 1]),
            column_shares=[1] * (len(maps) + 1),
        ),
        row_shares=[6, 5],
    )
    cameras, plots = cameras_in_flight(agents), flight_plots(scenario, agents, believing)
    shares = [*(CAMERA_SHARE for _ in cameras), *(1.0 for _ in plots)]
    right = rrb.Vertical(*cameras, *plots, row_shares=shares)
    return rrb.Horizontal(left, right, column_shares=[5, 2], name="Flight")


def _log_view(origin: str, name: str) -> rrb.TextLogView:
    columns = rrb.TextLogColumns(timeline_columns=[TIME_TIMELINE], text_log_columns=["Body"])
    return rrb.TextLogView(origin=origin, name=name, columns=columns)


def _room_view(scenario: Scenario, environment: Environment, agents: Sequence[AgentEntities]) -> rrb.Spatial3DView:
    eye_m, target_m = eye_on_room(environment)
    return rrb.Spatial3DView(
        origin="/",
        name=f"{title(scenario)} (floor grid {floor_grid_m(environment):g} m)",
        contents=["+ /**", "- /map/**", f"- /{entities.SLICES}/**", f"- /{entities.BELIEFS}/**", "- /plots/**"],
        background=colors.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye_m, look_target=target_m, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides=_histories(agents),
    )


def _map_view(
    scenario: Scenario, environment: Environment, agents: Sequence[AgentEntities], n_maps: int
) -> rrb.Spatial3DView:
    height_m = scenario.slice_height_m
    scale = GasScale.of(scenario)
    eye_m, target_m = eye_on_map(environment, height_m, n_views=n_maps)
    return rrb.Spatial3DView(
        origin="/",
        name=f"{scenario.gas.gas} at {height_m:.3g} m height, {scale.min_ppm:g} to {scale.max_ppm:g} ppm, and wind",
        contents=[*_NOT_ON_MAP, f"+ /{entities.SLICES}/{scenario.gas.gas}"],
        background=colors.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye_m,
            look_target=target_m,
            eye_up=(0.0, 1.0, 0.0),
        ),
        overrides=_histories(agents),
    )


def _belief_view(environment: Environment, agents: Sequence[AgentEntities], agent: AgentEntities) -> rrb.Spatial3DView:
    eye_m, target_m = eye_on_map(environment, agent.agent.vehicle.search_height_m, n_views=2)
    return rrb.Spatial3DView(
        origin="/",
        name=f"Belief of {agent.agent.name}",
        contents=[*_NOT_ON_MAP, "- /map/scale/**", f"- /{entities.WIND}", f"+ /{agent.belief}"],
        background=colors.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye_m, look_target=target_m, eye_up=(0.0, 1.0, 0.0)
        ),
        overrides=_histories(agents),
    )


# Tracks, plans, waypoints and markers stay: all rows up to the cursor are drawn, not only the last.
def _histories(agents: Sequence[AgentEntities]) -> dict[Any, Any]:
    history = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative(seq=0)
            )
            for timeline in (TIME_TIMELINE, TICK_TIMELINE)
        ]
    )
    return {path: [history] for agent in agents for path in (agent.track, agent.plan, agent.waypoints, agent.markers)}
