"""Gas fields that depend on time alone: closed forms."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.gas_field import NO_FILAMENTS, GasField, PointGrid
from gslcosim_services.fields.mixing_ratio import check_points

Formula = Callable[[NDArray[np.float64], float], NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class FormulaPlume:
    """One source's plume: the mixing ratio [ppm] at (m, 3) points [m] and a time [s], and the index of its gas."""

    gas_index: int
    mixing_ratio_ppm_at: Formula


class TimedField(GasField):
    """Base of gas fields that are a function of time."""

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
    def time_s(self) -> float:
        """Time of the field [s]."""
        return self._step * self._step_s

    def advance(self, n_steps: int = 1) -> None:
        """Advance by steps."""
        self._step += n_steps

    def restart(self) -> None:
        """Return to time 0."""
        self._step = 0

    def wind_m_s_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return nothing: the room's wind holds."""
        del points_world_m
        return None


class FormulaField(TimedField):
    """The sum of closed forms. Walls and cut-offs have no meaning for it."""

    def __init__(
        self, plumes_of: Callable[[int], Sequence[FormulaPlume]], gases: tuple[str, ...], *, step_s: float, seed: int
    ) -> None:
        """Build the field.

        Args:
            plumes_of: Returns the plumes of a seed.
            step_s: Length of a step [s].
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
        self.restart()

    @override
    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        points = check_points(points_world_m)
        ppm = np.zeros((len(points), len(self._gases)))
        for plume in self._plumes:
            ppm[:, plume.gas_index] += plume.mixing_ratio_ppm_at(points, self.time_s)
        return ppm

    @override
    def mixing_ratio_ppm_on_grid(self, grid: PointGrid, *, gas: int = 0, cutoff_sigma: float) -> NDArray[np.float64]:
        del cutoff_sigma
        return self.mixing_ratio_ppm_at(grid.points_m())[:, gas].reshape(grid.shape)
