"""Logs of robots as bags of ROS 1 and ROS 2 and as MCAP files."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.base.files import open_regular_file, read_regular_file
from gslcosim_data.log_readers import LogReader
from gslcosim_data.log_values import Floats, LoggedSensor, LoggedValues, Remarks, RobotLog, find_unit
from gslcosim_ros.types import REMEDY, RosTypes, ros_types

_NS = 1e-9
_MICROTESLA = 1e6
_MAX_CHUNK_BYTES = 1 << 30
# Beginnings of files that are no tables, and what each is; the first two can be read.
_BEGINNINGS = {
    b"\x89MCAP": ".mcap",
    b"#ROSBAG": ".bag",
    b"SQLite format 3": "a file of a rosbag2 folder. Name the folder",
    b"ULog": "a log of PX4. Convert it to CSV with `ulog2csv`, and name its columns",
    b"PK\x03\x04": "a ZIP archive. Unpack it",
    b"\x1f\x8b": "compressed by gzip. Unpack it",
    b"\x28\xb5\x2f\xfd": "compressed by zstd. Unpack it",
}
_READABLE = {".mcap": "an MCAP file", ".bag": "a bag of ROS 1"}
# What has a pose, in the order in which it is chosen where no topic is given.
_POSES: dict[str, Callable[[Any], Any]] = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
}
# Units of olfaction_msgs/GasSensor by their numbers, as names of columns spell them.
_UNKNOWN, _NOT_VALID = 0, 255
_GAS_UNITS = {1: "v", 2: "amp", 3: "ppm", 4: "ppb", 5: "ohm", 6: "ppm_m", 100: "c", 101: "rh"}
_GAS_SENSOR = "olfaction_msgs/msg/GasSensor"
_GAS_SENSORS = "olfaction_msgs/msg/GasSensorArray"
_NUMBERS = ("Float32", "Float64", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64")
_Message = Callable[[], Any]
# Tools that repair what was cut off, by the kind.
_REPAIRS = {".mcap": "`mcap recover`", ".bag": "`rosbag reindex`"}
# Between the parts of a definition.
_RULE = "=" * 80 + "\n"


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """How a message type is read: its numbers, and the unit of each; None where they depend on the sensor."""

    values: Callable[[Any], tuple[float, ...]]
    parts: tuple[str, ...] | None = None


def _xyz(vector: Any) -> tuple[float, float, float]:
    return (vector.x, vector.y, vector.z)


_VALUES: dict[str, _Kind] = {
    _GAS_SENSOR: _Kind(values=lambda m: (m.raw,)),
    "olfaction_msgs/msg/Anemometer": _Kind(values=lambda m: (m.wind_speed, m.wind_direction), parts=("m/s", "rad")),
    "olfaction_msgs/msg/TDLAS": _Kind(values=lambda m: (m.average_ppmxm,), parts=("ppm m",)),
    **{f"std_msgs/msg/{number}": _Kind(values=lambda m: (m.data,)) for number in _NUMBERS},
    "sensor_msgs/msg/FluidPressure": _Kind(values=lambda m: (m.fluid_pressure,), parts=("Pa",)),
    "sensor_msgs/msg/Range": _Kind(values=lambda m: (m.range,), parts=("m",)),
    "sensor_msgs/msg/MagneticField": _Kind(
        values=lambda m: tuple(_MICROTESLA * part for part in _xyz(m.magnetic_field)), parts=("uT",) * 3
    ),
    "sensor_msgs/msg/Imu": _Kind(
        values=lambda m: (*_xyz(m.linear_acceleration), *_xyz(m.angular_velocity)),
        parts=("m/s^2",) * 3 + ("rad/s",) * 3,
    ),
    "geometry_msgs/msg/Vector3Stamped": _Kind(values=lambda m: _xyz(m.vector)),
}


# ROS 1 and ROS 2 spell one name as `olfaction_msgs/gas_sensor` and `olfaction_msgs/msg/GasSensor`.
def _fold(kind: str) -> tuple[str, str]:
    package, _, name = kind.partition("/")
    return package, name.rpartition("/")[2].replace("_", "").lower()


_KINDS = {_fold(kind): kind for kind in (*_POSES, *_VALUES, _GAS_SENSORS)}


@dataclass
class _Topic:
    """Messages of one topic by time [s], decoded when called; the type as ROS 2 names it where it can be read."""

    kind: str
    messages: list[tuple[float, _Message]] = field(default_factory=list[tuple[float, _Message]])

    def decode(self, name: str, path: Path) -> list[tuple[float, Any]]:
        """Return the messages' times [s] and contents."""
        try:
            return [(time_s, message()) for time_s, message in self.messages]
        except Exception as error:
            raise UsageError(
                f"{path}: {name}: expected messages of {self.kind}, was something else ({error}). Record the topic "
                "with the definitions of its types, for example as MCAP."
            ) from error


