"""ROS 2 bag files: one MCAP, or a folder of rosbag2."""

from collections.abc import Callable, Iterable
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.data.export.ros_topics import TimedMessage
from gslcosim.data.export.ros_types import REMEDY, RosTypes

# Rosbag2's own number for what bags of Humble and later look like.
_BAG_VERSION = 9
_TELL_EVERY = 2000
Progress = Callable[[int], None]


def write_mcap(messages: Iterable[TimedMessage], path: Path, types: RosTypes, progress: Progress) -> None:
    """Write messages into one MCAP file with the profile `ros2`, which Foxglove and `ros2 bag` read.

    Args:
        messages: By time.
        path: The file.
        types: Of the messages.
        progress: Receives how many have been written, now and then.

    Raises:
        UsageError: the extra `ros` is not installed.
        OSError: the machine refuses.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise UsageError(f"mcap: expected the package, found none. Install it with: {REMEDY}") from error
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="gslcosim")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for i, each in enumerate(messages):
            kind = each.message.__msgtype__
            if kind not in schemas:
                text = types.definition(kind).encode()
                schemas[kind] = writer.register_schema(name=kind, encoding="ros2msg", data=text)
            if each.topic not in channels:
                channels[each.topic] = writer.register_channel(
                    topic=each.topic, message_encoding="cdr", schema_id=schemas[kind]
                )
            data = types.to_cdr(each.message)
            writer.add_message(channels[each.topic], each.time_ns, data, publish_time=each.time_ns, sequence=i)
            if i % _TELL_EVERY == 0:
                progress(i)
        writer.finish()


def write_rosbag2(messages: Iterable[TimedMessage], folder: Path, types: RosTypes, progress: Progress) -> None:
    """Write messages into a folder of rosbag2, with SQLite and `metadata.yaml`, which `ros2 bag play` reads.

    Args:
        messages: By time.
        folder: The bag; it must not exist.
        types: Of the messages.
        progress: Receives how many have been written, now and then.

    Raises:
        OSError: the machine refuses.
    """
    from rosbags.rosbag2 import Writer

    with Writer(folder, version=_BAG_VERSION) as bag:
        connections = {}
        for i, each in enumerate(messages):
            if each.topic not in connections:
                kind = each.message.__msgtype__
                connections[each.topic] = bag.add_connection(each.topic, kind, typestore=types.store)
            bag.write(connections[each.topic], each.time_ns, types.to_cdr(each.message))
            if i % _TELL_EVERY == 0:
                progress(i)
