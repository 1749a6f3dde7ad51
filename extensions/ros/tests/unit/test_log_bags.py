"""Bags of robot logs: every reading is the right one or is named, whatever names its type and whatever was cut off."""

import os
from dataclasses import dataclass

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_data.log_values import LoggedSensor
from gslcosim_ros.log_bags import is_bag, read_bag_log

pytestmark = pytest.mark.extras

NOSE = LoggedSensor(name="nose", parts=("ohm",))
PID = LoggedSensor(name="pid", parts=("ppm",))
BEAM = LoggedSensor(name="beam", parts=("ppm m",))
WIND = LoggedSensor(name="wind", parts=("m/s", "rad"))
SONIC = LoggedSensor(name="sonic", parts=("m/s",) * 3)
FINDER = LoggedSensor(name="finder", parts=("m",))
N = 20
UNKNOWN, VOLT, PPM, PPB, OHM, NOT_VALID = 0, 1, 3, 4, 5, 255

HEADER = "std_msgs/Header header\n"
GAS_FIELDS = HEADER + "uint8 technology\nuint8 manufacturer\nuint8 mpn\nfloat64 raw\nuint8 raw_units\n"
# Fields of ROS 1 and of ROS 2; the width of an anemometer's numbers differs between them.
GAS = {1: GAS_FIELDS + "float64 raw_air\nfloat64 calib_A\nfloat64 calib_B\n",
       2: GAS_FIELDS + "float64 raw_air\nfloat64 calib_a\nfloat64 calib_b\n"}  # fmt: skip
WIND_FIELDS = {1: HEADER + "string sensor_label\nfloat64 wind_speed\nfloat64 wind_direction\n",
               2: HEADER + "string sensor_label\nfloat32 wind_speed\nfloat32 wind_direction\n"}  # fmt: skip
BEAM_FIELDS = HEADER + "float32 average_ppmxm\nfloat32 average_reflection_strength\n"


@dataclass
class Topic:
    """A topic with `N` messages at 0.1 s, made by its fields."""

    name: str
    kind: str
    fields: object


def gas(name, kind="olfaction_msgs/msg/GasSensor", *, raw=lambda i: 50000.0 - i, units=OHM):
    def fields(make, i):
        return {"raw": raw(i), "raw_units": units}

    return Topic(name, kind, fields)


def store_of(ros):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    texts = {
        "olfaction_msgs/msg/gas_sensor": GAS[1],
        "olfaction_msgs/msg/GasSensor": GAS[ros],
        "olfaction_msgs/msg/anemometer": WIND_FIELDS[1],
        "olfaction_msgs/msg/Anemometer": WIND_FIELDS[ros],
        "olfaction_msgs/msg/TDLAS": BEAM_FIELDS,
        "olfaction_msgs/msg/gas_sensor_array": HEADER + "olfaction_msgs/gas_sensor[] sensors\n",
        "olfaction_msgs/msg/GasSensorArray": HEADER + "olfaction_msgs/GasSensor[] sensors\n",
    }
    for kind, text in texts.items():
        if kind not in store.fielddefs:
            store.register(get_types_from_msg(text, kind))
    return store


def blank(store, kind, **known):
    """Return a message of zeros and what is known."""
    from rosbags.interfaces import Nodetype

    def value(field):
        node, rest = field
        if node == Nodetype.NAME:
            return blank(store, rest)
        if node == Nodetype.BASE:
            return {"string": "", "bool": False}.get(rest[0], 0)
        (of_node, of), length = rest
        is_array = of_node == Nodetype.BASE and of[0] != "string"
        return np.zeros(length if node == Nodetype.ARRAY else 0, of[0]) if is_array else []

    fields = {name: value(field) for name, field in store.fielddefs[kind][1]}
    return store.types[kind](**{**fields, **known})


def pose(name="/pose", *, y=2.0):
    def fields(make, i):
        place = make("geometry_msgs/msg/Point", x=0.1 * i, y=y, z=1.0)
        turn = make("geometry_msgs/msg/Quaternion", w=1.0)
        return {"pose": make("geometry_msgs/msg/Pose", position=place, orientation=turn)}

    return Topic(name, "geometry_msgs/msg/PoseStamped", fields)


