"""Scenario arguments as several commands take them, loaded with every check, those of this machine included."""

import argparse
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.cli.arguments import parse_whole_number

if TYPE_CHECKING:
    from gslcosim.base.quantities import Vec3
    from gslcosim.scenario import LoadedScenario, Scenario
    from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
    from gslcosim.scenario.problems import Problem, ProblemLike
    from gslcosim.scenario.random_positions import RandomPosition

PROBE_LIMIT_S = 60.0


def find_rendering_problems(scenario: "Scenario", directory: Path) -> "Iterator[Problem]":
    """Yield a problem for each camera where nothing can be drawn.

    Args:
        scenario: Its agents' sensors.
        directory: Not needed.
    """
    from gslcosim.scenario.problems import Problem

    del directory
    reason = rendering_unavailable_reason() if scenario.cameras else ""
    if not reason:
        return
    cameras = {(agent.name, sensor.name) for agent, sensor in scenario.cameras}
    for i, agent in enumerate(scenario.agents):
        for j, sensor in enumerate(agent.sensors):
            if (agent.name, sensor.name) in cameras:
                yield Problem(
                    path=f"agents[{i}].sensors[{j}].model",
                    expected=f"no {sensor.model} on a machine without EGL and OSMesa, which draw its pictures",
                    found=f"'{sensor.model}'",
                    remedy=reason,
                )


def rendering_unavailable_reason() -> str:
    """Return why no pictures can be drawn here and what helps; empty where they can. Takes half a second."""
    call = [sys.executable, "-P", "-m", "gslcosim_services.cameras.offscreen_renderer"]
    try:
        done = subprocess.run(call, capture_output=True, text=True, timeout=PROBE_LIMIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"The driver did not answer: {error}. `gslcosim doctor` tells more."
    if not done.returncode:
        return ""
    said = [line for line in done.stderr.splitlines() if line.strip()]
    return said[-1] if done.returncode > 0 and said else "The driver crashed; `gslcosim doctor` tells more."


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario and the options that change it."""
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or the name of a bundled scenario")
    parser.add_argument(
        "--seed", type=parse_whole_number, metavar="N", help="replace the scenario's seed, for example 8"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace one value, as often as needed, for example agents[0].vehicle.hold_s=1",
    )


def add_pace_option(parser: argparse.ArgumentParser, default: str = "as fast as it goes") -> None:
    """Add the option that lets simulated time follow the clock."""
    parser.add_argument(
        "--pace",
        metavar="FACTOR",
        help=f"simulated seconds in a second, the same as --set pace=FACTOR (default: {default})",
    )


def load_checked(arguments: argparse.Namespace) -> "LoadedScenario":
    """Return the scenario of a command line.

    Raises:
        ScenarioError: there is none, or it has problems.
    """
    from gslcosim.scenario import load_scenario

    # Where services are started elsewhere, pictures are drawn there too.
    named = {name.strip() for words in getattr(arguments, "elsewhere", ()) for name in words.split(",")}
    draws_here = not named & {"all", "cameras"}
    return load_scenario(
        arguments.scenario,
        overrides=[*arguments.set, *_pace_override(arguments)],
        seed=arguments.seed,
        checks=(
            check_places,
            check_methods,
            check_stored_gas,
            check_participants,
            *((check_drawing,) if draws_here else ()),
        ),
        placer=_draw_places,
    )


# What draws needs a compiler; most scenarios name their places.
def _draw_places(
    spec: "EnvironmentSpec", wind: "SolverSpec", scenario_dir: Path, seed: int, wanted: "Sequence[RandomPosition]"
) -> "Mapping[str, Vec3]":
    from gslcosim.environment.build.random_positions import draw_positions

    return draw_positions(spec, wind, scenario_dir, seed, wanted)


def _pace_override(arguments: argparse.Namespace) -> list[str]:
    pace = getattr(arguments, "pace", None)
    return [] if pace is None else [f"pace={pace}"]


def check_places(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return what is wrong with the room of a scenario and with the places in it."""
    from gslcosim.environment.build.position_checks import find_position_problems, find_position_problems_in
    from gslcosim.environment.generation import find_environment
    from gslcosim.environment.variants.variant import variant_scenarios

    # To build a room once more would take a third of a second, most of it for the compiler of its kernels.
    made = [find_environment(each, scenario_dir=directory) for each in variant_scenarios(scenario)]
    if made[0] is not None and all(made):
        return find_position_problems_in(scenario, made[0])
    return find_position_problems(scenario, scenario_dir=directory)


def check_methods(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return what the agents' methods lack: sensors, grants, channels, right parameters."""
    from gslcosim_services.sensing.method_checks import find_method_problems

    return find_method_problems(scenario, directory)


def check_stored_gas(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return why the gas that a scenario plays back, if it does, cannot be its gas."""
    if scenario.gas.stored is None:
        return ()  # what reads gas is slow to import
    from gslcosim_services.fields.models.playback_gas import find_stored_gas_problems

    return find_stored_gas_problems(scenario, directory)


def check_participants(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return what is wrong with the ports of the participants of a scenario, if it has some."""
    del directory
    if not scenario.participants:
        return ()  # what knows all ports is slow to import
    from gslcosim.runtime.services import find_participant_problems

    return find_participant_problems(scenario)


def check_drawing(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return which cameras there are where nothing can be drawn."""
    # its import is of this module

    return find_rendering_problems(scenario, directory)
