# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Gas field of filaments as sensors read it, computed ahead while its readers wait."""

from collections import deque
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ModelError
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.model import AT_START, Closed, Grid
from gslcosim_services.fields.filament.downwash import Jets
from gslcosim_services.fields.filament.plume import FilamentPlume, Filaments, WindAt
from gslcosim_services.fields.gas_field import PointGrid, Visibility
from gslcosim_services.fields.mixing_ratio import (
    check_points,
    mixing_ratio_and_size_at,
    mixing_ratio_ppm_on_grid,
)
from gslcosim_services.fields.spatial_index import FilamentIndex
from gslcosim_services.fields.turbulence.point_turbulence import PointTurbulence
from gslcosim_services.fields.wall_images import WallImages, add_imaged_filaments_at_points_inplace

# From so many readings of one instant on, sorting the filaments first costs less than a sum over all of them.
MIN_READINGS_FOR_INDEX = 4
MAX_PREFETCHED_FRAMES = 64


@numba.njit(cache=True, nogil=True)
def rows_in_single_precision(position_m, sigma_m):
    """Return (n, 4) float32 rows of x, y, z and sigma [m] from (n, 3) places and (n,) sizes."""
    rows = np.empty((len(sigma_m), 4), np.float32)
    for i in range(len(sigma_m)):
        rows[i, 0] = position_m[i, 0]
        rows[i, 1] = position_m[i, 1]
        rows[i, 2] = position_m[i, 2]
        rows[i, 3] = sigma_m[i]
    return rows


