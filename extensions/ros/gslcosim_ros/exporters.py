"""Formats that this package registers for runs: messages of ROS 2 in bags."""

from gslcosim.base.exporters import Exporter

EXPORTERS = (
    Exporter(
        name="mcap", of="run", summary="ROS 2 messages as one MCAP", function="gslcosim_ros.bag_export:export_bag"
    ),
    Exporter(
        name="rosbag2", of="run", summary="the same as a rosbag2 folder", function="gslcosim_ros.bag_export:export_bag"
    ),
)
