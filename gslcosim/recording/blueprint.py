"""The default layout of a recording in the viewer, so that a person understands the run without being told."""

import itertools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from gslcosim.contract.messages import Vec3
from gslcosim.environment.model import Environment
from gslcosim.recording import colors, entities
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import AgentEntities, entities_of
from gslcosim.recording.run_file import TICK_TIMELINE, TIME_TIMELINE
from gslcosim.recording.scene import floor_grid_m
from gslcosim.recording.summary import title
from gslcosim.scenario import Scenario

# Where the eye stands, seen from the room's middle: somewhat west of south and above, the inlet's side in front.
EYE_AZIMUTH_RAD = math.radians(-114.0)
EYE_ELEVATION_RAD = math.radians(31.0)
# The viewer's vertical field of view, measured in pictures of it, and the shapes of the views in a 16:10 window.
FIELD_OF_VIEW_RAD = math.radians(55.0)
ROOM_VIEW_ASPECT = 1.95
MAP_VIEW_ASPECT = 1.4
# Room for the colour scale west of the map, and margins, in fractions of the side.
MAP_SCALE_FRAC = 0.3
MAP_MARGIN_FRAC = 0.09
ROOM_MARGIN_FRAC = 0.02
# The curves end a little after the cursor, so that their last points are seen.
LOOK_AHEAD_S = 3.0


def default_blueprint(scenario: Scenario, environment: Environment) -> rrb.Blueprint:
    """Return the layout: the room, the map at search height and the text left, the curves right.

    Panels are folded away and the time cursor stands at the end of the run, where the whole track is seen.

    Args:
        scenario: What is flown.
        environment: The room.
    """
    agents = entities_of(scenario)
    logs = [_log_view(entities.EVENTS, "Referee")]
    if scenario.channels:
        logs.append(_log_view(entities.RADIO, "Radio"))
    left = rrb.Vertical(
        _room_view(scenario, environment, agents),
        rrb.Horizontal(
            _map_view(scenario, environment, agents),
            rrb.Vertical(
                rrb.TextDocumentView(origin=entities.SUMMARY, name="Run"),
                *logs,
                row_shares=[3, *(2 for _ in logs)],
            ),
            column_shares=[1, 1],
        ),
        row_shares=[4, 3],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*_plots(scenario)), column_shares=[5, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIME_TIMELINE, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _log_view(origin: str, name: str) -> rrb.TextLogView:
    columns = rrb.TextLogColumns(timeline_columns=[TIME_TIMELINE], text_log_columns=["Body"])
    return rrb.TextLogView(origin=origin, name=name, columns=columns)


def _room_view(scenario: Scenario, environment: Environment, agents: Iterable[AgentEntities]) -> rrb.Spatial3DView:
    eye_m, target_m = eye_on_room(environment)
    return rrb.Spatial3DView(
        origin="/",
        name=f"{title(scenario)} (floor grid {floor_grid_m(environment):g} m)",
        contents=["+ /**", "- /map/**", f"- /{entities.SLICES}/**", "- /plots/**"],
        background=colors.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye_m, look_target=target_m, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides=_histories(agents),
    )


def _map_view(scenario: Scenario, environment: Environment, agents: Iterable[AgentEntities]) -> rrb.Spatial3DView:
    height_m = scenario.slice_height_m
    scale = GasScale.of(scenario)
    eye_m, target_m = _eye_on_map(environment, height_m)
    return rrb.Spatial3DView(
        origin="/",
        name=f"{scenario.gas.gas} at {height_m:g} m height, {scale.min_ppm:g} to {scale.max_ppm:g} ppm, and wind",
        contents=["+ /**", f"- /{entities.FILAMENTS}", "- /room/floor/**", "- /room/outline", "- /plots/**"],
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


# Tracks, plans, waypoints and markers stay: all rows up to the cursor are drawn, not only the last.
def _histories(agents: Iterable[AgentEntities]) -> dict[Any, Any]:
    history = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative(seq=0)
            )
            for timeline in (TIME_TIMELINE, TICK_TIMELINE)
        ]
    )
    return {path: [history] for agent in agents for path in (agent.track, agent.plan, agent.waypoints, agent.markers)}


def _plots(scenario: Scenario) -> list[rrb.TimeSeriesView]:
    models = sorted({s.model for a in scenario.agents for s in a.sensors if s.model not in entities.NOT_GAS_MODELS})
    unit = " [ohm]" if all(model.startswith(entities.RESISTIVE_MODELS) for model in models) else ""
    response = f"Reading of {' and '.join(model.upper() for model in models)}{unit}"
    plots = [
        (entities.GAS_PLOTS, f"True {scenario.gas.gas} at the sensor [ppm]"),
        (entities.RESPONSE_PLOTS, response),
        (entities.WIND_PLOTS, "Wind speed at the vehicle [m/s]"),
        (entities.DISTANCE_PLOTS, "Distance to the source [m]"),
        (entities.TRACKING_PLOTS, "Distance to the controller's reference [m]"),
    ]
    so_far = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=0.0),
        end=rr.TimeRangeBoundary.cursor_relative(seconds=LOOK_AHEAD_S),
    )
    return [
        rrb.TimeSeriesView(
            origin=origin,
            name=name,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
            axis_x=rrb.TimeAxis(view_range=so_far),
        )
        for origin, name in plots
    ]


def eye_on_room(environment: Environment) -> tuple[Vec3, Vec3]:
    """Return eye and target [m] of the nearest eye that has all corners of the room in view.

    For a corner c seen along the fixed directions right, up and backward, |c.up - t_up| <= h (d - c.backward) must hold
    with h the tangent of half the field of view, t the target and d the eye's distance (likewise for right with the
    view's aspect). With A = max(c.up + h c.backward) and B = max(-c.up + h c.backward) the smallest d is
    (A + B) / (2 h), at t_up = (A - B) / 2 (our derivation).
    """
    corners_m = np.array(list(itertools.product(*zip(environment.grid.origin_m, environment.grid.max_m, strict=True))))
    level = math.cos(EYE_ELEVATION_RAD)
    backward = np.array(
        [level * math.cos(EYE_AZIMUTH_RAD), level * math.sin(EYE_AZIMUTH_RAD), math.sin(EYE_ELEVATION_RAD)]
    )
    right = np.array([-math.sin(EYE_AZIMUTH_RAD), math.cos(EYE_AZIMUTH_RAD), 0.0])
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


def _eye_on_map(environment: Environment, height_m: float) -> tuple[Vec3, Vec3]:
    """Return eye and target [m] that look straight down on the layer, with the colour scale in view."""
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    width_m, depth_m = (1 + MAP_SCALE_FRAC) * (high_m[0] - low_m[0]), high_m[1] - low_m[1]
    tallest_m = (1 + 2 * MAP_MARGIN_FRAC) * max(depth_m, width_m / MAP_VIEW_ASPECT)
    target_m = np.array([high_m[0] - width_m / 2, (low_m[1] + high_m[1]) / 2, height_m])
    # An orbiting eye has no up when it looks straight down; a hair from it is close enough.
    offset_m = np.array([0.0, -0.01, tallest_m / (2 * math.tan(FIELD_OF_VIEW_RAD / 2))])
    return _vec3(target_m + offset_m), _vec3(target_m)


def _vec3(values: NDArray[np.float64]) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
