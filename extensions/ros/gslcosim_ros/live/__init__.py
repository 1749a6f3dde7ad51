"""Topics of a run in a ROS 2 graph, while it goes on."""
