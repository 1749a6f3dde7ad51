"""Gas fields that depend on time alone: closed forms, and playback of stored gas."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim_services.fields.concentration.mixing_ratio import check_points, mixing_ratio_ppm_on_grid
from gslcosim_services.fields.concentration.spatial_index import FilamentIndex
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.gas_field import NO_FILAMENTS, PointGrid, Visibility
from gslcosim_services.fields.stored.frame_formats import GasFrame
from gslcosim_services.fields.stored.playback import values_in_cells

Formula = Callable[[NDArray[np.float64], float], NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class FormulaPlume:
    """One source's plume: the mixing ratio [ppm] at (m, 3) points [m] and a time [s], and which gas it is."""

    gas_index: int
    mixing_ratio_ppm_at: Formula


class _TimedField:
    # What fields have in common that are read off at a time rather than moved.
    def __init__(self, gases: tuple[str, ...], step_s: float) -> None:
        self._gases = gases
        self._step_s = step_s
        self._step = 0

    @property
    def gases(self) -> tuple[str, ...]:
        """Names of the gases."""
        return self._gases

    @property
    def step(self) -> int:
        """Number of steps made."""
        return self._step

    @property
    def _time_s(self) -> float:
        return self._step * self._step_s

    def advance(self, n_steps: int = 1) -> None:
        """Go on by steps."""
        self._step += n_steps

    def _restart(self) -> None:
        self._step = 0

    def wind_m_s_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return nothing: the room's wind holds."""
        del points_world_m
        return None


class FormulaField(_TimedField):
    """The sum of closed forms; see `GasField`. Walls and cut-offs have no meaning for it."""

    def __init__(
        self, plumes_of: Callable[[int], Sequence[FormulaPlume]], gases: tuple[str, ...], *, step_s: float, seed: int
    ) -> None:
        """Build the field.

        Args:
            plumes_of: Returns the plumes of a seed.
            gases: Names of the gases.
            step_s: Length of a step [s].
            seed: The first seed.
        """
        super().__init__(gases, step_s)
        self._plumes_of = plumes_of
        self._plumes = plumes_of(seed)

    @property
    def filaments(self) -> Filaments:
        """None."""
        return NO_FILAMENTS

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self._plumes = self._plumes_of(seed)
        self._restart()

    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mixing ratios at points; see `GasField`."""
        points = check_points(points_world_m)
        ppm = np.zeros((len(points), len(self._gases)))
        for plume in self._plumes:
            ppm[:, plume.gas_index] += plume.mixing_ratio_ppm_at(points, self._time_s)
        return ppm

    def mixing_ratio_ppm_on_grid(self, grid: PointGrid, *, gas: int = 0, cutoff_sigma: float) -> NDArray[np.float64]:
        """Return the mixing ratio of one gas on a grid; see `GasField`."""
        del cutoff_sigma
        return self.mixing_ratio_ppm_at(grid.points_m())[:, gas].reshape(grid.shape)


class StoredGas(Protocol):
    """Frames by time: a folder of them, or a movie."""

    def frame_at(self, time_s: float) -> GasFrame | None:
        """Return the frame that holds at a time [s]; none before the first."""
        ...


class PlaybackField(_TimedField):
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
        self._restart()

    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mixing ratios at points; see `GasField`."""
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

    def mixing_ratio_ppm_on_grid(self, grid: PointGrid, *, gas: int = 0, cutoff_sigma: float) -> NDArray[np.float64]:
        """Return the mixing ratio of one gas on a grid; see `GasField`."""
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
        return self._stored.frame_at(self._time_s)
