"""Curves and pictures of the layout: what is plotted together, under which title."""

import math
from collections.abc import Sequence

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
# A legend of more curves would cover them on a small screen; they have the colours of their vehicles.
MAX_CURVES_WITH_LEGEND = 4
# Where a legend covers least: gas is met late, what metal oxides report falls then, and distances begin far away.
_LEGEND_OF_GAS = rrb.Corner2D.LeftTop
_LEGEND_OF_FALLING = rrb.Corner2D.LeftBottom
_FALLING_UNIT = "ohm"
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
        plots.append(
            _plot(
                entities.GAS_PLOTS, f"True {what} at the sensor [ppm]", _of_one_color(n_curves, agents), _LEGEND_OF_GAS
            )
        )
        plots.append(_together(responses))
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
        return [*plots, _together([distance, *belief, *behind])]
    return [*plots, *belief, _together([distance, *behind])]


# What is looked at first is in front.
def _together(plots: Sequence[rrb.TimeSeriesView]) -> rrb.TimeSeriesView | rrb.Tabs:
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
def _of_one_color(n_curves: int, agents: Sequence[AgentEntities]) -> int:
    return 0 if n_curves <= len(agents) else n_curves


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
def _response_plots(scenario: Scenario, agents: Sequence[AgentEntities]) -> list[rrb.TimeSeriesView]:
    members: dict[str, list[tuple[str, str]]] = {}
    for agent in agents:
        for sensor in agent.gas_sensors:
            members.setdefault(unit_of(sensor, scenario), []).append((sensor.model, agent.response(sensor.name)))
    plots = []
    for unit, drawn in members.items():
        models = dict.fromkeys(_shown_model(model) for model, _ in drawn)
        title = with_unit(f"Reading of {', '.join(models)}", unit)
        contents = [f"+ /{entity}" for _, entity in drawn]
        corner = _LEGEND_OF_FALLING if unit == _FALLING_UNIT else _LEGEND_OF_GAS
        n_curves = _of_one_color(len(drawn), agents)
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
