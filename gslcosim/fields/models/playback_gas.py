"""Stored gas of other programs that is played back, from its block."""

import math
from pathlib import Path

from gslcosim.errors import ScenarioError
from gslcosim.fields.gas_field import GasField, Sight
from gslcosim.fields.gas_setup import GasSetup, gas_field_of_block, gases_in
from gslcosim.fields.models.formula_fields import PlaybackField
from gslcosim.fields.reading.concentration import Walls
from gslcosim.fields.stored.frame import GasFrame
from gslcosim.fields.stored.movie import MOVIE_SUFFIX, GasMovie
from gslcosim.fields.stored.playback import GasPlayback, usual_period_s
from gslcosim.scenario.models.gas import GasSpec, PlaybackGasSpec, PlaybackSpec

# Heads of stored frames name a source to a few decimetres (GSL-Bench's 004 and 006 are 0.2 m off).
_SOURCE_TOLERANCE_M = 1.0


@gas_field_of_block.register
def _playback_field(gas: PlaybackGasSpec, setup: GasSetup) -> GasField:
    spec = gas.playback
    assert spec is not None, "a GasSpec has it with this model"
    path = Path(spec.folder)
    stored = GasMovie(path, is_looping=spec.loop) if path.suffix == MOVIE_SUFFIX else _frames(path, spec)
    first = stored.frame(stored.numbers[0]) if isinstance(stored, GasPlayback) else None
    if first is not None:
        _check_frame(first, gas)
    gases = gases_in(gas)
    return PlaybackField(
        stored,
        gas.gas,
        setup.environment.grid,
        step_s=setup.step_s,
        sight=setup.sight or Sight(walls=Walls.of(setup.environment)),
        other_gases=gases[1:],
    )


def _frames(folder: Path, spec: PlaybackSpec) -> GasPlayback:
    return GasPlayback(folder, period_s=spec.period_s or usual_period_s(folder), is_looping=spec.loop)


# The run is judged by the scenario's source, and the sensors respond to the scenario's gas.
def _check_frame(frame: GasFrame, gas: GasSpec) -> None:
    if frame.gas is not None and frame.gas != gas.gas:
        raise ScenarioError(f"gas.gas: expected {frame.gas}, the gas of the stored frames, was {gas.gas}.")
    place_m = frame.source_position_m
    if place_m is None:
        return
    gap_m = min(math.dist(place_m, source.position_m) for source in gas.sources)
    if gap_m > _SOURCE_TOLERANCE_M:
        raise ScenarioError(
            f"gas.sources: expected one at {place_m} m, where the stored frames have theirs; the nearest is "
            f"{gap_m:.3g} m away."
        )
