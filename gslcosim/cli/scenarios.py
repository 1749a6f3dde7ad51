"""Scenario arguments as several commands take them, loaded with every check there is."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.cli.parsing import whole_number

if TYPE_CHECKING:
    from gslcosim.quantities import Vec3
    from gslcosim.scenario import LoadedScenario, Scenario
    from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
    from gslcosim.scenario.problems import ProblemLike
    from gslcosim.scenario.random_places import Wanted


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario and the options that change it."""
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or the name of a bundled scenario")
    parser.add_argument("--seed", type=whole_number, metavar="N", help="replace the scenario's seed, for example 8")
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
    spec: "EnvironmentSpec", wind: "SolverSpec", scenario_dir: Path, seed: int, wanted: "Sequence[Wanted]"
) -> "Mapping[str, Vec3]":
    from gslcosim.environment.of_scenario.random_places import draw_places

    return draw_places(spec, wind, scenario_dir, seed, wanted)


def _pace_override(arguments: argparse.Namespace) -> list[str]:
    pace = getattr(arguments, "pace", None)
    return [] if pace is None else [f"pace={pace}"]


def check_places(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return what is wrong with the room of a scenario and with the places in it."""
    from gslcosim.environment.of_scenario.places import problems_of_places, problems_of_places_in
    from gslcosim.environment.situations import scenarios_of_rooms
    from gslcosim.generation import made_environment

    # To build a room once more would take a third of a second, most of it for the compiler of its kernels.
    made = [made_environment(each, scenario_dir=directory) for each in scenarios_of_rooms(scenario)]
    if made[0] is not None and all(made):
        return problems_of_places_in(scenario, made[0])
    return problems_of_places(scenario, scenario_dir=directory)


def check_methods(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return what the agents' methods lack: sensors, grants, channels, right parameters."""
    from gslcosim.sensing.method_checks import problems_of_methods

    return problems_of_methods(scenario, directory)


def check_stored_gas(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return why the gas that a scenario plays back, if it does, cannot be its gas."""
    if scenario.gas.stored is None:
        return ()  # what reads gas is slow to import
    from gslcosim.fields.models.playback_gas import problems_of_stored_gas

    return problems_of_stored_gas(scenario, directory)


def check_participants(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return what is wrong with the ports of the participants of a scenario, if it has some."""
    del directory
    if not scenario.participants:
        return ()  # what knows all ports is slow to import
    from gslcosim.runtime.assembly import participant_problems

    return participant_problems(scenario)


def check_drawing(scenario: "Scenario", directory: Path) -> "Iterable[ProblemLike]":
    """Return which cameras there are where nothing can be drawn."""
    from gslcosim.cli.machine_checks import problems_of_drawing

    return problems_of_drawing(scenario, directory)
