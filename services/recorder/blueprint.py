"""Default layout of a recording in the viewer: panels, views, plots, cameras and the text of its summary."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.messages import AgentResult, Verdict
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import SensorSpec
from gslcosim.scenario.models.sensors import DepthCameraSpec
from gslcosim_services.recorder import colors
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.colors import GasScale
from gslcosim_services.recorder.entities import AgentEntities, build_entities, get_unit, label_with_unit, list_gas_names
from gslcosim_services.recorder.recording_file import TICK_TIMELINE, TIME_TIMELINE
from gslcosim_services.recorder.scene import floor_grid_m
from gslcosim_services.recorder.stream_table import Stream

# Direction of the eye from the room's middle: somewhat west of south and above, the inlet's side in front.
CAMERA_AZIMUTH_RAD = math.radians(-114.0)
CAMERA_ELEVATION_RAD = math.radians(31.0)
# The viewer's vertical field of view, measured in pictures of it, and the shapes of the views in a 16:10 window.
FIELD_OF_VIEW_RAD = math.radians(55.0)
ROOM_VIEW_ASPECT = 1.95
MAP_VIEW_ASPECT = 1.4
# Room for the colour scale west of the map, and margins, in fractions of the side.
MAP_SCALE_FRAC = 0.3
MAP_MARGIN_FRAC = 0.09
ROOM_MARGIN_FRAC = 0.02

# More agents than this are counted, not named.
MAX_NAMED = 3
# The curves end a little after the cursor, so that their last points are seen.
LOOK_AHEAD_S = 3.0
# Number of cameras beside the run at once; more of them are tabs of one panel.
MAX_CAMERAS_IN_A_ROW = 3
MAX_GRID_COLUMNS = 4
# A legend of more curves would cover them on a small screen; they have the colours of their vehicles.
MAX_CURVES_WITH_LEGEND = 4
# Corners in which a legend covers least: gas comes late, responses of metal oxides fall then, distances begin large.
_LEGEND_OF_GAS = rrb.Corner2D.LeftTop
_LEGEND_OF_FALLING = rrb.Corner2D.LeftBottom
_FALLING_UNIT = "ohm"
# Models that people write in capital letters.
_ACRONYMS = ("tgs", "pid", "tdlas")
# Height of pictures of cameras over that of plots.
CAMERA_WEIGHT = 1.6
# The map shows one gas at its height, and nothing that would hide it.
_NOT_ON_MAP = (
    "+ /**",
    f"- /{streams.FILAMENTS.root}",
    f"- /{streams.SLICES.root}/**",
    f"- /{streams.POINT_CLOUDS.root}/**",
    f"- /{streams.BELIEF.root}/**",
    "- /room/**",
    "- /plots/**",
)


def fit_room_camera(environment: Environment) -> tuple[Vec3, Vec3]:
    """Return eye and target [m] of the nearest camera that has all corners of the room, walls included, in view.

    For a corner c seen along the fixed directions right, up and backward, |c.up - t_up| <= h (d - c.backward) must hold
    with h the tangent of half the field of view, t the target and d the eye's distance (likewise for right with the
    view's aspect). With A = max(c.up + h c.backward) and B = max(-c.up + h c.backward) the smallest d is
    (A + B) / (2 h), at t_up = (A - B) / 2 (our derivation).
    """
    corners_m = np.array(list(itertools.product(*zip(*_extent_m(environment), strict=True))))
    level = math.cos(CAMERA_ELEVATION_RAD)
    backward = np.array(
        [level * math.cos(CAMERA_AZIMUTH_RAD), level * math.sin(CAMERA_AZIMUTH_RAD), math.sin(CAMERA_ELEVATION_RAD)]
    )
    right = np.array([-math.sin(CAMERA_AZIMUTH_RAD), math.cos(CAMERA_AZIMUTH_RAD), 0.0])
    up = np.cross(backward, right)
    half_height = math.tan(FIELD_OF_VIEW_RAD / 2)
    distances_m, offsets_m = [], []
    for direction, h in ((right, half_height * ROOM_VIEW_ASPECT), (up, half_height)):
        across_m, towards_m = corners_m @ direction, h * (corners_m @ backward)
        a_m, b_m = float(np.max(across_m + towards_m)), float(np.max(-across_m + towards_m))
        distances_m.append((a_m + b_m) / (2 * h))
        offsets_m.append((a_m - b_m) / 2)
    # Depths count from the world's origin along `backward`; the target lies at the corners' mean depth.
    depth_m = float(np.mean(corners_m @ backward))
    target_m = offsets_m[0] * right + offsets_m[1] * up + depth_m * backward
    distance_m = (1 + ROOM_MARGIN_FRAC) * (max(distances_m) - depth_m)
    return _vec3(target_m + distance_m * backward), _vec3(target_m)


def fit_map_camera(environment: Environment, height_m: float, *, n_views: int = 1) -> tuple[Vec3, Vec3]:
    """Return eye and target [m] that look straight down on the layer, with the colour scale in view.

    Args:
        height_m: Height of the layer [m].
        n_views: Number of maps side by side; each is as much narrower.
    """
    aspect = MAP_VIEW_ASPECT * 2 / (n_views + 1)
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    width_m, depth_m = (1 + MAP_SCALE_FRAC) * (high_m[0] - low_m[0]), high_m[1] - low_m[1]
    tallest_m = (1 + 2 * MAP_MARGIN_FRAC) * max(depth_m, width_m / aspect)
    target_m = np.array([high_m[0] - width_m / 2, (low_m[1] + high_m[1]) / 2, height_m])
    # An orbiting eye has no up when it looks straight down; a hair from it is close enough.
    offset_m = np.array([0.0, -0.01, tallest_m / (2 * math.tan(FIELD_OF_VIEW_RAD / 2))])
    return _vec3(target_m + offset_m), _vec3(target_m)


# Walls of imported geometry lie around the grid.
def _extent_m(environment: Environment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    lows_m = [environment.grid.origin_m, *(mesh.vertices_m.min(axis=0) for mesh in environment.meshes)]
    highs_m = [environment.grid.max_m, *(mesh.vertices_m.max(axis=0) for mesh in environment.meshes)]
    return np.min(lows_m, axis=0), np.max(highs_m, axis=0)


def _vec3(values: NDArray[np.float64]) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))


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
    """Return the run's title in one line."""
    names = [name if name == method else f"{name} ({method})" for name, method in scenario.methods.items()]
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


