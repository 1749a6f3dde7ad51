"""Stored gas in a run: the model `playback` with its block, the field that plays frames, and its check."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from typing_extensions import override

from gslcosim.base.errors import EnvironmentDataError, ScenarioError
from gslcosim.base.problems import Problem, broken_rule_error
from gslcosim.base.spec import Positive, Spec
from gslcosim.environment.model import Grid, point_text
from gslcosim.scenario.models.gas import GasSpec
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_formats.formula_fields import TimedField
from gslcosim_formats.stored_gas.frame_formats import GasFrame
from gslcosim_formats.stored_gas.playback import MOVIE_SUFFIX, GasMovie, GasPlayback, default_period_s, values_in_cells
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.gas_field import NO_FILAMENTS, GasField, PointGrid, Visibility
from gslcosim_services.fields.gas_setup import GasSetup, build_gas_field_from_block, list_gas_names
from gslcosim_services.fields.mixing_ratio import Walls, check_points, mixing_ratio_ppm_on_grid
from gslcosim_services.fields.spatial_index import FilamentIndex

# Heads of stored frames name a source to a few decimetres (GSL-Bench's 004 and 006 are 0.2 m off).
_SOURCE_TOLERANCE_M = 1.0


class PlaybackSpec(Spec):
    """Stored gas: a `folder` of frames of GADEN, GSL-Bench or AutoGDM+, or a movie (`.npz`), which has its own times.

    With `loop` it restarts after the last frame; otherwise the last frame stays.
    """

    folder: str = Field(description="folder of frames of GADEN, GSL-Bench or AutoGDM+, or a movie (.npz)")
    period_s: Positive | None = Field(
        default=None, description="time between frames (absent: 1 s for GSL-Bench, 0.5 s for GADEN)"
    )
    loop: bool = Field(default=False, description="restart at the first frame after the last one")


class PlaybackGasSpec(GasSpec):
    """Stored gas of other programs, played back."""

    has_releases: ClassVar[bool] = False

    model: Literal["playback"] = Field(default="playback", description="gas model")  # pyright: ignore
    playback: PlaybackSpec | None = Field(default=None, description="stored gas")

    @property
    def stored_folder(self) -> str | None:
        """The folder of frames, or the movie."""
        return self.playback.folder if self.playback is not None else None

    @model_validator(mode="after")
    def _check_playback(self) -> Self:
        if self.playback is None:
            raise broken_rule_error(
                key="playback",
                expected="a folder of frames with model: playback",
                found="none",
                remedy="For example model: playback, playback: {folder: my_frames}.",
            )
        return self


class StoredGas(Protocol):
    """Frames by time: a folder of them, or a movie."""

    def frame_at(self, time_s: float) -> GasFrame | None:
        """Return the frame that holds at a time [s]; none before the first."""
        ...


class PlaybackField(TimedField):
    """Stored gas at its true speed; see `GasField`. The seed has no meaning for it.

    Filaments are seen as live ones are; stored grids give the value of the cell that holds a point, and 0 outside.
    """

    def __init__(
        self,
        stored: StoredGas,
        gas: str,
        room: Grid,
        *,
        step_s: float,
        sight: Visibility,
        other_gases: Sequence[str] = (),
    ) -> None:
        """Play frames of one gas; of the others there is none."""
        super().__init__((gas, *other_gases), step_s)
        self._stored = stored
        self._sight = sight
        self._index = FilamentIndex(min_m=room.origin_m, max_m=room.max_m)
        self._indexed: GasFrame | None = None

    @property
    def filaments(self) -> Filaments:
        """The filaments of the frame, if it has any."""
        frame = self._frame()
        return NO_FILAMENTS if frame is None or frame.filaments is None else frame.filaments

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        del seed
        self.restart()

    @override
    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        points, frame = check_points(points_world_m), self._frame()
        ppm = np.zeros((len(points), len(self._gases)))
        if frame is None:
            return ppm
        if frame.filaments is None:
            ppm[:, 0] = values_in_cells(frame, points)
            return ppm
        if self._indexed is not frame:
            self._index.build(frame.filaments)
            self._indexed = frame
        sight = self._sight
        seen = self._index.mixing_ratio_ppm_at(points, walls=sight.walls, cutoff_sigma=sight.cutoff_sigma)
        ppm[:, 0] = seen[:, 0]
        return ppm

    @override
    def mixing_ratio_ppm_on_grid(self, grid: PointGrid, *, gas: int = 0, cutoff_sigma: float) -> NDArray[np.float64]:
        frame = self._frame()
        if frame is None or gas > 0:
            return np.zeros(grid.shape)
        if frame.filaments is None:
            return values_in_cells(frame, grid.points_m()).reshape(grid.shape)
        return mixing_ratio_ppm_on_grid(
            frame.filaments,
            first_point_m=grid.first_m,
            spacing_m=grid.spacing_m,
            shape=grid.shape,
            cutoff_sigma=cutoff_sigma,
        )

    def _frame(self) -> GasFrame | None:
        return self._stored.frame_at(self.time_s)


@build_gas_field_from_block.register
def _build_playback_field(gas: PlaybackGasSpec, setup: GasSetup) -> GasField:
    stored = load_stored_gas(gas)
    gases = list_gas_names(gas)
    return PlaybackField(
        stored,
        gas.gas,
        setup.environment.grid,
        step_s=setup.step_s,
        sight=setup.sight or Visibility(walls=Walls.of(setup.environment)),
        other_gases=gases[1:],
    )


def load_stored_gas(gas: PlaybackGasSpec) -> GasMovie | GasPlayback:
    """Return the stored gas of a block."""
    spec = gas.playback
    assert spec is not None, "a GasSpec has it with this model"
    stored = _open_stored_gas(Path(spec.folder), spec)
    if problems := _find_first_frame_problems(stored, gas):
        lines = map(str, problems)
        raise ScenarioError("\n".join(lines))
    return stored


def find_stored_gas_problems(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return why the stored gas of a scenario, if it plays any, cannot be its gas.

    Args:
        scenario: Its gas and sources.
        directory: The scenario's folder, where a relative path of the gas starts.
    """
    spec = scenario.gas.playback if isinstance(scenario.gas, PlaybackGasSpec) else None
    if spec is None:
        return []
    try:
        return _find_first_frame_problems(
            _open_stored_gas(directory / Path(spec.folder).expanduser(), spec), scenario.gas
        )
    except EnvironmentDataError as error:
        expected, remedy = "frames of gas, or a movie, that can be read", str(error).replace("\n", " ")
        return [Problem(where="gas.playback.folder", expected=expected, found=spec.folder, remedy=remedy)]


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
        problems.append(Problem(where="gas.gas", expected=expected, found=gas.gas, remedy=remedy))
    place_m = frame.source_position_m
    if place_m is None:
        return problems
    gaps_m = [math.dist(place_m, source.position_m) for source in gas.sources]
    i = gaps_m.index(min(gaps_m))
    if gaps_m[i] > _SOURCE_TOLERANCE_M:
        problems.append(
            Problem(
                where=f"gas.sources[{i}].position_m",
                expected=f"the place of the source in the stored frames, within {_SOURCE_TOLERANCE_M:g} m",
                found=f"{point_text(gas.sources[i].position_m)}, which is {gaps_m[i]:.3g} m from it",
                remedy=f"Write position_m: {point_text(place_m)}.",
            )
        )
    return problems
