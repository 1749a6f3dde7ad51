"""Readers of robot logs that are no tables, registered by extensions."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.base.extensions import find_remedy, instance_of, load_registered
from gslcosim_data.log_values import RobotLog

LOG_READERS_GROUP = "gslcosim.log_readers"


@dataclass(frozen=True, kw_only=True)
class LogReader:
    """Reader of logs whose values have topics.

    Attributes:
        formats: Names of the formats: `rosbag2` for a folder, else the ending of the file.
        is_own: Whether it reads a log, by its content; raises `UsageError` for a file that is no log of any kind.
        read: Called with the log, its sensors, and by name `pose_topic` and `topics`.
    """

    formats: tuple[str, ...]
    is_own: Callable[[Path], bool]
    read: Callable[..., RobotLog]


def find_log_reader(log: Path) -> LogReader | None:
    """Return the reader of a log with topics; None where the log is a table."""
    readers = load_registered(LOG_READERS_GROUP, instance_of(LogReader), "a LogReader")
    if found := next((reader for reader in readers if reader.is_own(log)), None):
        return found
    format_name = "rosbag2" if log.is_dir() else log.suffix.removeprefix(".")
    if remedy := find_remedy("formats", f"{format_name} log"):
        raise UsageError(f"{log}: expected a log whose reader is installed. {remedy}")
    return None