class FilamentSource(Protocol):
    """Source of filaments for readings: the live plume, or a tape of it."""

    @property
    def step(self) -> int:
        """Number of steps made."""
        ...

    @property
    def time_s(self) -> float:
        """Time since the sources opened [s]."""
        ...

    @property
    def filaments(self) -> Filaments:
        """The filaments now; the next step may overwrite them."""
        ...

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        ...

    def advance(self, n_steps: int = 1) -> None:
        """Advance by steps."""
        ...

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step."""
        ...


@runtime_checkable
class SupportsPrefetch(Protocol):
    """Source whose later steps do not depend on its readers, so that they can be computed early."""

    def prefetch(self) -> bool:
        """Prepare a part of what later steps need and return true, or return false where there is nothing to do."""
        ...


@runtime_checkable
class SupportsDoors(Protocol):
    """Source with doors that close and open."""

    def close_doors(self, closed: Closed) -> None:
        """Let these doors of the room be closed and all others open."""
        ...


class FilamentField:
    """Gas field read from filaments; see `GasField`.

    Readings see the filaments in single precision (a micrometre in a room): a tape holds them exactly, and a run from
    tape equals a live one to the bit. The moving filaments keep double precision.
    """

    def __init__(
        self,
        source: FilamentSource,
        gases: tuple[str, ...],
        grid: Grid,
        *,
        sight: Visibility,
        n_readings_per_step: int = MIN_READINGS_FOR_INDEX,
        wind_at: WindAt | None = None,
        later_sights: Mapping[Closed, Visibility] | None = None,
        images: Mapping[Closed, WallImages] | None = None,
        turbulence: PointTurbulence | None = None,
    ) -> None:
        """Build the field.

        Args:
            grid: The room's; filaments are sorted by place in it.
            sight: Visibility of the filaments.
            n_readings_per_step: Number of readings in a step; few are summed without sorting.
            wind_at: The model's own wind at a time [s], (nx, ny, n, 3) at cell centres, n = 1 when it is the same at
                all heights; absent: the room's.
            later_sights: Visibility with certain doors closed, by their names.
            images: Walls that reflect gas, with certain doors closed; absent: they cut filaments off.
            turbulence: Turbulence in readings of gas and wind; absent: none.
        """
        self.source = source
        self._goes_ahead = source if isinstance(source, SupportsPrefetch) else None
        self.gases = gases
        self._grid = grid
        self._sights = {AT_START: sight, **(later_sights or {})}
        self._sight = sight
        self._uses_index = n_readings_per_step >= MIN_READINGS_FOR_INDEX
        self._index = FilamentIndex(min_m=grid.origin_m, max_m=grid.max_m)
        self._indexed: Filaments | None = None
        self._seen: Filaments | None = None
        self._wind_at = wind_at
        self._turbulence = turbulence
        self._images = images
        self._image = None if images is None else images[AT_START]

    @property
    def is_live(self) -> bool:
        """True if the source computes later steps ahead: they are independent of the run."""
        return self._goes_ahead is not None

    @property
    def step(self) -> int:
        """Number of steps made."""
        return self.source.step

    @property
    def time_s(self) -> float:
        """Time since the sources opened [s]."""
        return self.source.time_s

    @property
    def filaments(self) -> Filaments:
        """The filaments now, rounded to single precision."""
        if self._seen is None:
            self._seen = round_to_single_precision(self.source.filaments)
        return self._seen

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self.source.reset(seed)
        if self._turbulence is not None:
            self._turbulence.reset(seed)
        self._sight = self._sights[AT_START]
        self._image = None if self._images is None else self._images[AT_START]
        self._seen = None

    def close_doors(self, closed: Closed) -> None:
        """Let these doors of the room be closed and all others open."""
        if not isinstance(self.source, SupportsDoors):
            raise ModelError("events: expected gas that follows doors, of model filament without a tape.")
        self.source.close_doors(closed)
        self._sight = self._sights.get(closed, self._sights[AT_START])
        if self._images is not None:
            self._image = self._images.get(closed, self._images[AT_START])
        self._seen = None

    def advance(self, n_steps: int = 1) -> None:
        """Advance by steps."""
        if n_steps > 0:
            self.source.advance(n_steps)
            self._seen = None

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step."""
        self.source.blow(jets)
        self._seen = None

    def prefetch(self) -> bool:
        """Prepare a part of what later steps need and return true, or return false where there is nothing to do."""
        return self._goes_ahead is not None and self._goes_ahead.prefetch()

    def mixing_ratio_ppm_at(
        self, points_world_m: NDArray[np.float64], *, is_indexed: bool | None = None
    ) -> NDArray[np.float64]:
        """Return the mixing ratios at points; see `GasField`.

        Args:
            points_world_m: (m, 3) points, world frame [m].
            is_indexed: True to sort filaments by place first, which pays for many points; the order of sums, and with
                it the last digits, depend on it. Absent: by `n_readings_per_step`.
        """
        is_indexed = self._uses_index if is_indexed is None else is_indexed
        ppm, sigma_m = self._sum_at(points_world_m, is_indexed=is_indexed)
        # The last gases may have no source of filaments.
        n_missing = len(self.gases) - ppm.shape[1]
        if n_missing > 0:
            ppm = np.pad(ppm, ((0, 0), (0, n_missing)))
        if self._turbulence is None or not ppm.any():
            return ppm
        return ppm * self._turbulence.gas_factors_at(check_points(points_world_m), sigma_m, self.time_s)[:, None]

    # Mixing ratios, and sizes of the filaments where there is turbulence.
    def _sum_at(
        self, points_world_m: NDArray[np.float64], *, is_indexed: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        filaments, sight, image, sigma_m = self.filaments, self._sight, self._image, np.zeros(0)
        seen = {"walls": sight.walls, "cutoff_sigma": sight.cutoff_sigma}
        if image is not None:
            add = add_imaged_filaments_at_points_inplace
            return mixing_ratio_and_size_at(points_world_m, filaments, **seen, add=add, surroundings=image)
        if not is_indexed or self._turbulence is not None:
            ppm, sigma_m = mixing_ratio_and_size_at(points_world_m, filaments, **seen)
        if is_indexed:
            if self._indexed is not filaments:
                self._index.build(filaments)
                self._indexed = filaments
            ppm = self._index.mixing_ratio_ppm_at(points_world_m, **seen)
        return ppm, sigma_m

    def mixing_ratio_ppm_on_grid(self, grid: PointGrid, *, gas: int = 0, cutoff_sigma: float) -> NDArray[np.float64]:
        """Return the mixing ratio of one gas on a grid, through walls; see `GasField`."""
        return mixing_ratio_ppm_on_grid(
            self.filaments,
            first_point_m=grid.first_m,
            spacing_m=grid.spacing_m,
            shape=grid.shape,
            gas=gas,
            cutoff_sigma=cutoff_sigma,
        )

    def wind_m_s_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the model's own wind at points, if it has one; see `GasField`."""
        if self._turbulence is not None:
            return self._turbulence.wind_m_s_at(check_points(points_world_m), self.time_s)
        if self._wind_at is None:
            return None
        wind_m_s = self._wind_at(self.time_s)
        return trilinear_wind_at_points(wind_m_s, self._grid.origin_m, self._grid.cell_m, check_points(points_world_m))


def round_to_single_precision(filaments: Filaments) -> Filaments:
    """Return a copy of filaments with places and sizes in single precision.

    Those that are rounded already are returned as they are.
    """
    if filaments.is_rounded:
        return filaments
    # As rows, which tapes have too: kernels are compiled for one layout.
    rows = rows_in_single_precision(filaments.position_world_m, filaments.sigma_m)
    return Filaments(
        position_world_m=rows[:, :3],
        sigma_m=rows[:, 3],
        source_index=filaments.source_index.copy(),
        amount_mol=filaments.amount_mol,
        gas_index=filaments.gas_index,
        is_rounded=True,
    )


class PrefetchedPlume:
    """Live plume with prefetched frames of its future; see `FilamentSource`.

    `prefetch` moves the plume and keeps its frames; `advance` then only takes the next one. The frames are the same to
    the bit, whenever and however often `prefetch` is called. An error of the plume is kept as a frame too, so that it
    is raised at its own step.

    Args:
        plume: The live plume. Its wind must not depend on the events of a run.
        step_s: Length of its steps [s].
        steps_per_frame: Steps between frames: a reader advances by as many.
    """

    def __init__(self, plume: FilamentPlume, *, step_s: float, steps_per_frame: int) -> None:
        self._plume = plume
        self._step_s = step_s
        self._steps_per_frame = steps_per_frame
        # The present frame; none while the plume itself is at it.
        self._now: Filaments | None = None
        self._step = plume.step
        self._frames: deque[Filaments | ModelError] = deque()

    @property
    def step(self) -> int:
        """Number of steps that readers have made."""
        return self._step

    @property
    def time_s(self) -> float:
        """Time since the sources opened [s]."""
        return self._step * self._step_s

    @property
    def filaments(self) -> Filaments:
        """The filaments now; the next step may overwrite them."""
        return self._plume.filaments if self._now is None else self._now

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self._plume.reset(seed)
        self._now, self._step = None, 0
        self._frames.clear()

    def advance(self, n_steps: int = 1) -> None:
        """Advance by steps."""
        while n_steps > 0 and self._frames:
            if n_steps < self._steps_per_frame:
                raise ModelError(f"gas: expected to advance by {self._steps_per_frame} steps, was {n_steps}.")
            frame = self._frames.popleft()
            if isinstance(frame, ModelError):
                raise frame
            self._now = frame
            self._step += self._steps_per_frame
            n_steps -= self._steps_per_frame
        if n_steps > 0:
            self._now = None
            self._step += n_steps
            self._plume.advance(n_steps)

    def add_filaments(self, position_world_m: NDArray[np.float64]) -> None:
        """Add filaments; see `FilamentPlume.add_filaments`."""
        self._check_nothing_ahead("filaments that are added")
        self._plume.add_filaments(position_world_m)

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step."""
        self._check_nothing_ahead("a jet")
        self._plume.blow(jets)

    def _check_nothing_ahead(self, what: str) -> None:
        if self._frames or self._now is not None:
            raise ModelError(f"gas: expected no frame ahead of {what}.")

    def prefetch(self) -> bool:
        """Prepare one more frame and return true, or return false where enough is prepared."""
        if len(self._frames) >= MAX_PREFETCHED_FRAMES or (self._frames and isinstance(self._frames[-1], ModelError)):
            return False
        if self._now is None:
            self._now = round_to_single_precision(self._plume.filaments)
        try:
            self._plume.advance(self._steps_per_frame)
        except ModelError as error:
            self._frames.append(error)
        else:
            self._frames.append(round_to_single_precision(self._plume.filaments))
        return True
