"""Gas played back from storage, from its block, and the checks of what is stored."""

import math
from pathlib import Path

from gslcosim.base.errors import EnvironmentDataError, ScenarioError
from gslcosim.environment.grid import point_text
from gslcosim.scenario.models.gas import GasSpec, PlaybackGasSpec, PlaybackSpec
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.problems import Problem
from gslcosim_services.fields.concentration.mixing_ratio import Walls
from gslcosim_services.fields.gas_field import GasField, Visibility
from gslcosim_services.fields.gas_setup import GasSetup, build_gas_field_from_block, list_gas_names
from gslcosim_services.fields.models.formula_fields import PlaybackField
from gslcosim_services.fields.stored.frame_formats import GasFrame
from gslcosim_services.fields.stored.playback import MOVIE_SUFFIX, GasMovie, GasPlayback, default_period_s

# Heads of stored frames name a source to a few decimetres (GSL-Bench's 004 and 006 are 0.2 m off).
_SOURCE_TOLERANCE_M = 1.0


@build_gas_field_from_block.register
def _build_playback_field(gas: PlaybackGasSpec, setup: GasSetup) -> GasField:
    spec = gas.playback
    assert spec is not None, "a GasSpec has it with this model"
    path = Path(spec.folder)
    stored = _open_stored_gas(path, spec)
    if problems := _find_first_frame_problems(stored, gas):
        lines = (f"{p.path}: expected {p.expected}, was {p.found}. {p.remedy}".rstrip() for p in problems)
        raise ScenarioError("\n".join(lines))
    gases = list_gas_names(gas)
    return PlaybackField(
        stored,
        gas.gas,
        setup.environment.grid,
        step_s=setup.step_s,
        sight=setup.sight or Visibility(walls=Walls.of(setup.environment)),
        other_gases=gases[1:],
    )


def find_stored_gas_problems(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return why the stored gas of a scenario, if it plays any, cannot be its gas.

    Args:
        scenario: Its gas and sources.
        directory: The scenario's folder, where a relative path of the gas starts.
    """
    spec = scenario.gas.stored
    if spec is None:
        return []
    try:
        return _find_first_frame_problems(
            _open_stored_gas(directory / Path(spec.folder).expanduser(), spec), scenario.gas
        )
    except EnvironmentDataError as error:
        expected, remedy = "frames of gas, or a movie, that can be read", str(error).replace("\n", " ")
        return [Problem(path="gas.playback.folder", expected=expected, found=spec.folder, remedy=remedy)]


def _open_stored_gas(path: Path, spec: PlaybackSpec) -> GasMovie | GasPlayback:
    if path.suffix == MOVIE_SUFFIX:
        return GasMovie(path, is_looping=spec.loop)
    return GasPlayback(path, period_s=spec.period_s or default_period_s(path), is_looping=spec.loop)


# A movie does not say which gas it shows, and from where.
def _find_first_frame_problems(stored: GasMovie | GasPlayback, gas: GasSpec) -> list[Problem]:
    return _find_frame_problems(stored.frame(stored.numbers[0]), gas) if isinstance(stored, GasPlayback) else []


# The run is judged by the scenario's source, and the sensors respond to the scenario's gas.
def _find_frame_problems(frame: GasFrame, gas: GasSpec) -> list[Problem]:
    problems: list[Problem] = []
    if frame.gas is not None and frame.gas != gas.gas:
        expected = f"{frame.gas}, the gas of the stored frames"
        remedy = f"Write gas: {frame.gas}."
        problems.append(Problem(path="gas.gas", expected=expected, found=gas.gas, remedy=remedy))
    place_m = frame.source_position_m
    if place_m is None:
        return problems
    gaps_m = [math.dist(place_m, source.position_m) for source in gas.sources]
    i = gaps_m.index(min(gaps_m))
    if gaps_m[i] > _SOURCE_TOLERANCE_M:
        problems.append(
            Problem(
                path=f"gas.sources[{i}].position_m",
                expected=f"the place of the source in the stored frames, within {_SOURCE_TOLERANCE_M:g} m",
                found=f"{point_text(gas.sources[i].position_m)}, which is {gaps_m[i]:.3g} m from it",
                remedy=f"Write position_m: {point_text(place_m)}.",
            )
        )
    return problems