def is_bag(path: Path) -> bool:
    """Return whether a log is a bag or an MCAP file, by its content; else it is a table."""
    return path.is_dir() or _find_kind(path) is not None


def _find_kind(path: Path) -> str | None:
    try:
        with open_regular_file(path) as file:
            beginning = file.read(16)
    except OSError as error:
        raise UsageError(f"{path}: expected a log that can be read, {error.strerror}.") from error
    if not beginning:
        raise UsageError(f"{path}: expected a log, was an empty file.")
    kind = next((kind for magic, kind in _BEGINNINGS.items() if beginning.startswith(magic)), None)
    if kind not in (*_READABLE, None):
        raise UsageError(f"{path}: expected a table, a rosbag2 folder, a .bag or an .mcap, was {kind}.")
    if path.suffix in _READABLE and kind != path.suffix:
        raise UsageError(f"{path}: expected {_READABLE[path.suffix]}, was something else.")
    return kind


def read_bag_log(
    path: Path,
    sensors: Sequence[LoggedSensor],
    *,
    pose_topic: str | None = None,
    topics: Mapping[str, str] | None = None,
) -> RobotLog:
    """Read a log.

    Args:
        path: A folder of rosbag2, a `.bag` of ROS 1, or an `.mcap` with messages of ROS 1 or 2.
        pose_topic: Which topic has the pose; absent: the only one with poses, Odometry first.
        topics: By the sensors' names their topics; absent ones have the topic whose last part is their name. The parts
            of an array of gas sensors are topics of their own, such as `/enose[0]`.
    """
    remarks = Remarks()
    found: dict[str, _Topic] = {}
    for topic, name, time_ns, message in _messages(path, ros_types()):
        kind = _KINDS.get(_fold(name), name)
        for part, one in _parts_of(topic, kind, message, path):
            held = found.setdefault(part, _Topic(kind=kind if part == topic else _GAS_SENSOR))
            if one is not None:
                held.messages.append((time_ns * _NS, one))
    pose_topic = _pose_topic(found, pose_topic, path)
    time_s, place_m, turns = _poses(
        found[pose_topic].decode(pose_topic, path), found[pose_topic].kind, pose_topic, remarks
    )
    chosen = _topics_of(sensors, found, topics or {}, pose_topic, path, remarks)
    instruments = {
        sensor.name: logged
        for sensor in sensors
        if (topic := chosen.get(sensor.name)) is not None
        and (logged := _logged(sensor, topic, found[topic].kind, found[topic].decode(topic, path), remarks)) is not None
    }
    return RobotLog(
        time_s=time_s,
        position_world_m=place_m,
        quaternion_wxyz=turns,
        instruments=instruments,
        remarks=tuple(remarks.texts),
    )


# A topic without messages, or with messages that cannot be read, has one without content.
def _parts_of(topic: str, kind: str, message: _Message | None, path: Path) -> Iterator[tuple[str, _Message | None]]:
    if kind == _GAS_SENSORS and message is not None:
        ((_, array),) = _Topic(kind=kind, messages=[(0.0, message)]).decode(topic, path)
        for i, one in enumerate(array.sensors):
            yield f"{topic}[{i}]", partial(_return, one)
    else:
        yield topic, message


def _return(message: Any) -> Any:
    return message


