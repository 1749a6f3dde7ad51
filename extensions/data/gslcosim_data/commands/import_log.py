"""`gslcosim runs import`: the log of a real robot as a run."""

import argparse
from pathlib import Path

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, add_runs_dir_option
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

EXAMPLES = """  gslcosim runs import hall.csv --scenario hall.yaml
  gslcosim runs import bag_2026_05_01 --scenario hall.yaml --pose /odom --topic nose=/pid/reading"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, metavar="LOG", help="a .csv, a rosbag2 folder, a .bag or an .mcap")
    parser.add_argument(
        "--scenario",
        required=True,
        metavar="SCENARIO",
        help=("room, source, vehicle and sensors: a scenario file or a bundled scenario, with one agent"),
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="replace one value of the scenario"
    )
    parser.add_argument("--pose", metavar="TOPIC", help="for bags: topic of the pose")
    parser.add_argument(
        "--topic", action="append", default=[], metavar="SENSOR=TOPIC", help="for bags: topic of a sensor"
    )
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_data.log_readers import find_log_reader
    from gslcosim_data.log_tables import read_csv_log
    from gslcosim_data.robot_logs import import_log, load_log_scenario, log_sensors

    log = arguments.log
    if not log.exists():
        raise UsageError(f"{log}: expected a log, found none.")
    loaded = load_log_scenario(arguments.scenario, arguments.set)
    sensors = log_sensors(loaded.scenario)
    reader = find_log_reader(log)
    if reader is None and (arguments.pose or arguments.topic):
        raise UsageError(f"--pose, --topic: expected a bag of ROS, was {log.name}. Leave them out.")
    if reader is not None:
        flight = reader.read(log, sensors, pose_topic=arguments.pose, topics=dict(map(_topic, arguments.topic)))
    else:
        flight = read_csv_log(log, sensors)
    imported = import_log(flight, log, loaded, arguments.runs_dir, remark=write_note)
    if arguments.json:
        write_json(imported.result)
    else:
        for agent in imported.result["agents"]:
            write(f"{agent['name']}: {agent['outcome']}, path {agent['path_length_m']:.1f} m")
        write(str(imported.run_dir))
    return ExitCode.SUCCESS if imported.result["valid"] else ExitCode.FAULT


def _topic(text: str) -> tuple[str, str]:
    sensor, equals, topic = text.partition("=")
    if not (sensor and equals and topic):
        raise UsageError(f"--topic {text}: expected SENSOR=TOPIC, for example nose=/pid/reading.")
    return sensor, topic


COMMAND = Command(
    name="import",
    old_name="import-flight",
    summary="convert the log of a real robot to a run, judged and recorded",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