def messages(store, topics):
    def make(kind, **known):
        return blank(store, kind, **known)

    for i in range(N):
        for topic in topics:
            yield topic, (10**11 + i * 10**8), blank(store, topic.kind, **topic.fields(make, i))


def ros1_bag(path, *topics, compression=None):
    from rosbags.rosbag1 import Writer

    store = store_of(1)
    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer as bag:
        made = {topic.name: bag.add_connection(topic.name, topic.kind, typestore=store) for topic in topics}
        for topic, time_ns, message in messages(store, topics):
            bag.write(made[topic.name], time_ns, store.serialize_ros1(message, topic.kind))
    return path


def ros2_bag(path, *topics, mcap=False, compression=None):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store = store_of(2)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3)
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer as bag:
        made = {topic.name: bag.add_connection(topic.name, topic.kind, typestore=store) for topic in topics}
        for topic, time_ns, message in messages(store, topics):
            bag.write(made[topic.name], time_ns, store.serialize_cdr(message, topic.kind))
    return path


def idl_of(kind, struct):
    package, _, name = kind.split("/")
    return f"{'=' * 80}\nIDL: {kind}\nmodule {package} {{ module msg {{ struct {name} {{ {struct} }}; }}; }};\n"


def mcap_file(path, *topics, ros=2, idl=(), **options):
    from mcap.writer import CompressionType, Writer

    store = store_of(ros)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType[options.pop("compression", "NONE")], **options)
        writer.start()
        made = {}
        for topic in topics:
            text = store.generate_msgdef(topic.kind, ros_version=ros)[0]
            name = topic.kind if ros == 2 else topic.kind.replace("/msg/", "/")
            data, encoding = (idl[name], "ros2idl") if name in idl else (text, f"ros{ros}msg")
            schema = writer.register_schema(name=name, encoding=encoding, data=data.encode())
            encoding = "cdr" if ros == 2 else "ros1"
            made[topic.name] = writer.register_channel(topic=topic.name, message_encoding=encoding, schema_id=schema)
        write = store.serialize_cdr if ros == 2 else store.serialize_ros1
        for topic, time_ns, message in messages(store, topics):
            data = bytes(write(message, topic.kind))
            writer.add_message(channel_id=made[topic.name], log_time=time_ns, publish_time=time_ns, data=data)
        writer.finish()
    return path


def anemometer(kind="olfaction_msgs/msg/Anemometer", name="/wind"):
    return Topic(name, kind, lambda make, i: {"wind_speed": 0.5, "wind_direction": 3.0})


def check_all(log):
    assert len(log.time_s) == N
    np.testing.assert_allclose(log.position_world_m[:, 0], 0.1 * np.arange(N))
    np.testing.assert_allclose(log.instruments["nose"].values[:, 0], 50000.0 - np.arange(N))
    np.testing.assert_allclose(log.instruments["wind"].values, [[0.5, 3.0]] * N)
    assert log.remarks == ()


ROS1 = (pose(), gas("/nose", "olfaction_msgs/msg/gas_sensor"), anemometer("olfaction_msgs/msg/anemometer"))
ROS2 = (pose(), gas("/nose"), anemometer())


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
@pytest.mark.parametrize("topics", [ROS1, ROS2])
def test_bags_of_ros_1_have_their_readings(tmp_path, topics, compression):
    check_all(read_bag_log(ros1_bag(tmp_path / "walk.bag", *topics, compression=compression), [NOSE, WIND]))


@pytest.mark.parametrize("compression", [None, "FILE", "MESSAGE"])
@pytest.mark.parametrize("mcap", [False, True])
def test_bags_of_ros_2_have_their_readings(tmp_path, mcap, compression):
    check_all(read_bag_log(ros2_bag(tmp_path / "walk", *ROS2, mcap=mcap, compression=compression), [NOSE, WIND]))


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
@pytest.mark.parametrize("ros", [1, 2])
def test_mcap_files_have_their_readings(tmp_path, ros, compression):
    topics = ROS1 if ros == 1 else ROS2
    check_all(read_bag_log(mcap_file(tmp_path / "a.mcap", *topics, ros=ros, compression=compression), [NOSE, WIND]))