def _messages(path: Path, types: RosTypes) -> Iterator[tuple[str, str, int, _Message | None]]:
    """Yield topic, type, time [ns] and message by time; the message is None where its topic is only named."""
    files, kind = [path], None if path.is_dir() else _find_kind(path)
    if path.is_dir():
        files = sorted(path.glob("*.mcap")) or sorted(path.glob("*.bag"))
        kind = files[0].suffix if files else None
        if not files and not (path / "metadata.yaml").is_file() and not any(path.glob("*.db3*")):
            raise UsageError(
                f"{path}: expected a folder of rosbag2 with metadata.yaml, or .mcap or .bag files, found neither."
            )
    elif kind == ".bag" and path.suffix != kind:
        raise UsageError(f"{path}: expected a name that ends with .bag. Rename it; after a crash, `rosbag reindex` it.")
    try:
        # The package reads MCAP through the index only, which may lack messages, and checks no sums.
        if kind == ".mcap" and not _compresses_messages(path):
            found = [one for file in files for one in _of_mcap(file, types)]
            yield from sorted(found, key=lambda one: one[2])
        else:
            yield from _of_bag(files if kind == ".bag" else [path], types)
    except UsageError:
        raise
    # Of readers that have an error for each part of a file, and not for all of them.
    except Exception as error:
        repair = _REPAIRS.get(kind or "", "`ros2 bag reindex`")
        raise UsageError(
            f"{path}: expected a whole recording, was cut off, damaged or never closed "
            f"({str(error) or type(error).__name__}). Repair it with {repair}, or record it again."
        ) from error


# Then each message is compressed, which stands in the bag's description alone.
def _compresses_messages(path: Path) -> bool:
    description = path / "metadata.yaml"
    return description.is_file() and b"COMPRESSION_MODE: MESSAGE" in read_regular_file(description).upper()


def _of_bag(paths: list[Path], types: RosTypes) -> Iterator[tuple[str, str, int, _Message | None]]:
    from rosbags.highlevel import AnyReader

    # The package would wait for a pipe in place of a file.
    for file in paths[0].iterdir() if paths[0].is_dir() else paths:
        if not file.is_dir():
            open_regular_file(file).close()
    if (description := paths[0] / "metadata.yaml").is_file():
        listed = read_regular_file(description)
        if left := sorted(file.name for file in paths[0].glob("*.db3") if file.name.encode() not in listed):
            raise UsageError(
                f"{paths[0]}: expected all files in metadata.yaml, lacks {', '.join(left)}. Run `ros2 bag reindex`."
            )
    with AnyReader(paths, default_typestore=types.store) as bag:
        for connection in bag.connections:
            yield connection.topic, connection.msgtype, 0, None
        # An empty list would mean all.
        read = bag.typestore.deserialize_cdr if bag.is2 else bag.typestore.deserialize_ros1
        if wanted := [c for c in bag.connections if _fold(c.msgtype) in _KINDS]:
            for connection, time_ns, data in bag.messages(connections=wanted):
                yield connection.topic, connection.msgtype, time_ns, partial(read, data, connection.msgtype)


def _of_mcap(path: Path, types: RosTypes) -> Iterator[tuple[str, str, int, _Message | None]]:
    try:
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader
    except ImportError as error:
        raise UsageError(f"mcap: expected the package, found none. Install it with: {REMEDY}") from error
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, str, Callable[[bytes], Any] | None]] = {}
    with open_regular_file(path) as file:
        _check_chunks(file)
        # From begin to end, without the index, which lacks what came before a crash.
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and record.id not in channels:
                schema = schemas.get(record.schema_id)
                name = "a type without a schema" if schema is None else schema.name
                channels[record.id] = (record.topic, name, _decoder(schema, record.message_encoding, types))
                yield record.topic, name, 0, None
            elif isinstance(record, Message):
                topic, name, decode = channels[record.channel_id]
                if decode is not None:
                    yield topic, name, record.log_time, partial(decode, record.data)


