"""Table of a run's streams: name, place in the recording, component, unit, frame and writer of each.

The recorder writes by it, and all readers of recordings find their data by it: arrays and tables, plots, messages of
ROS and recordings of several runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

XYZ = ("x", "y", "z")
POSE, ATTITUDE_COMPONENT = "Transform3D:translation", "Transform3D:quaternion"
LINES, POINTS, SCALARS, TEXTS = "LineStrips3D:strips", "Points3D:positions", "Scalars:scalars", "TextLog:text"
GRID, SPLATS, ARROWS, BOXES = "GridMap:data", "GaussianSplats3D:centers", "Arrows3D:vectors", "Boxes3D:half_sizes"
IMAGE, DOCUMENT = "EncodedImage:blob", "TextDocument:text"

TABLES = {
    "samples": "the truth at the sensors",
    "readings": "what the sensors reported, but for the time in which they warmed up",
    "figures": "what referee and controllers knew",
    "services": "what services of other packages wrote",
}
"""Tables of `extract` that hold several streams of numbers, with their meaning."""


@dataclass(frozen=True, kw_only=True)
class Stream:
    """One stream of a run.

    Attributes:
        name: Name outside the recording; of numbers the quantity.
        entity: Path in the recording; braces hold the place of names of the run: agent, sensor, gas and so on.
        component: Rerun's name of the column of values.
        meaning: Meaning of the values.
        writer: Process that writes the messages of the stream.
        unit: As messages have it; empty for pure numbers, texts, and where a sensor has a unit of its own.
        frame: Frame of directions and places; empty where there are none.
        axes: Names of the numbers of a row, where there are several.
        table: Name of its table in `TABLES`; empty: none.
        title: Name in the viewer.
    """

    name: str
    entity: str
    component: str
    meaning: str
    writer: str
    unit: str = ""
    frame: str = ""
    axes: tuple[str, ...] = ()
    table: str = ""
    title: str = ""

    @property
    def root(self) -> str:
        """Start of the path, which is the same for all of a run."""
        return self.entity.partition("/{")[0]

    def at(self, **names: str) -> str:
        """Return the path for names of a run, for example `agent="beetle"`."""
        return self.entity.format(**names)


def _places(name: str, entity: str, component: str, writer: str, meaning: str) -> Stream:
    return Stream(
        name=name, entity=entity, component=component, writer=writer, meaning=meaning, unit="m", frame="world", axes=XYZ
    )


def _text(name: str, component: str, writer: str, title: str, meaning: str) -> Stream:
    return Stream(name=name, entity=name, component=component, writer=writer, title=title, meaning=meaning)


TRACK = _places("track", "vehicles/{agent}", POSE, "world", "where the vehicle was at the end of each tick")
TRACK_ATTITUDE = Stream(
    name="track_attitude", entity=TRACK.entity, component=ATTITUDE_COMPONENT, frame="world from body",
    axes=(*XYZ, "w"), writer="world", meaning="attitude of the vehicle at the end of each tick",
)  # fmt: skip
TRACK_LINE = _places("track_line", "tracks/{agent}", LINES, "world", "where the vehicle was, as a line")
PLANNED_PATH = _places("planned_path", "plans/{agent}", LINES, "world", "the path ahead, whenever it is planned again")
WAYPOINTS = _places("waypoints", "waypoints/{agent}", POINTS, "agent", "where vehicles were sent")
MARKS = _places("marks", "markers/{agent}", POINTS, "referee", "what happened where")
SOURCE_MARKS = _places("source_marks", "sources/{source}/events", POINTS, "events", "what happened to a source where")
BELIEF = Stream(
    name="belief", entity="beliefs/{agent}", component=GRID, frame="world", writer="agent",
    meaning="where an agent believes the source to be",
)  # fmt: skip

MIXING_RATIO = Stream(
    name="mixing_ratio", entity="plots/gas_ppm/{agent}/{sensor}/{gas}", component=SCALARS, unit="ppm", writer="fields",
    table="samples", meaning="the true mixing ratio at a sensor",
)  # fmt: skip
TRUE_WIND_SPEED = Stream(
    name="wind_speed", entity="plots/wind_m_s/{agent}/{sensor}/true", component=SCALARS, unit="m/s", writer="fields",
    table="samples", title="Wind speed", meaning="the true wind speed at an anemometer",
)  # fmt: skip
# Beside the plots and not in them: the viewer draws every number of a plot's entity, whatever its component.
TRUE_WIND = Stream(
    name="wind", entity="anemometers/{agent}/{sensor}/true", component="wind_m_s", unit="m/s", frame="world", axes=XYZ,
    writer="fields", table="samples", meaning="the true wind at an anemometer",
)  # fmt: skip

RESPONSE = Stream(
    name="response", entity="plots/response/{agent}/{sensor}", component=SCALARS, writer="sensing", table="readings",
    meaning="what a gas sensor reports, in its unit",
)  # fmt: skip
WIND_SPEED = Stream(
    name="wind_speed", entity="plots/wind_m_s/{agent}/{sensor}/measured", component=SCALARS, unit="m/s",
    writer="sensing", table="readings", title="Wind speed",
    meaning="the speed that an anemometer reports, relative to the vehicle",
)  # fmt: skip
APPARENT_WIND = Stream(
    name="apparent_wind", entity="anemometers/{agent}/{sensor}/measured", component="apparent_wind_m_s", unit="m/s",
    frame="world", axes=XYZ, writer="sensing", table="readings",
    meaning="the wind that an anemometer with three axes reports, relative to the vehicle",
)  # fmt: skip
WIND_FROM = Stream(
    name="wind_from", entity=APPARENT_WIND.entity, component="wind_from_rad", unit="rad", frame="world",
    writer="sensing", table="readings",
    meaning="where the wind comes from that an anemometer with two axes reports, counter-clockwise from x",
)  # fmt: skip


def _on_board(title: str, unit: str, axes: tuple[str, ...], *, frame: str = "") -> Stream:
    name = title.replace(" ", "_")
    return Stream(
        name=name, entity=f"plots/on_board/{{agent}}/{{sensor}}/{name}", component=SCALARS, unit=unit, frame=frame,
        axes=axes, writer="sensing", table="readings", title=title, meaning=f"{title} that an on-board sensor reports",
    )  # fmt: skip


SPECIFIC_FORCE = _on_board("specific force", "m/s^2", XYZ, frame="body")
ANGULAR_VELOCITY = _on_board("angular velocity", "rad/s", XYZ, frame="body")
POSITION = _on_board("position", "m", XYZ, frame="world")
VELOCITY = _on_board("velocity", "m/s", XYZ, frame="world")
ATTITUDE = _on_board("attitude quaternion", "1", ("w", *XYZ), frame="world from body")
PRESSURE = _on_board("pressure", "Pa", ("pressure",))
MAGNETIC_FIELD = _on_board("magnetic field", "uT", XYZ, frame="body")
RANGE = _on_board("range", "m", ("range",))
RANGES = _on_board("ranges", "m", ("front", "left", "back", "right"), frame="body")
LEAST_RANGE = _on_board("least range", "m", ("least",))
CONTACT = _on_board("contact", "1", ("contact",))

ON_BOARD_STREAMS: dict[str, tuple[Stream, ...]] = {
    "imu": (SPECIFIC_FORCE, ANGULAR_VELOCITY),
    "gps": (POSITION, VELOCITY),
    "barometer": (PRESSURE,),
    "magnetometer": (MAGNETIC_FIELD,),
    "pose": (POSITION, ATTITUDE, VELOCITY),
    "range_finder": (RANGE,),
    "four_range_finders": (RANGES,),
    "lidar_2d": (LEAST_RANGE,),
    "lidar_3d": (LEAST_RANGE,),
    "bump": (CONTACT,),
    "camera": (),
    "depth_camera": (),
}
"""Streams of the values of on-board sensors by model: a reading has those of each stream in turn."""


def on_board_stream(quantity: str, unit: str) -> Stream:
    """Return the stream of all values of an on-board sensor of another package."""
    return _on_board(quantity, unit, ())


def split_values(streams: Sequence[Stream]) -> list[slice]:
    """Return the slice of a reading's values of each of its streams: a value for each axis; all without axes."""
    ends = list(accumulate(len(stream.axes) for stream in streams))
    return [slice(end - len(stream.axes), end or None) for stream, end in zip(streams, ends, strict=True)]


