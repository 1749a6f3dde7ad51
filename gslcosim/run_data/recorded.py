"""The streams of a recording, each decoded on demand: one function for each kind."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gslcosim.recording import entities
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import AgentEntities, gases_in
from gslcosim.recording.instruments import unit_of
from gslcosim.recording.reading.decoding import SliceDecoder, picture_place, splats
from gslcosim.recording.reading.stored_rows import StoredColumn, StoredRows
from gslcosim.recording.rows.undrawn import NUMBERS_COMPONENT, numbers_in
from gslcosim.run_data.recorded_streams import (
    Floats,
    Ints,
    RecordedDoor,
    RecordedFilaments,
    RecordedPictures,
    RecordedPoints,
    RecordedSeries,
    RecordedShapes,
    RecordedSlices,
    RecordedTexts,
    RecordedTrack,
    column_name,
)
from gslcosim.scenario import Scenario
from gslcosim.ticks import NS_PER_S

_SCALARS = "Scalars:scalars"
_SPEED_AND_BEARING = ("speed", "bearing")


def track(rows: StoredRows, scenario: Scenario, names: AgentEntities) -> RecordedTrack:
    """Return where a vehicle was."""
    places = rows.column(names.vehicle, "Transform3D:translation")
    turns_xyzw = rows.column(names.vehicle, "Transform3D:quaternion")
    return RecordedTrack(
        agent=names.agent.name,
        tick=places.tick,
        time_s=times_s(places.tick, scenario),
        position_world_m=_floats(places, 3),
        quaternion_wxyz=np.roll(_floats(turns_xyzw, 4), 1, axis=1),
    )


def samples(rows: StoredRows, scenario: Scenario, names: AgentEntities) -> list[RecordedSeries]:
    """Return the truth at an agent's sensors: mixing ratios of all gases, and the wind with its speed."""
    agent, found = names.agent.name, list[RecordedSeries]()
    for sensor in names.gas_sensors:
        for gas in gases_in(scenario):
            found += _series(
                rows, scenario, names.gas(sensor.name, gas), agent=agent, sensor=sensor.name,
                quantity="mixing_ratio", unit="ppm", gas=gas,
            )  # fmt: skip
    for sensor in names.wind_sensors:
        entity = names.true_wind(sensor.name)
        found += _series(rows, scenario, entity, agent=agent, sensor=sensor.name, quantity="wind_speed", unit="m/s")
        found += _series(
            rows, scenario, entity, agent=agent, sensor=sensor.name, quantity="wind", unit="m/s",
            labels=("x", "y", "z"), component=NUMBERS_COMPONENT,
        )  # fmt: skip
    return found


def readings(rows: StoredRows, scenario: Scenario, names: AgentEntities) -> list[RecordedSeries]:
    """Return what an agent's sensors reported; nothing of the time in which they warmed up."""
    agent, found = names.agent.name, list[RecordedSeries]()
    for sensor in names.gas_sensors:
        entity, unit = names.response(sensor.name), unit_of(sensor, scenario)
        found += _series(rows, scenario, entity, agent=agent, sensor=sensor.name, quantity="response", unit=unit)
    for sensor in names.wind_sensors:
        entity = names.measured_wind(sensor.name)
        found += _series(rows, scenario, entity, agent=agent, sensor=sensor.name, quantity="wind_speed", unit="m/s")
        found += _wind_values(rows, scenario, entity, agent=agent, sensor=sensor.name)
    for sensor, curves in names.on_board_sensors:
        for item in curves:
            found += _series(
                rows, scenario, names.on_board(sensor.name, item), agent=agent, sensor=sensor.name,
                quantity=item.entity, unit=item.unit, labels=item.labels,
            )  # fmt: skip
    return found


def figures(rows: StoredRows, scenario: Scenario, names: AgentEntities) -> list[RecordedSeries]:
    """Return the curves that are no sensor's: `distance`, `tracking_error`, `decision_time`, and two of beliefs."""
    wanted = {
        names.distance: ("distance", "m"),
        names.tracking_error: ("tracking_error", "m"),
        names.decision: ("decision_time", "ms"),
        names.belief_mass: ("belief_mass_near", "frac"),
        names.belief_distance: ("belief_distance", "m"),
    }
    found: list[RecordedSeries] = []
    for entity, (quantity, unit) in wanted.items():
        found += _series(rows, scenario, entity, agent=names.agent.name, sensor="", quantity=quantity, unit=unit)
    return found


