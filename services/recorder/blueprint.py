"""Default layout of a recording in the viewer: panels, views, plots and cameras."""

import math
from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.onboard_sensors import DepthCameraSpec
from gslcosim.scenario.models.scenario import SensorSpec
from gslcosim_services.recorder import colors, entities
from gslcosim_services.recorder.camera_pose import fit_map_camera, fit_room_camera
from gslcosim_services.recorder.colors import GasScale
from gslcosim_services.recorder.entities import AgentEntities, build_entities, get_unit, label_with_unit, list_gas_names
from gslcosim_services.recorder.recording_file import TICK_TIMELINE, TIME_TIMELINE
from gslcosim_services.recorder.scene import floor_grid_m
from gslcosim_services.recorder.summary import title

# The curves end a little after the cursor, so that their last points are seen.
LOOK_AHEAD_S = 3.0
# So many cameras are seen beside the run at once; more of them share one place.
MAX_CAMERAS_IN_A_ROW = 3
MAX_GRID_COLUMNS = 4
# A legend of more curves would cover them on a small screen; they have the colours of their vehicles.
MAX_CURVES_WITH_LEGEND = 4
# Where a legend covers least: gas is met late, what metal oxides report falls then, and distances begin far away.
_LEGEND_OF_GAS = rrb.Corner2D.LeftTop
_LEGEND_OF_FALLING = rrb.Corner2D.LeftBottom
_FALLING_UNIT = "ohm"
# Models that people write in capital letters.
_ACRONYMS = ("tgs", "pid", "tdlas")


def build_run_plots(
    scenario: Scenario, agents: Sequence[AgentEntities], believing: Sequence[AgentEntities] = ()
) -> list[rrb.TimeSeriesView | rrb.Tabs]:
    """Return the plots beside the run, those of gas, wind and beliefs where there are some."""
    plots: list[rrb.TimeSeriesView | rrb.Tabs] = []
    responses = _response_plots(scenario, agents)
    if responses:
        gases = list_gas_names(scenario)
        what = gases[0] if len(gases) == 1 else "gas"
        n_curves = len(gases) * sum(len(agent.gas_sensors) for agent in agents)
        plots.append(
            _plot(
                entities.GAS_PLOTS, f"True {what} at the sensor [ppm]", _has_one_color(n_curves, agents), _LEGEND_OF_GAS
            )
        )
        plots.append(_group(responses))
    if any(agent.wind_sensors for agent in agents):
        # Without a legend: what is measured is noisy everywhere.
        plots.append(_plot(entities.WIND_PLOTS, "Wind speed [m/s], true in grey", 0))
    distance, belief = _distance_plot(agents, believing), _belief_plots(scenario, believing)
    behind = [
        _plot(entities.TRACKING_PLOTS, "Control error [m]", 0),
        _plot(entities.DECISION_PLOTS, "Decision time [ms]", 0),
    ]
    if scenario.has_driven_wind or scenario.curve_ports:
        plots.append(_plot(entities.SERVICE_PLOTS, "Services", MAX_CURVES_WITH_LEGEND))
    if any(agent.cameras for agent in agents):
        # Pictures take the room of a plot.
        return [*plots, _group([distance, *belief, *behind])]
    return [*plots, *belief, _group([distance, *behind])]


# What is looked at first is in front.
def _group(plots: Sequence[rrb.TimeSeriesView]) -> rrb.TimeSeriesView | rrb.Tabs:
    return plots[0] if len(plots) == 1 else rrb.Tabs(*plots, active_tab=0)


def _distance_plot(agents: Sequence[AgentEntities], believing: Sequence[AgentEntities]) -> rrb.TimeSeriesView:
    pale = ", by belief in pale" if believing else ""
    return _plot(entities.DISTANCE_PLOTS, f"Distance [m]{pale}", len(agents), _LEGEND_OF_FALLING)


def _belief_plots(scenario: Scenario, believing: Sequence[AgentEntities]) -> list[rrb.TimeSeriesView]:
    if not believing:
        return []
    name = f"Belief within {scenario.referee.success.within_m:g} m of the source [1]"
    return [_plot(entities.BELIEF_PLOTS, name, len(believing), _LEGEND_OF_GAS)]


# Several vehicles with one curve each have their colours, which the legend of the distances tells.
def _has_one_color(n_curves: int, agents: Sequence[AgentEntities]) -> int:
    return 0 if n_curves <= len(agents) else n_curves


def build_camera_views(agents: Sequence[AgentEntities], *, with_agent: bool) -> list[rrb.Spatial2DView]:
    """Return a view for each camera, named after it, and after its agent where asked."""
    return [
        rrb.Spatial2DView(
            origin=f"/{agent.seen(camera.name)}",
            name=f"{agent.agent.name}: {_shown_camera(camera)}" if with_agent else _shown_camera(camera),
        )
        for agent in agents
        for camera in agent.cameras
    ]