def build_note_views() -> rrb.Tabs:
    """Return what methods note of their state: the lanes of their modes, and behind them their numbers as curves."""
    modes = rrb.StateTimelineView(origin=f"/{streams.NOTE_MODE.root}", name=streams.NOTE_MODE.title)
    return rrb.Tabs(
        modes, _plot(streams.NOTE_VALUES.root, streams.NOTE_VALUES.title, MAX_CURVES_WITH_LEGEND), active_tab=0
    )


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
        n_curves = _has_one_color(n_curves, agents)
        plots.append(_plot(streams.MIXING_RATIO.root, f"True {what} at the sensor [ppm]", n_curves, _LEGEND_OF_GAS))
        plots.append(_group(responses))
    if any(agent.wind_sensors for agent in agents):
        # Without a legend: measurements are noisy over the whole plot.
        plots.append(_plot(streams.WIND_SPEED.root, f"{_titled(streams.WIND_SPEED)}, true in grey", 0))
    distance, belief = _distance_plot(agents, believing), _belief_plots(scenario, believing)
    behind = [
        _plot(streams.TRACKING_ERROR.root, _titled(streams.TRACKING_ERROR), 0),
        _plot(streams.DECISION_TIME.root, _titled(streams.DECISION_TIME), 0),
    ]
    if scenario.has_driven_wind or scenario.curve_ports:
        plots.append(_plot(streams.SERVICES.root, _titled(streams.SERVICES), MAX_CURVES_WITH_LEGEND))
    if any(agent.cameras for agent in agents):
        # Pictures take the room of a plot.
        return [*plots, _group([distance, *belief, *behind])]
    return [*plots, *belief, _group([distance, *behind])]


