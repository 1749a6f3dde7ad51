"""Live runs for others to step: from Python, and as services of ROS 2."""