# A chunk of some bytes may unpack to any number of them; the reader trusts its own statement of its size.
def _check_chunks(file: BinaryIO) -> None:
    import lz4.frame
    import zstandard
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    for chunk in StreamReader(file, emit_chunks=True, record_size_limit=_MAX_CHUNK_BYTES).records:
        if isinstance(chunk, Chunk):
            sizes = [chunk.uncompressed_size]
            if chunk.compression == "zstd":
                sizes.append(zstandard.frame_content_size(chunk.data))
            elif chunk.compression == "lz4":
                unpacker = lz4.frame.LZ4FrameDecompressor()
                sizes.append(len(unpacker.decompress(chunk.data, max_length=_MAX_CHUNK_BYTES + 1)))
            if max(sizes) > _MAX_CHUNK_BYTES:
                raise ValueError(f"a chunk that unpacks to more than {_MAX_CHUNK_BYTES >> 20} MB")
    file.seek(0)


# By the definition in the file: fields of one name differ between distributions.
def _decoder(schema: Any, encoding: str, types: RosTypes) -> Callable[[bytes], Any] | None:
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if schema is None or _fold(schema.name) not in _KINDS or encoding not in ("cdr", "ros1"):
        return None
    package, *_, name = schema.name.split("/")
    full_name, text = f"{package}/msg/{name}", schema.data.decode()
    store = types.store
    if text.strip():
        store = get_typestore(Stores.EMPTY)
        if schema.encoding == "ros2idl":
            # Each part has a line with its name above.
            parts = [part.partition("\n")[2] if part.startswith("IDL: ") else part for part in text.split(_RULE)]
            found = [get_types_from_idl(part) for part in parts if part.strip()]
        else:
            found = [get_types_from_msg(text, full_name)]
        store.register({kind: fields for types_ in found for kind, fields in types_.items()})
    read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    return lambda data: read(data, full_name)


def _pose_topic(found: Mapping[str, _Topic], wanted: str | None, path: Path) -> str:
    posed = {topic: one.kind for topic, one in found.items() if one.kind in _POSES}
    if wanted is not None:
        if wanted not in posed:
            candidates = ", ".join(sorted(posed)) or "none"
            raise UsageError(f"--pose {wanted}: expected one of {candidates} in {path}{_kind_of(found, wanted)}.")
        return wanted
    for kind in _POSES:
        some = sorted(topic for topic, its_kind in posed.items() if its_kind == kind and found[topic].messages)
        if len(some) == 1:
            return some[0]
        if some:
            raise UsageError(f"{path}: expected one topic with {kind}, found {', '.join(some)}. Say which with --pose.")
    topics = ", ".join(f"{topic} ({one.kind})" for topic, one in sorted(found.items())) or "no topics"
    raise UsageError(f"{path}: expected a topic with poses ({', '.join(_POSES)}), found none. It has {topics}.")


def _kind_of(found: Mapping[str, _Topic], topic: str) -> str:
    return f", was of {found[topic].kind}" if topic in found else ""


def _poses(messages: list[tuple[float, Any]], kind: str, name: str, remarks: Remarks) -> tuple[Floats, Floats, Floats]:
    poses = [(time_s, _POSES[kind](message)) for time_s, message in messages]
    time_s = np.array([time_s for time_s, _ in poses], dtype=np.float64)
    place_m = np.array([_xyz(pose.position) for _, pose in poses], dtype=np.float64).reshape(-1, 3)
    turns = np.array([(q.w, *_xyz(q)) for q in (pose.orientation for _, pose in poses)], dtype=np.float64).reshape(
        -1, 4
    )
    for axis, letter in enumerate("xyz"):
        place_m[:, axis] = remarks.without_fills(
            f"{name} {letter}", "m", place_m[:, axis], lambda i: f"at {time_s[i]:.9g} s"
        )
    is_placed = np.isfinite(place_m).all(axis=1)
    # Nodes that know no attitude leave it empty.
    lengths = np.linalg.norm(turns, axis=1)
    turns[~(np.isfinite(lengths) & (lengths > 0))] = (1, 0, 0, 0)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return time_s[is_placed], place_m[is_placed], turns[is_placed]