def _titled(stream: Stream) -> str:
    return label_with_unit(stream.title, stream.unit)


# The most important plot is in front.
def _group(plots: Sequence[rrb.TimeSeriesView]) -> rrb.TimeSeriesView | rrb.Tabs:
    return plots[0] if len(plots) == 1 else rrb.Tabs(*plots, active_tab=0)


def _distance_plot(agents: Sequence[AgentEntities], believing: Sequence[AgentEntities]) -> rrb.TimeSeriesView:
    pale = ", by belief in pale" if believing else ""
    return _plot(streams.DISTANCE.root, f"{_titled(streams.DISTANCE)}{pale}", len(agents), _LEGEND_OF_FALLING)


def _belief_plots(scenario: Scenario, believing: Sequence[AgentEntities]) -> list[rrb.TimeSeriesView]:
    if not believing:
        return []
    name = f"Belief within {scenario.referee.success.within_m:g} m of the source [1]"
    return [_plot(streams.BELIEF_MASS.root, name, len(believing), _LEGEND_OF_GAS)]


# Several vehicles with one curve each have their own colours, which the legend of the distances shows.
def _has_one_color(n_curves: int, agents: Sequence[AgentEntities]) -> int:
    return 0 if n_curves <= len(agents) else n_curves


def build_camera_views(agents: Sequence[AgentEntities], *, with_agent: bool) -> list[rrb.Spatial2DView]:
    """Return a view for each camera, named after it, and after its agent where asked."""
    return [
        rrb.Spatial2DView(
            origin=f"/{agent.at(streams.PICTURES, sensor=camera.name)}",
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
            agent.at(stream, sensor=sensor.name),
            label_with_unit(f"{sensor.name}: {stream.title}", stream.unit),
            len(stream.axes),
        )
        for sensor, streams in agent.on_board_sensors
        for stream in streams
    ]
    views = [*build_camera_views([agent], with_agent=False), *plots]
    if not views:
        return None
    columns = min(MAX_GRID_COLUMNS, math.ceil(math.sqrt(len(views))))
    return rrb.Grid(*views, grid_columns=columns, name=f"Sensors of {agent.agent.name}")


# Readings of one unit are in one plot.
def _response_plots(scenario: Scenario, agents: Sequence[AgentEntities]) -> list[rrb.TimeSeriesView]:
    members: dict[str, list[tuple[str, str]]] = {}
    for agent in agents:
        for sensor in agent.gas_sensors:
            members.setdefault(get_unit(sensor, scenario), []).append(
                (sensor.model, agent.at(streams.RESPONSE, sensor=sensor.name))
            )
    plots = []
    for unit, drawn in members.items():
        models = dict.fromkeys(
            model.upper() if model.startswith(_ACRONYMS) else model.replace("_", " ") for model, _ in drawn
        )
        title = label_with_unit(f"Reading of {', '.join(models)}", unit)
        contents = [f"+ /{entity}" for _, entity in drawn]
        corner = _LEGEND_OF_FALLING if unit == _FALLING_UNIT else _LEGEND_OF_GAS
        n_curves = _has_one_color(len(drawn), agents)
        plots.append(_plot(streams.RESPONSE.root, title, n_curves, corner, contents=contents))
    return plots


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


