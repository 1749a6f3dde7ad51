"""ROS 2 graphs that a run can join: distributions, and where their nodes look for a router."""

from typing import Literal, get_args

RosDistribution = Literal["humble", "jazzy", "kilted"]
ROS_DISTRIBUTIONS: tuple[RosDistribution, ...] = get_args(RosDistribution)

ROS_ENDPOINT = "tcp/localhost:7447"
"""Where nodes of `rmw_zenoh` look for their router."""
