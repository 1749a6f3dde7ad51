"""ROS 2 in `gslcosim up` and `gslcosim step`: options that let nodes see a run, or step a simulation."""

import argparse

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import CommandOptions, Run, add_pace_option, load_checked
from gslcosim.cli.terminal import write_note
from gslcosim_ros.ros_graphs import ROS_DISTRIBUTIONS
from gslcosim_ros.scenario_keys import LIVE_TOPICS

# How often it is looked whether Ctrl-C was pressed.
_WAKE_UP_S = 0.5


def _add_up_options(parser: argparse.ArgumentParser) -> None:
    ros2 = parser.add_argument_group("ROS 2")
    ros2.add_argument("--ros2", action="store_true", help="publish the run as topics in a ROS 2 graph while it goes on")
    ros2.add_argument(
        "--ros-distro",
        choices=ROS_DISTRIBUTIONS,
        help="distribution of the nodes that listen (default: from the scenario, else jazzy); implies --ros2",
    )
    ros2.add_argument(
        "--ros2-truth", action="store_true", help="publish the ground truth, too, below /truth; implies --ros2"
    )


def _run_up(arguments: argparse.Namespace, run: Run) -> int:
    if arguments.ros2 or arguments.ros_distro or arguments.ros2_truth:
        arguments.set = [*arguments.set, *_ros2_overrides(arguments)]
    return run(arguments)


# The block of the scenario stays, but for what the options say.
def _ros2_overrides(arguments: argparse.Namespace) -> list[str]:
    from gslcosim.scenario import load_scenario

    if arguments.ros_distro or getattr(arguments, "ros2_truth", False):
        distro = [f"ros2.distro={arguments.ros_distro}"] if arguments.ros_distro else []
        return [*distro, *(["ros2.truth=true"] if getattr(arguments, "ros2_truth", False) else [])]
    plain = load_scenario(arguments.scenario, overrides=arguments.set, seed=arguments.seed).scenario
    return ["ros2={}"] if LIVE_TOPICS.get(plain) is None else []


def _add_step_options(parser: argparse.ArgumentParser) -> None:
    ros2 = parser.add_argument_group("ROS 2")
    ros2.add_argument(
        "--ros2",
        action="store_true",
        help="let ROS 2 nodes step it instead, by the services of simulation_interfaces and GADEN",
    )
    ros2.add_argument(
        "--ros-distro",
        choices=ROS_DISTRIBUTIONS,
        help="distribution of the nodes (default: from the scenario, else jazzy); implies --ros2",
    )
    add_pace_option(parser, default="as fast as it goes; of --ros2 while it plays")


def _run_step(arguments: argparse.Namespace, run: Run) -> int:
    if arguments.ros2 or arguments.ros_distro:
        return _serve(arguments)
    if arguments.pace is not None:
        raise UsageError("--pace: expected --ros2 with it, found none.")
    return run(arguments)


def _serve(arguments: argparse.Namespace) -> int:
    from gslcosim.simulation.simulation import Simulation
    from gslcosim_ros.node import RosSession
    from gslcosim_ros.simulation_services import PREFIX, SimulationServices
    from gslcosim_ros.types import RosTypes

    if arguments.ticks is not None:
        raise UsageError("--ticks: expected no --ros2 with it: its clients say how many.")
    arguments.processes = "one"
    arguments.set = [*arguments.set, *_ros2_overrides(arguments)]
    loaded = load_checked(arguments)
    settings = LIVE_TOPICS.get(loaded.scenario)
    assert settings is not None, "the overrides have made the block"
    # First, so that it is there while the topics of the run come and go with resets.
    with (
        RosSession.open(
            RosTypes(settings.distro), endpoint=settings.endpoint, domain=settings.domain, report=write_note
        ) as session,
        Simulation(loaded) as simulation,
    ):
        services = SimulationServices(simulation, session, pace=loaded.scenario.pace)
        write_note(f"Services {PREFIX}/…, /odor_value and /wind_value at {settings.endpoint}; Ctrl-C ends them.")
        while not services.wait_until_quit(_WAKE_UP_S):
            pass
    return 0


UP = CommandOptions(add_arguments=_add_up_options, run=_run_up)
STEP = CommandOptions(add_arguments=_add_step_options, run=_run_step)
