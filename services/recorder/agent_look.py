"""Look of one agent's streams at all times: its vehicle, its lines and points in space, and its curves."""

import rerun as rr

from gslcosim.scenario.models.sensors import LidarSensorSpec, RaySensorSpec, TdlasSensorSpec
from gslcosim_services.recorder import colors
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.entities import AgentEntities
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.scene import draw_vehicle

# Negative, which for Rerun is in points of the screen: a scan is transparent from near, and visible from far.
POINT_RADIUS = -1.2
RAY_RADIUS_M = 0.008
TRACK_RADIUS_M = 0.035
PLAN_RADIUS_M = 0.015
CURVE_WIDTH = 1.5


def draw_agent(file: RecordingFile, names: AgentEntities, gases: tuple[str, ...], *, label: str) -> None:
    """Draw an agent's vehicle, and the look of its lines, points and curves.

    Args:
        gases: Those of the run.
        label: Precedes the names of curves; empty for the only agent.
    """
    # A name beside the only vehicle would hide the things that it approaches.
    draw_vehicle(file, names.at(streams.TRACK), names.agent, names.color, is_named=bool(label))
    _draw_lines(file, names.at(streams.TRACK_LINE), names.color, TRACK_RADIUS_M)
    if names.agent.vehicle.avoidance != "none":
        _draw_lines(file, names.at(streams.PLANNED_PATH), colors.plan_color(names.color), PLAN_RADIUS_M)
    for sensor in (*(sensor for sensor, _ in names.on_board_sensors), *names.gas_sensors):
        if isinstance(sensor, LidarSensorSpec):
            points = rr.Points3D.from_fields(colors=[names.color], radii=[POINT_RADIUS])
            file.draw(names.at(streams.POINT_CLOUDS, sensor=sensor.name), points)
        elif isinstance(sensor, RaySensorSpec | TdlasSensorSpec):
            _draw_lines(file, names.at(streams.RAYS, sensor=sensor.name), names.color, RAY_RADIUS_M)
    for entity, names_and_colors in _curves(names, gases, label).items():
        labels, shades = zip(*names_and_colors, strict=True)
        file.draw(entity, rr.SeriesLines(names=labels, colors=shades, widths=[CURVE_WIDTH] * len(labels)))


def draw_belief_curves(file: RecordingFile, names: AgentEntities, *, label: str) -> None:
    """Draw the look of the curves of a belief's score; `label` precedes their names."""
    styles = {streams.BELIEF_MASS: "belief near the source", streams.BELIEF_DISTANCE: "expected by belief"}
    shade = colors.plan_color(names.color)
    for stream, text in styles.items():
        file.draw(names.at(stream), rr.SeriesLines(names=[f"{label}{text}"], colors=[shade], widths=[CURVE_WIDTH]))


def _draw_lines(file: RecordingFile, entity: str, color: colors.Rgb, radius_m: float) -> None:
    file.draw(entity, rr.LineStrips3D.from_fields(colors=[color], radii=[radius_m]))


# Names and colours of each entity's curves.
def _curves(names: AgentEntities, gases: tuple[str, ...], label: str) -> dict[str, list[tuple[str, colors.Rgb]]]:
    styles = {
        names.at(streams.DISTANCE): [(label.strip() or "distance", names.color)],
        names.at(streams.TRACKING_ERROR): [(label.strip() or "error", names.color)],
        names.at(streams.DECISION_TIME): [(label.strip() or "decision", names.color)],
    }
    sensors_and_gases = [(sensor.name, gas) for sensor in names.gas_sensors for gas in gases]
    for i, (sensor, gas) in enumerate(sensors_and_gases):
        of_gas = f" {gas}" if len(gases) > 1 else ""
        entity = names.at(streams.MIXING_RATIO, sensor=sensor, gas=gas)
        styles[entity] = [(f"{label}{sensor}{of_gas}", colors.shade(names.color, i))]
    for i, sensor in enumerate(names.gas_sensors):
        entity = names.at(streams.RESPONSE, sensor=sensor.name)
        styles[entity] = [(f"{label}{sensor.name}", colors.shade(names.color, i))]
    for i, sensor in enumerate(names.wind_sensors):
        of_sensor = f"{sensor.name} " if len(names.wind_sensors) > 1 else ""
        measured = colors.shade(names.color if label else colors.WIND, i)
        styles[names.at(streams.WIND_SPEED, sensor=sensor.name)] = [(f"{label}{of_sensor}measured", measured)]
        styles[names.at(streams.TRUE_WIND_SPEED, sensor=sensor.name)] = [(f"{label}{of_sensor}true", colors.TRUTH)]
    for sensor, own in names.on_board_sensors:
        for stream in own:
            if stream.axes:
                drawn = [(axis, colors.axis_color(axis, i)) for i, axis in enumerate(stream.axes)]
                styles[names.at(stream, sensor=sensor.name)] = drawn
    return styles