def _topics_of(
    sensors: Sequence[LoggedSensor],
    found: Mapping[str, _Topic],
    given: Mapping[str, str],
    pose_topic: str,
    path: Path,
    remarks: Remarks,
) -> dict[str, str]:
    names = [sensor.name for sensor in sensors]
    if unknown := [name for name in given if name not in names]:
        raise UsageError(f"--topic {unknown[0]}: expected one of the sensors {', '.join(names)}.")
    usable = sorted(topic for topic, one in found.items() if one.kind in _VALUES)
    candidates = ", ".join(usable) or "none"
    for sensor, topic in given.items():
        if topic not in usable:
            raise UsageError(
                f"--topic {sensor}={topic}: expected one of {candidates} in {path}{_kind_of(found, topic)}."
            )
    chosen = dict(given)
    for sensor in sensors:
        if sensor.name in chosen:
            continue
        # True values of our own bags are no readings.
        own = [one for one in found if f"/{one}".endswith(f"/{sensor.name}") and not one.startswith("/truth/")]
        fitting = [topic for topic in own if topic in usable]
        # Of several robots, the one whose pose it is.
        near = [topic for topic in fitting if topic.rpartition("/")[0] == pose_topic.rpartition("/")[0]]
        if len(fitting) == 1 or len(near) == 1:
            (chosen[sensor.name],) = fitting if len(fitting) == 1 else near
        elif fitting:
            raise UsageError(
                f"{path}: {sensor.name}: expected one topic, found {', '.join(sorted(fitting))}. Say which with "
                f"--topic {sensor.name}=TOPIC."
            )
        elif not sensor.is_estimate:
            was = f"{own[0]} of {found[own[0]].kind}" if own else "none"
            remarks.texts.append(
                f"{sensor.name}: expected a topic that ends with /{sensor.name}, found {was}; it has no readings. "
                f"--topic {sensor.name}=TOPIC takes one of {candidates}."
            )
    return chosen


def _logged(
    sensor: LoggedSensor, name: str, type_name: str, messages: list[tuple[float, Any]], remarks: Remarks
) -> LoggedValues | None:
    kind = _VALUES[type_name]
    if not messages:
        remarks.texts.append(f"{sensor.name}: expected messages of {name}, found none; it has no readings.")
        return None
    values = np.array([kind.values(message) for _, message in messages], dtype=np.float64)
    if values.shape[1] != len(sensor.parts):
        raise UsageError(
            f"--topic {sensor.name}={name}: expected {len(sensor.parts)} numbers in {sensor.units}, {type_name} has "
            f"{values.shape[1]}."
        )
    if kind.parts not in (None, sensor.parts):
        raise UsageError(
            f"--topic {sensor.name}={name}: expected numbers in {sensor.units}, {type_name} has "
            f"{', '.join(dict.fromkeys(kind.parts))}. Name another topic."
        )
    if type_name == _GAS_SENSOR:
        values *= _gas_factors(sensor, name, [message for _, message in messages])[:, None]
    time_s = np.array([time_s for time_s, _ in messages])
    for i, limits in enumerate(sensor.limits):
        values[:, i] = remarks.without_fills(name, limits, values[:, i], lambda i: f"at {time_s[i]:.9g} s")
    is_there = np.isfinite(values).all(axis=1)
    if not is_there.any():
        remarks.texts.append(f"{sensor.name}: expected numbers in {name}, found none; it has no readings.")
        return None
    return LoggedValues(time_s=time_s[is_there], values=values[is_there])


def _gas_factors(sensor: LoggedSensor, name: str, messages: list[Any]) -> Floats:
    factors: dict[int, float] = {_UNKNOWN: 1.0, _NOT_VALID: np.nan}
    for number in {int(message.raw_units) for message in messages} - factors.keys():
        unit = find_unit(_GAS_UNITS.get(number, ""))
        if unit is None or unit[0] != sensor.parts[0]:
            was = "no unit" if unit is None else unit[0]
            raise UsageError(
                f"--topic {sensor.name}={name}: expected values in {sensor.units}, was in {was} (raw_units {number}). "
                "Name another topic, or give the scenario a sensor with that unit."
            )
        factors[number] = unit[1]
    return np.array([factors[int(message.raw_units)] for message in messages])


READER = LogReader(formats=("rosbag2", "bag", "mcap"), is_own=is_bag, read=read_bag_log)
