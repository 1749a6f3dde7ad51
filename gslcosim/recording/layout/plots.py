"""Curves and pictures of the layout: what is plotted together, under which title."""

import math
from collections.abc import Iterable, Sequence

import rerun as rr
import rerun.blueprint as rrb

from gslcosim.recording import entities
from gslcosim.recording.entities import AgentEntities, gases_in
from gslcosim.recording.instruments import unit_of, with_unit
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.onboard import DepthCameraSpec
from gslcosim.scenario.models.scenario import SensorSpec

# The curves end a little after the cursor, so that their last points are seen.
LOOK_AHEAD_S = 3.0
# So many cameras are seen beside the flight at once; more of them share one place.
MAX_CAMERAS_IN_A_ROW = 3
MAX_GRID_COLUMNS = 4
# A legend of more curves would cover them; they have the colours of their vehicles.
MAX_CURVES_WITH_LEGEND = 6
# Models that people write in capital letters.
_ACRONYMS = ("tgs", "pid", "tdlas")


def flight_plots(
    scenario: Scenario, agents: Sequence[AgentEntities], believing: Sequence[AgentEntities] = ()
) -> list[rrb.TimeSeriesView | rrb.Tabs]:
    """Return the plots beside the flight, those of gas, wind and beliefs where there are some."""
    plots: list[rrb.TimeSeriesView | rrb.Tabs] = []
    responses = _response_plots(scenario, agents)
    if responses:
        gases = gases_in(scenario)
        what = gases[0] if len(gases) == 1 else "gas"
        n_curves = len(gases) * sum(len(agent.gas_sensors) for agent in agents)
        plots.append(_plot(entities.GAS_PLOTS, f"True {what} at the sensor [ppm]", n_curves))
        plots.append(responses[0] if len(responses) == 1 else rrb.Tabs(*responses, active_tab=0))
    n_vanes = sum(len(agent.wind_sensors) for agent in agents)
    if n_vanes:
        plots.append(_plot(entities.WIND_PLOTS, "Wind speed at the vehicle [m/s]", 2 * n_vanes))
    if believing:
        within_m = scenario.referee.success.within_m
        plots.append(_plot(entities.BELIEF_PLOTS, f"Belief within {within_m:g} m of the source [1]", len(believing)))
    if scenario.has_driven_wind or scenario.curve_ports:
        plots.append(_plot(entities.SERVICE_PLOTS, "Services", MAX_CURVES_WITH_LEGEND))
    plots.append(_plot(entities.DISTANCE_PLOTS, "Distance to the source [m]", len(agents) + len(believing)))
    plots.append(_plot(entities.TRACKING_PLOTS, "Control error: distance to the reference [m]", len(agents)))
    return plots


def camera_views(agents: Sequence[AgentEntities], *, with_agent: bool) -> list[rrb.Spatial2DView]:
    """Return a view for each camera, named after it, and after its agent where asked."""
    return [
        rrb.Spatial2DView(
            origin=f"/{agent.seen(camera.name)}",
            name=f"{agent.agent.name}: {_shown_camera(camera)}" if with_agent else _shown_camera(camera),
        )
        for agent in agents
        for camera in agent.cameras
    ]


def cameras_in_flight(agents: Sequence[AgentEntities]) -> list[rrb.Horizontal | rrb.Tabs]:
    """Return the place of the cameras beside the flight, if there are any."""
    views = camera_views(agents, with_agent=len(agents) > 1)
    if not views:
        return []
    in_a_row = len(views) <= MAX_CAMERAS_IN_A_ROW
    return [rrb.Horizontal(*views) if in_a_row else rrb.Tabs(*views, active_tab=0)]


def sensor_page(agent: AgentEntities) -> rrb.Grid | None:
    """Return the pictures and curves of an agent's on-board sensors, if it has any."""
    plots = [
        _plot(
            agent.on_board(sensor.name, curves),
            with_unit(f"{sensor.name}: {curves.quantity}", curves.unit),
            len(curves.labels),
        )
        for sensor, drawn in agent.on_board_sensors
        for curves in drawn
    ]
    views = [*camera_views([agent], with_agent=False), *plots]
    if not views:
        return None
    columns = min(MAX_GRID_COLUMNS, math.ceil(math.sqrt(len(views))))
    return rrb.Grid(*views, grid_columns=columns, name=f"Sensors of {agent.agent.name}")


# Readings of one unit share a plot.
def _response_plots(scenario: Scenario, agents: Iterable[AgentEntities]) -> list[rrb.TimeSeriesView]:
    members: dict[str, list[tuple[str, str]]] = {}
    for agent in agents:
        for sensor in agent.gas_sensors:
            members.setdefault(unit_of(sensor, scenario), []).append((sensor.model, agent.response(sensor.name)))
    plots = []
    for unit, drawn in members.items():
        models = dict.fromkeys(_shown_model(model) for model, _ in drawn)
        title = with_unit(f"Reading of {', '.join(models)}", unit)
        contents = [f"+ /{entity}" for _, entity in drawn]
        plots.append(_plot(entities.RESPONSE_PLOTS, title, len(drawn), contents=contents))
    return plots


def _shown_model(model: str) -> str:
    return model.upper() if model.startswith(_ACRONYMS) else model.replace("_", " ")


def _shown_camera(sensor: SensorSpec) -> str:
    return f"{sensor.name} (0 to {sensor.max_range_m:g} m)" if isinstance(sensor, DepthCameraSpec) else sensor.name


def _plot(origin: str, name: str, n_curves: int, *, contents: Sequence[str] = ("$origin/**",)) -> rrb.TimeSeriesView:
    so_far = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=0.0),
        end=rr.TimeRangeBoundary.cursor_relative(seconds=LOOK_AHEAD_S),
    )
    return rrb.TimeSeriesView(
        origin=origin,
        contents=contents,
        name=name,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=n_curves <= MAX_CURVES_WITH_LEGEND),
        axis_x=rrb.TimeAxis(view_range=so_far),
    )