def test_mcap_files_need_neither_index_nor_chunks(tmp_path):
    from mcap.writer import IndexType

    bare = {"use_chunking": False, "use_statistics": False, "use_summary_offsets": False, "repeat_channels": False}
    file = mcap_file(tmp_path / "a.mcap", *ROS2, index_types=IndexType.NONE, repeat_schemas=False, **bare)
    check_all(read_bag_log(file, [NOSE, WIND]))


def test_definitions_in_idl_are_read(tmp_path):
    idl = {"std_msgs/msg/Float64": idl_of("std_msgs/msg/Float64", "double data;")}
    number = Topic("/pid", "std_msgs/msg/Float64", lambda make, i: {"data": 0.5 + i})
    log = read_bag_log(mcap_file(tmp_path / "a.mcap", pose(), number, idl=idl), [PID])
    np.testing.assert_allclose(log.instruments["pid"].values[:, 0], 0.5 + np.arange(N))


def test_a_definition_in_the_file_stands_above_that_of_a_distribution(tmp_path):
    """Wind of 64 bits, as ROS 1 has it, where the types of today have 32."""
    wind = anemometer("olfaction_msgs/msg/anemometer")
    log = read_bag_log(ros2_bag(tmp_path / "a", pose(), wind, mcap=True), [WIND])
    np.testing.assert_allclose(log.instruments["wind"].values, [[0.5, 3.0]] * N)


def test_bags_without_definitions_are_read_where_the_types_are_known(tmp_path):
    """As those of ROS 2 humble and before; an unknown type stops no other topic."""
    import sqlite3
    from contextlib import closing

    beam = Topic("/beam", "olfaction_msgs/msg/TDLAS", lambda make, i: {"average_ppmxm": 7.0})
    bag = ros2_bag(tmp_path / "a", *ROS2, beam)
    with closing(sqlite3.connect(next(bag.glob("*.db3")))) as database:
        database.execute("delete from message_definitions")
        database.commit()
    check_all(read_bag_log(bag, [NOSE, WIND]))
    with pytest.raises(UsageError, match=r"/beam: expected messages of olfaction_msgs/msg/TDLAS, was something else"):
        read_bag_log(bag, [BEAM])


def test_a_folder_of_mcap_files_needs_no_description(tmp_path):
    (bag := ros2_bag(tmp_path / "walk", *ROS2, mcap=True)).joinpath("metadata.yaml").unlink()
    check_all(read_bag_log(bag, [NOSE, WIND]))


def test_a_kind_of_file_is_known_by_its_content(tmp_path):
    file = mcap_file(tmp_path / "a.mcap", *ROS2)
    check_all(read_bag_log(file.rename(tmp_path / "a.log"), [NOSE, WIND]))
    assert is_bag(tmp_path / "a.log")
    for name, beginning, error in (
        ("a.ulg", b"ULog\x01\x12\x35\x01", "was a log of PX4. Convert it"),
        ("a.db3", b"SQLite format 3\0", "was a file of a rosbag2 folder. Name the folder"),
        ("a.zip", b"PK\x03\x04", "was a ZIP archive. Unpack it"),
        ("a.mcap", b"time_s,x_m", "expected an MCAP file, was something else"),
        ("a.bag", b"time_s,x_m", "expected a bag of ROS 1, was something else"),
        ("a.csv", b"", "expected a log, was an empty file"),
    ):
        (tmp_path / name).write_bytes(beginning)
        with pytest.raises(UsageError, match=error):
            is_bag(tmp_path / name)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8, 0.99])
@pytest.mark.parametrize("kind", ["mcap", "bag", "db3"])
def test_recordings_that_were_cut_off_are_named_with_their_repair(tmp_path, kind, share):
    if kind == "mcap":
        log = file = mcap_file(tmp_path / "walk.mcap", *ROS2)
    elif kind == "bag":
        log = file = ros1_bag(tmp_path / "walk.bag", *ROS1)
    else:
        log = ros2_bag(tmp_path / "walk", *ROS2)
        (file,) = log.glob("*.db3")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    repair = {"mcap": "mcap recover", "bag": "rosbag reindex", "db3": "ros2 bag reindex"}[kind]
    with pytest.raises(UsageError, match=f"expected a whole recording, was cut off.*{repair}"):
        read_bag_log(log, [NOSE, WIND])