def service_curves(rows: StoredRows, scenario: Scenario) -> list[RecordedSeries]:
    """Return what services of other packages wrote; the quantity is the port and the field."""
    found: list[RecordedSeries] = []
    for entity in rows.below(entities.SERVICE_PLOTS):
        quantity = entity.removeprefix(f"{entities.SERVICE_PLOTS}/")
        found += _series(rows, scenario, entity, agent="", sensor="", quantity=quantity, unit="")
    return found


def points(rows: StoredRows, scenario: Scenario, entity: str) -> RecordedPoints:
    """Return labelled places."""
    places, labels = rows.column(entity, "Points3D:positions"), rows.column(entity, "Points3D:labels")
    return RecordedPoints(
        tick=places.tick,
        time_s=times_s(places.tick, scenario),
        position_world_m=_floats(places, 3),
        label=tuple(str(label) for label in labels.values),
    )


def texts(rows: StoredRows, scenario: Scenario, entity: str) -> RecordedTexts:
    """Return the lines of a log."""
    lines, levels = rows.column(entity, "TextLog:text"), rows.column(entity, "TextLog:level")
    return RecordedTexts(
        tick=lines.tick,
        time_s=times_s(lines.tick, scenario),
        text=tuple(map(str, lines.values)),
        level=tuple(map(str, levels.values)),
    )


def door(rows: StoredRows, scenario: Scenario, name: str) -> RecordedDoor:
    """Return when a door was closed."""
    boxes = rows.column(f"{entities.DOORS}/{name}", "Boxes3D:half_sizes")
    times = times_s(boxes.tick, scenario)
    return RecordedDoor(tick=boxes.tick, time_s=times, is_closed=np.diff(boxes.starts) > 0)


def slices(rows: StoredRows, scenario: Scenario) -> dict[str, RecordedSlices]:
    """Return the gases in the layer of the map, by name."""
    found: dict[str, RecordedSlices] = {}
    for entity in rows.below(entities.SLICES):
        pictures, place = rows.column(entity, "GridMap:data"), picture_place(rows, entity)
        if place is None:
            continue
        shape, cell_m, (x, y, _) = place
        scale = GasScale.of(scenario)
        decoder, gas = SliceDecoder(shape=shape, scale=scale), entity.removeprefix(f"{entities.SLICES}/")
        found[gas] = RecordedSlices(
            gas=gas,
            tick=pictures.tick,
            time_s=times_s(pictures.tick, scenario),
            origin_m=(x, y),
            cell_m=cell_m,
            shape=shape,
            height_m=scenario.slice_height_m,
            min_ppm=scale.min_ppm,
            max_ppm=scale.max_ppm,
            decode=lambda i, pictures=pictures, decoder=decoder: decoder.mixing_ratio_ppm(pictures.values[i]),
        )
    return found


def filaments(rows: StoredRows, scenario: Scenario) -> RecordedFilaments:
    """Return the cloud over time."""
    centres, sigmas = splats(rows, entities.FILAMENTS)
    return RecordedFilaments(
        tick=centres.tick,
        time_s=times_s(centres.tick, scenario),
        starts=centres.starts,
        centre_world_m=_floats(centres, 3),
        sigma_m=_floats(sigmas, 3)[:, 0],
    )


def shapes(rows: StoredRows, scenario: Scenario, names: AgentEntities, *, are_rays: bool) -> list[RecordedShapes]:
    """Return the points of an agent's lidars, or the rays of its range finders and lasers."""
    component = "LineStrips3D:strips" if are_rays else "Points3D:positions"
    root, found = f"{entities.SEEN}/{names.agent.name}", list[RecordedShapes]()
    for entity in rows.below(root):
        column = rows.column(entity, component)
        if not len(column.tick):
            continue
        values = np.asarray(column.values, dtype=np.float64).reshape((-1, 2, 3) if are_rays else (-1, 3))
        found.append(
            RecordedShapes(
                agent=names.agent.name,
                sensor=entity.removeprefix(f"{root}/"),
                tick=column.tick,
                time_s=times_s(column.tick, scenario),
                starts=column.starts,
                points_world_m=values,
            )
        )
    return found


