"""Export of runs: tables as Parquet or CSV, messages of ROS 2 as MCAP or rosbag2."""