def test_damaged_chunks_are_named(tmp_path):
    file = mcap_file(tmp_path / "walk.mcap", *ROS2)
    content = bytearray(file.read_bytes())
    content[content.index(np.float64(49990).tobytes())] ^= 1
    file.write_bytes(content)
    with pytest.raises(UsageError, match="crc validation failed in Chunk"):
        read_bag_log(file, [NOSE, WIND])


def test_a_folder_that_is_no_bag_is_named(tmp_path):
    with pytest.raises(UsageError, match=r"expected a folder of rosbag2 with metadata\.yaml, or \.mcap or \.bag files"):
        read_bag_log(tmp_path, [NOSE])
    ros2_bag(tmp_path / "walk", *ROS2).joinpath("metadata.yaml").unlink()
    with pytest.raises(UsageError, match=r"was cut off, damaged or never closed.*ros2 bag reindex"):
        read_bag_log(tmp_path / "walk", [NOSE])


def test_a_pipe_in_a_bag_is_not_waited_for(tmp_path):
    (file,) = ros2_bag(tmp_path / "walk", *ROS2).glob("*.db3")
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(UsageError, match="expected a whole recording"):
        read_bag_log(tmp_path / "walk", [NOSE])


def test_folders_of_bags_of_ros_1_are_one_recording(tmp_path):
    (bags := tmp_path / "bags").mkdir()
    ros1_bag(bags / "pose.bag", ROS1[0])
    ros1_bag(bags / "rest.bag", *ROS1[1:])
    check_all(read_bag_log(bags, [NOSE, WIND]))


@pytest.mark.parametrize(
    ("topic", "sensor", "expected"),
    [
        (gas("/pid", raw=lambda i: 500.0, units=PPB), PID, [0.5]),
        (gas("/pid", raw=lambda i: 0.5, units=UNKNOWN), PID, [0.5]),
        (Topic("/beam", "olfaction_msgs/msg/TDLAS", lambda make, i: {"average_ppmxm": 7.0}), BEAM, [7]),
        (Topic("/pid", "std_msgs/msg/UInt16", lambda make, i: {"data": 7}), PID, [7]),
        (Topic("/finder", "sensor_msgs/msg/Range", lambda make, i: {"range": 7.0}), FINDER, [7]),
        (
            Topic(
                "/sonic",
                "geometry_msgs/msg/Vector3Stamped",
                lambda make, i: {"vector": make("geometry_msgs/msg/Vector3", x=1.0, y=2.0, z=3.0)},
            ),
            SONIC,
            [1, 2, 3],
        ),
    ],
)
@pytest.mark.parametrize("ros", [1, 2])
def test_readings_have_the_unit_of_the_sensor(tmp_path, topic, sensor, expected, ros):
    topics = (pose(), topic)
    log = read_bag_log(
        ros1_bag(tmp_path / "a.bag", *topics) if ros == 1 else ros2_bag(tmp_path / "a", *topics), [sensor]
    )
    np.testing.assert_allclose(log.instruments[sensor.name].values, [expected] * N)


@pytest.mark.parametrize("ros", [1, 2])
def test_parts_of_an_array_are_topics(tmp_path, ros):
    one = "olfaction_msgs/msg/gas_sensor" if ros == 1 else "olfaction_msgs/msg/GasSensor"
    many = "olfaction_msgs/msg/gas_sensor_array" if ros == 1 else "olfaction_msgs/msg/GasSensorArray"

    def fields(make, i):
        return {"sensors": [make(one, raw=raw, raw_units=OHM) for raw in (100.0, 200.0)]}

    bag = mcap_file(tmp_path / "a.mcap", pose(), Topic("/enose", many, fields), ros=ros)
    log = read_bag_log(bag, [NOSE], topics={"nose": "/enose[1]"})
    assert set(log.instruments["nose"].values[:, 0]) == {200}
    assert "takes one of /enose[0], /enose[1]" in read_bag_log(bag, [NOSE]).remarks[0]