DISTANCE = Stream(
    name="distance", entity="plots/distance_m/{agent}", component=SCALARS, unit="m", writer="referee", table="figures",
    title="Distance", meaning="the distance to the nearest source",
)  # fmt: skip
TRACKING_ERROR = Stream(
    name="tracking_error", entity="plots/tracking_error_m/{agent}", component=SCALARS, unit="m", writer="world",
    table="figures", title="Control error", meaning="the distance to where the controller wants the vehicle now",
)  # fmt: skip
DECISION_TIME = Stream(
    name="decision_time", entity="plots/decision_ms/{agent}", component=SCALARS, unit="ms", writer="supervisor",
    table="figures", title="Decision time", meaning="how long it took for each decision, by the clock",
)  # fmt: skip
BELIEF_MASS = Stream(
    name="belief_mass_near", entity="plots/belief_frac/{agent}", component=SCALARS, unit="frac", writer="referee",
    table="figures", meaning="the probability that a belief gives to the surroundings of the source",
)  # fmt: skip
BELIEF_DISTANCE = Stream(
    name="belief_distance", entity="plots/distance_m/{agent}/belief", component=SCALARS, unit="m", writer="referee",
    table="figures", meaning="the mean distance of the believed places to the nearest source",
)  # fmt: skip
NOTE_MODE = Stream(
    name="note_mode", entity="notes/{agent}/mode", component="StateChange:state", writer="agent", title="Mode",
    meaning="what a method says that it is doing, whenever that changes",
)  # fmt: skip
NOTE_VALUES = Stream(
    name="note_values", entity="plots/notes/{agent}/{value}", component=SCALARS, writer="agent", title="Notes",
    meaning="numbers that a method says that it decides by",
)  # fmt: skip
SERVICES = Stream(
    name="services", entity="plots/services/{port}/{field}", component=SCALARS, writer="services", table="services",
    title="Services",
    meaning="what services of other packages wrote, the wind's where it is driven, and the truth at probes",
)  # fmt: skip