def build_camera_panel(agents: Sequence[AgentEntities]) -> list[rrb.Horizontal | rrb.Tabs]:
    """Return the place of the cameras beside the run, if there are any."""
    views = build_camera_views(agents, with_agent=len(agents) > 1)
    if not views:
        return []
    in_a_row = len(views) <= MAX_CAMERAS_IN_A_ROW
    return [rrb.Horizontal(*views) if in_a_row else rrb.Tabs(*views, active_tab=0)]


def build_sensor_page(agent: AgentEntities) -> rrb.Grid | None:
    """Return the pictures and curves of an agent's on-board sensors, if it has any."""
    plots = [
        _plot(
            agent.on_board(sensor.name, curves),
            label_with_unit(f"{sensor.name}: {curves.quantity}", curves.unit),
            len(curves.labels),
        )
        for sensor, drawn in agent.on_board_sensors
        for curves in drawn
    ]
    views = [*build_camera_views([agent], with_agent=False), *plots]
    if not views:
        return None
    columns = min(MAX_GRID_COLUMNS, math.ceil(math.sqrt(len(views))))
    return rrb.Grid(*views, grid_columns=columns, name=f"Sensors of {agent.agent.name}")


# Readings of one unit share a plot.
def _response_plots(scenario: Scenario, agents: Sequence[AgentEntities]) -> list[rrb.TimeSeriesView]:
    members: dict[str, list[tuple[str, str]]] = {}
    for agent in agents:
        for sensor in agent.gas_sensors:
            members.setdefault(get_unit(sensor, scenario), []).append((sensor.model, agent.response(sensor.name)))
    plots = []
    for unit, drawn in members.items():
        models = dict.fromkeys(_shown_model(model) for model, _ in drawn)
        title = label_with_unit(f"Reading of {', '.join(models)}", unit)
        contents = [f"+ /{entity}" for _, entity in drawn]
        corner = _LEGEND_OF_FALLING if unit == _FALLING_UNIT else _LEGEND_OF_GAS
        n_curves = _has_one_color(len(drawn), agents)
        plots.append(_plot(entities.RESPONSE_PLOTS, title, n_curves, corner, contents=contents))
    return plots


def _shown_model(model: str) -> str:
    return model.upper() if model.startswith(_ACRONYMS) else model.replace("_", " ")


def _shown_camera(sensor: SensorSpec) -> str:
    return f"{sensor.name} (0 to {sensor.max_range_m:g} m)" if isinstance(sensor, DepthCameraSpec) else sensor.name


# One curve needs no legend beside its title.
def _plot(
    origin: str,
    name: str,
    n_curves: int,
    corner: rrb.Corner2D = rrb.Corner2D.RightTop,
    *,
    contents: Sequence[str] = ("$origin/**",),
) -> rrb.TimeSeriesView:
    so_far = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=0.0),
        end=rr.TimeRangeBoundary.cursor_relative(seconds=LOOK_AHEAD_S),
    )
    return rrb.TimeSeriesView(
        origin=origin,
        contents=contents,
        name=name,
        plot_legend=rrb.PlotLegend(corner, visible=1 < n_curves <= MAX_CURVES_WITH_LEGEND),
        axis_x=rrb.TimeAxis(view_range=so_far),
    )


# How much higher pictures of cameras are than plots.
CAMERA_WEIGHT = 1.6
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
        scenario: What is run.
        environment: The room.
        believers: The agents that publish beliefs: each has a map of its own behind that of the gas.
    """
    agents = build_entities(scenario)
    flight = _run_page(scenario, environment, agents, believers)
    pages = [page for agent in agents if (page := build_sensor_page(agent))]
    return rrb.Blueprint(
        rrb.Tabs(flight, *pages, active_tab=0) if pages else flight,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIME_TIMELINE, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _run_page(
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
    cameras, plots = build_camera_panel(agents), build_run_plots(scenario, agents, believing)
    shares = [*(CAMERA_WEIGHT for _ in cameras), *(1.0 for _ in plots)]
    right = rrb.Vertical(*cameras, *plots, row_shares=shares)
    return rrb.Horizontal(left, right, column_shares=[5, 2], name="Flight")


def _log_view(origin: str, name: str) -> rrb.TextLogView:
    columns = rrb.TextLogColumns(timeline_columns=[TIME_TIMELINE], text_log_columns=["Body"])
    return rrb.TextLogView(origin=origin, name=name, columns=columns)


def _room_view(scenario: Scenario, environment: Environment, agents: Sequence[AgentEntities]) -> rrb.Spatial3DView:
    eye_m, target_m = fit_room_camera(environment)
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
    eye_m, target_m = fit_map_camera(environment, height_m, n_views=n_maps)
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
    eye_m, target_m = fit_map_camera(environment, agent.agent.vehicle.search_height_m, n_views=2)
    return rrb.Spatial3DView(
        origin="/",
        name=f"Belief of {agent.agent.name}",
        contents=[*_NOT_ON_MAP, "- /map/scale/**", f"- /{entities.WIND_ARROWS}", f"+ /{agent.belief}"],
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