@pytest.mark.parametrize(
    ("topics", "sensors", "given", "remark"),
    [
        ((gas("/enose"),), (NOSE,), {}, "nose: expected a topic that ends with /nose, found none; it has no readings"),
        (
            (Topic("/nose", "sensor_msgs/msg/LaserScan", lambda make, i: {}),),
            (NOSE,), {}, "nose: expected a topic that ends with /nose, found /nose of sensor_msgs/msg/LaserScan",
        ),
        ((gas("/nose", raw=lambda i: -9999.0 if i == 3 else 5.0),), (NOSE,), {}, "/nose: 1 of 20 values are left out"),
        ((gas("/nose", raw=lambda i: float("inf")),), (NOSE,), {}, "/nose: 20 of 20 values are left out"),
        ((gas("/nose", units=NOT_VALID),), (NOSE,), {}, "nose: expected numbers in /nose, found none"),
    ],
)  # fmt: skip
def test_a_sensor_without_readings_is_named(tmp_path, topics, sensors, given, remark):
    log = read_bag_log(ros2_bag(tmp_path / "a", pose(), *topics), sensors, topics=given)
    assert log.remarks[0].startswith(remark)


TWO_ROBOTS = (
    pose("/a/pose"),
    pose("/b/pose", y=7.0),
    gas("/a/nose", raw=lambda i: 1.0),
    gas("/b/nose", raw=lambda i: 2.0),
)


def test_of_several_robots_the_one_with_the_pose_is_read(tmp_path):
    bag = ros2_bag(tmp_path / "a", *TWO_ROBOTS)
    log = read_bag_log(bag, [NOSE], pose_topic="/b/pose")
    assert set(log.position_world_m[:, 1]) == {7}
    assert set(log.instruments["nose"].values[:, 0]) == {2}
    with pytest.raises(UsageError, match=r"found /a/pose, /b/pose\. Say which with --pose"):
        read_bag_log(bag, [NOSE])


@pytest.mark.parametrize(
    ("topics", "given", "error"),
    [
        ((gas("/a/nose"), gas("/b/nose")), {}, r"nose: expected one topic, found /a/nose, /b/nose\. Say which"),
        ((gas("/nose", units=VOLT),), {}, r"expected values in ohm, was in V \(raw_units 1\)"),
        ((gas("/nose", units=PPM),), {}, r"expected values in ohm, was in ppm"),
        ((anemometer(name="/nose"),), {}, "expected 1 numbers in ohm, .*Anemometer has 2"),
        (
            (Topic("/nose", "sensor_msgs/msg/FluidPressure", lambda make, i: {"fluid_pressure": 1e5}),),
            {}, "expected numbers in ohm, sensor_msgs/msg/FluidPressure has Pa",
        ),
        ((gas("/a"), gas("/b")), {"nose": "/c"}, "--topic nose=/c: expected one of /a, /b in"),
        ((gas("/a"),), {"nose": "/pose"}, "expected one of /a in .*, was of geometry_msgs/msg/PoseStamped"),
        ((gas("/a"),), {"pid": "/a"}, "--topic pid: expected one of the sensors nose"),
    ],
)  # fmt: skip
def test_topics_that_cannot_be_read_are_refused(tmp_path, topics, given, error):
    with pytest.raises(UsageError, match=error):
        read_bag_log(ros2_bag(tmp_path / "a", pose(), *topics), [NOSE], topics=given)


def test_a_log_without_poses_is_refused_with_its_topics(tmp_path):
    tf = Topic("/tf", "tf2_msgs/msg/TFMessage", lambda make, i: {})
    bags = {
        r"It has /tf \(tf2_msgs/msg/TFMessage\)": [
            ros2_bag(tmp_path / "a", tf), ros2_bag(tmp_path / "b", tf, mcap=True), mcap_file(tmp_path / "a.mcap", tf),
        ],
        "It has no topics": [ros1_bag(tmp_path / "a.bag"), ros2_bag(tmp_path / "c"), mcap_file(tmp_path / "b.mcap")],
    }  # fmt: skip
    for found, logs in bags.items():
        for log in logs:
            with pytest.raises(UsageError, match=f"expected a topic with poses .*, found none. {found}"):
                read_bag_log(log, [NOSE])
    with pytest.raises(UsageError, match=r"--pose /tf: expected one of none in .*, was of tf2_msgs/msg/TFMessage"):
        read_bag_log(tmp_path / "a", [NOSE], pose_topic="/tf")