POINT_CLOUDS = _places("point_clouds", "seen/{agent}/{sensor}", POINTS, "sensing", "points that a lidar saw")
RAYS = _places(
    "rays",
    POINT_CLOUDS.entity,
    LINES,
    "sensing",
    "rays of range finders and beams of lasers; those that meet nothing have no length",
)
PICTURES = Stream(
    name="pictures", entity=POINT_CLOUDS.entity, component=IMAGE, frame="world from camera", writer="cameras",
    meaning="pictures of a camera as they travelled, with its pinhole and its pose",
)  # fmt: skip

FILAMENTS = _places(
    "filaments", "gas/filaments", SPLATS, "fields", "the cloud, a row for each filament; of more than 3000 every k-th"
)
SLICES = Stream(
    name="gas_slices", entity="gas/slices/{gas}", component=GRID, unit="ppm", frame="world", writer="fields",
    meaning="the mixing ratio in the layer of the map",
)  # fmt: skip
WIND_ARROWS = _places("wind_arrows", "wind", ARROWS, "fields", "arrows in the layer of the map")
DOORS = _places("doors", "room/doors/{door}", BOXES, "events", "doors while they are closed")

EVENTS = _text("events", TEXTS, "referee", "Referee", "the referee's log")
CONTACTS = _text("contacts", TEXTS, "world", "Contacts", "what vehicles touched")
RADIO = _text("radio", TEXTS, "radio", "Radio", "texts between agents and what became of them")
FAULTS = _text("faults", TEXTS, "supervisor", "Faults", "what agents did wrong")
SUMMARY = _text("summary", DOCUMENT, "recorder", "Run", "the text, with the sandboxes at the end of the run")
LEGEND = _text("legend", DOCUMENT, "recorder", "Legend", "what each element of the views is")

STREAMS = tuple(dict.fromkeys(item for item in tuple(globals().values()) if isinstance(item, Stream)))
"""All streams but those of on-board sensors of other packages, which a run adds: `on_board_stream`."""
LOGS = (EVENTS, CONTACTS, RADIO, FAULTS)
FIGURES = (DISTANCE, TRACKING_ERROR, DECISION_TIME, BELIEF_MASS, BELIEF_DISTANCE)