def default_blueprint(
    scenario: Scenario, environment: Environment, *, believers: Sequence[str] = (), has_notes: bool = False
) -> rrb.Blueprint:
    """Return the layout: the room, the map at search height and the text left, cameras and curves right.

    Each vehicle with on-board sensors has a page of its own behind this one, with their pictures and curves. Panels are
    folded away and the time cursor stands at the end of the run, so that the whole track is visible.

    Args:
        believers: The agents that publish beliefs: each has a map of its own behind that of the gas.
        has_notes: True if methods note their state, which has a lane for each mode and curves.
    """
    agents = build_entities(scenario)
    flight = _run_page(scenario, environment, agents, believers, has_notes=has_notes)
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
    scenario: Scenario,
    environment: Environment,
    agents: Sequence[AgentEntities],
    believers: Sequence[str],
    *,
    has_notes: bool,
) -> rrb.Horizontal:
    # Behind tabs, so that each has room for some lines on a small screen.
    columns = rrb.TextLogColumns(timeline_columns=[TIME_TIMELINE], text_log_columns=["Body"])
    logs = [
        rrb.TextLogView(origin=stream.entity, name=stream.title, columns=columns)
        for stream in streams.LOGS
        if stream is not streams.RADIO or scenario.channels
    ]
    documents = [
        rrb.TextDocumentView(origin=stream.entity, name=stream.title) for stream in (streams.SUMMARY, streams.LEGEND)
    ]
    texts = [rrb.Tabs(*documents, active_tab=0), rrb.Tabs(*logs, active_tab=0)]
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
    plots = [*plots, *([build_note_views()] if has_notes else [])]
    shares = [*(CAMERA_WEIGHT for _ in cameras), *(1.0 for _ in plots)]
    right = rrb.Vertical(*cameras, *plots, row_shares=shares)
    return rrb.Horizontal(left, right, column_shares=[5, 2], name="Flight")


def _room_view(scenario: Scenario, environment: Environment, agents: Sequence[AgentEntities]) -> rrb.Spatial3DView:
    name = f"{title(scenario)} (floor grid {floor_grid_m(environment):g} m)"
    contents = ["+ /**", "- /map/**", f"- /{streams.SLICES.root}/**", f"- /{streams.BELIEF.root}/**", "- /plots/**"]
    return build_space_view(
        name, fit_room_camera(environment), (0.0, 0.0, 1.0), contents=contents, overrides=_histories(agents)
    )


def _map_view(
    scenario: Scenario, environment: Environment, agents: Sequence[AgentEntities], n_maps: int
) -> rrb.Spatial3DView:
    height_m, scale = scenario.slice_height_m, GasScale.of(scenario)
    name = f"{scenario.gas.gas} at {height_m:.3g} m height, {scale.min_ppm:g} to {scale.max_ppm:g} ppm, and wind"
    contents = [*_NOT_ON_MAP, f"+ /{streams.SLICES.at(gas=scenario.gas.gas)}"]
    camera = fit_map_camera(environment, height_m, n_views=n_maps)
    return build_space_view(name, camera, (0.0, 1.0, 0.0), contents=contents, overrides=_histories(agents))


def _belief_view(environment: Environment, agents: Sequence[AgentEntities], agent: AgentEntities) -> rrb.Spatial3DView:
    no_wind, belief = f"- /{streams.WIND_ARROWS.entity}", f"+ /{agent.at(streams.BELIEF)}"
    contents = [*_NOT_ON_MAP, "- /map/scale/**", no_wind, belief]
    camera = fit_map_camera(environment, agent.agent.vehicle.search_height_m, n_views=2)
    name = f"Belief of {agent.agent.name}"
    return build_space_view(name, camera, (0.0, 1.0, 0.0), contents=contents, overrides=_histories(agents))


def build_space_view(name: str, camera: tuple[Vec3, Vec3], up: Vec3, **options: Any) -> rrb.Spatial3DView:
    """Return a view in space from an eye to a target [m], with further options of `rrb.Spatial3DView`."""
    eye_m, target_m = camera
    eye = rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye_m, look_target=target_m, eye_up=up)
    view = {"name": name, "background": colors.BACKGROUND, "line_grid": False, "eye_controls": eye}
    return rrb.Spatial3DView(origin="/", **view, **options)


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
    kept = (streams.TRACK_LINE, streams.PLANNED_PATH, streams.WAYPOINTS, streams.MARKS)
    return {agent.at(stream): [history] for agent in agents for stream in kept}