def pictures(rows: StoredRows, scenario: Scenario, names: AgentEntities) -> list[RecordedPictures]:
    """Return the pictures of an agent's cameras."""
    found: list[RecordedPictures] = []
    for camera in names.cameras:
        entity = names.seen(camera.name)
        for kind in ("EncodedImage", "EncodedDepthImage"):
            blobs, media = rows.column(entity, f"{kind}:blob"), rows.column(entity, f"{kind}:media_type")
            if len(blobs.tick):
                found.append(_pictures(rows, scenario, names, entity, blobs, str(media.values[0])))
    return found


def times_s(tick: Ints, scenario: Scenario) -> Floats:
    """Return the simulated times of ticks [s]."""
    return tick * scenario.tick_ns / NS_PER_S


def _pictures(
    rows: StoredRows, scenario: Scenario, names: AgentEntities, entity: str, blobs: StoredColumn, media_type: str
) -> RecordedPictures:
    eyes, turns = rows.column(entity, "Transform3D:translation"), rows.column(entity, "Transform3D:quaternion")
    # Column by column, as Rerun has it.
    projection = rows.still(entity, "Pinhole:image_from_camera")[0]
    width, height = rows.still(entity, "Pinhole:resolution")[0]
    return RecordedPictures(
        agent=names.agent.name,
        sensor=entity.rpartition("/")[2],
        tick=blobs.tick,
        time_s=times_s(blobs.tick, scenario),
        media_type=media_type,
        is_depth=rows.still(entity, "EncodedDepthImage:meter") is not None,
        data=tuple(np.asarray(blob).tobytes() for blob in blobs.values),
        position_world_m=_floats(eyes, 3),
        quaternion_wxyz=np.roll(_floats(turns, 4), 1, axis=1),
        size_px=(int(width), int(height)),
        focal_px=(float(projection[0]), float(projection[4])),
        centre_px=(float(projection[6]), float(projection[7])),
    )


# An anemometer with two axes tells speed and bearing, one with three the vector.
def _wind_values(rows: StoredRows, scenario: Scenario, entity: str, *, agent: str, sensor: str) -> list[RecordedSeries]:
    found = _series(
        rows, scenario, entity, agent=agent, sensor=sensor, quantity="apparent_wind", unit="m/s",
        labels=("x", "y", "z"), component=NUMBERS_COMPONENT,
    )  # fmt: skip
    return [
        replace(one, quantity="wind_from", unit="rad", columns=("wind_from_rad",), values=one.values[:, 1:])
        if one.values.shape[1] == len(_SPEED_AND_BEARING)
        else one
        for one in found
    ]


def _series(
    rows: StoredRows,
    scenario: Scenario,
    entity: str,
    *,
    agent: str,
    sensor: str,
    quantity: str,
    unit: str,
    labels: Sequence[str] = (),
    gas: str = "",
    component: str = _SCALARS,
) -> list[RecordedSeries]:
    column = rows.column(entity, component)
    n = len(column.tick)
    if not n:
        return []
    is_bytes = component == NUMBERS_COMPONENT
    values = numbers_in(column.values) if is_bytes else np.asarray(column.values, dtype=np.float64).reshape(n, -1)
    k = values.shape[1]
    parts = [f"{quantity} {label}" for label in labels] if len(labels) == k and k > 1 else [quantity]
    if len(parts) != k:
        parts = [f"{quantity} {i}" for i in range(k)]
    return [
        RecordedSeries(
            agent=agent,
            sensor=sensor,
            quantity=quantity,
            unit=unit,
            gas=gas,
            columns=tuple(column_name(part, unit) for part in parts),
            tick=column.tick,
            time_s=times_s(column.tick, scenario),
            values=values,
        )
    ]


def _floats(column: StoredColumn, width: int) -> Floats:
    return np.asarray(column.values, dtype=np.float64).reshape(-1, width)
