"""Policies of a decision problem over the offset from a source, and the table of a plume that they are looked up in.

Offsets are in a frame turned to the wind. The first coordinate of an offset points down the wind, the second to its
left; the offset of a vehicle is its place minus the source's. A belief over source cells in the world becomes one over
offsets by this turn alone. `docs/studies/pomdp_planning.py` plans.

Held by:
    extensions/search/tests/unit/information/test_pomdp.py
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.scalar_kernels import norm2
from gslcosim_search import elementary

Floats = NDArray[np.float64]

# Unit moves in the frame of the wind: upwind, downwind, to the left and to the right, seen down the wind.
MOVES = ((-1, 0), (1, 0), (0, 1), (0, -1))


@dataclass(frozen=True, kw_only=True)
class OffsetGrid:
    """Cells of offsets: the centre of the first one [m], their edge [m] and their numbers along and across."""

    first_m: tuple[float, float]
    cell_m: float
    shape: tuple[int, int]

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    def centres_m(self) -> Floats:
        """Return the (n_cells, 2) centres [m], the second coordinate running fastest."""
        along_m, across_m = (self.first_m[k] + self.cell_m * np.arange(self.shape[k]) for k in (0, 1))
        centres_m = np.empty((*self.shape, 2))
        centres_m[..., 0], centres_m[..., 1] = along_m[:, None], across_m
        return centres_m.reshape(-1, 2)

    def corners_of(self, offsets_m: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the four cells around each offset and their weights: (n, 4) each, weights sum to 1.

        Offsets beyond the outermost centres count as on them.
        """
        position = (offsets_m - self.first_m) / self.cell_m
        last = np.array(self.shape) - 1
        position = np.clip(position, 0.0, last)
        low = np.minimum(position.astype(np.int64), np.maximum(last - 1, 0))
        high = np.minimum(low + 1, last)
        part = position - low
        (i, j), (ii, jj), (u, v) = low.T, high.T, part.T
        cells = np.stack([i * self.shape[1] + j, i * self.shape[1] + jj, ii * self.shape[1] + j,
                          ii * self.shape[1] + jj], axis=1)  # fmt: skip
        weights = np.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v], axis=1)
        return cells, weights

    def gathered(self, offsets_m: Floats, weights: Floats) -> Floats:
        """Return (n_cells,) what (n,) weights at offsets come to in the cells, shared linearly; the sum stays."""
        cells, parts = self.corners_of(offsets_m)
        shares = (parts * weights[:, None]).ravel()
        return np.bincount(cells.ravel(), weights=shares, minlength=self.n_cells).astype(np.float64)

    def looked_up(self, table: Floats, offsets_m: Floats) -> Floats:
        """Return the values of (k, n_cells) tables at (n, 2) offsets, linear between cell centres: (k, n)."""
        cells, parts = self.corners_of(offsets_m)
        return (table[:, cells] * parts).sum(axis=-1)


def offsets_m(places_m: Floats, position_m: tuple[float, float], downwind_rad: float) -> Floats:
    """Return the offsets of the vehicle from each of (n, 2) positions, in the frame of the wind.

    d = R(-w) (x - s)        [m] = [m]; x the vehicle, s a place, w the direction the air goes
    """
    c, s = elementary.cos(downwind_rad), elementary.sin(downwind_rad)
    x_m, y_m = (np.subtract(position_m, places_m)).T
    return np.stack([c * x_m + s * y_m, c * y_m - s * x_m], axis=1)


def headings_rad(downwind_rad: float) -> tuple[float, ...]:
    """Return the direction of each of `MOVES` in the world, counter-clockwise from x [rad]."""
    return tuple(downwind_rad + elementary.atan2(float(across), float(along)) for along, across in MOVES)


def update_offset_belief(belief: Floats, likelihood: Floats, power: float = 1.0) -> Floats:
    """Return a belief after an observation: p(s) L(s)^power / sum; unchanged where nothing would be left.

    A power below 1 takes an observation for less than it says: neighbouring ones see the same filaments.
    """
    # A quarter of what powers take; 0 to any power above 0 stays 0.
    joint = belief * elementary.exp_each(power * elementary.log_each(likelihood))
    total = float(joint.sum())
    return joint / total if total > 0.0 and math.isfinite(total) else belief


class RunningWind:
    """The mean of the wind's vector over the last while, and its direction where it is strong enough to have one.

    w <- w + (1 - exp(-dt / memory)) (measured - w)        [m/s]; dt since the last measurement

    A plume lies along the mean wind, not along that of the moment.

    State: the mean vector, the time of the last measurement, and the last direction that could be trusted.
    """

    def __init__(self, *, memory_s: float = 30.0, threshold_m_s: float = 0.1) -> None:
        """Begin without a wind.

        Args:
            memory_s: Over how long the wind is averaged [s].
            threshold_m_s: A mean no faster than this has no direction [m/s]; the last one is kept.
        """
        self.downwind_rad: float | None = None
        self._memory_s, self._threshold_m_s = memory_s, threshold_m_s
        self._mean_m_s = (0.0, 0.0)
        self._last_s: float | None = None

    def add(self, time_s: float, speed_m_s: float, upwind_rad: float) -> None:
        """Take note of a wind by its speed and the direction it comes from."""
        weight = 1.0 if self._last_s is None else -elementary.expm1(-max(0.0, time_s - self._last_s) / self._memory_s)
        self._last_s = time_s
        x_m_s, y_m_s = self._mean_m_s
        x_m_s += weight * (-speed_m_s * elementary.cos(upwind_rad) - x_m_s)
        y_m_s += weight * (-speed_m_s * elementary.sin(upwind_rad) - y_m_s)
        self._mean_m_s = (x_m_s, y_m_s)
        if norm2(x_m_s, y_m_s) > self._threshold_m_s:
            self.downwind_rad = elementary.atan2(y_m_s, x_m_s)


@dataclass(frozen=True, kw_only=True)
class PlumeTable:
    """Table learned from plumes of one family, with policies for it.

    `thresholds_ppm` separate the levels; `level_frac` is (n_levels, cells of `grid`): how often each is met at an
    offset. Policies are linear functions of a belief over the cells of `policy_grid`: `vectors[name]` is
    (n_vectors, cells), `actions[name]` says which of `MOVES` each stands for. A move is one cell of `policy_grid` long.
    """

    thresholds_ppm: Floats
    grid: OffsetGrid
    level_frac: Floats
    policy_grid: OffsetGrid
    vectors: dict[str, Floats]
    actions: dict[str, NDArray[np.int64]]

    @classmethod
    def load(cls, path: Path) -> "PlumeTable":
        """Read a table that `save` has written."""
        with np.load(path, allow_pickle=False) as file:
            names = [key.removeprefix("vectors_") for key in file.files if key.startswith("vectors_")]
            return cls(
                thresholds_ppm=file["thresholds_ppm"].astype(np.float64),
                grid=_grid_of(file["grid"], file["level_frac"].shape[1:]),
                level_frac=_distributions(file["level_frac"]),
                policy_grid=_grid_of(file["policy_grid"], file[f"vectors_{names[0]}"].shape[1:]),
                # By column, which is the order of the product with a belief.
                vectors={name: np.asfortranarray(_flat(file[f"vectors_{name}"])) for name in names},
                actions={name: file[f"actions_{name}"].astype(np.int64) for name in names},
            )

    def save(self, path: Path) -> None:
        """Write the table: fractions and vectors as 16-bit numbers, compressed."""
        arrays = {f"vectors_{name}": _shaped(value, self.policy_grid) for name, value in self.vectors.items()}
        arrays |= {f"actions_{name}": value.astype(np.int8) for name, value in self.actions.items()}
        np.savez_compressed(
            path,
            allow_pickle=False,
            thresholds_ppm=self.thresholds_ppm,
            grid=np.array([*self.grid.first_m, self.grid.cell_m]),
            level_frac=_shaped(self.level_frac, self.grid),
            policy_grid=np.array([*self.policy_grid.first_m, self.policy_grid.cell_m]),
            **arrays,
        )

    def level_of(self, ppm: float) -> int:
        """Return the level of a mixing ratio [ppm]: the number of thresholds that it exceeds."""
        return int((ppm > self.thresholds_ppm).sum())

    def likelihood(self, level: int, offsets: Floats) -> Floats:
        """Return the probability of a level at (n, 2) offsets [m]: (n,)."""
        return self.grid.looked_up(self.level_frac[level][None], offsets)[0]

    def action_values(self, policy: str, belief: Floats, offsets: Floats) -> Floats:
        """Return the value of each of `MOVES` for a belief of (n,) probabilities at (n, 2) offsets [m]: (4,).

        Where no vector of a policy stands for a move its value is minus infinity.
        """
        values = elementary.product(self.policy_grid.gathered(offsets, belief), self.vectors[policy].T)
        return np.array([values[self.actions[policy] == k].max(initial=-np.inf) for k in range(len(MOVES))])


def _grid_of(numbers: Floats, shape: tuple[int, ...]) -> OffsetGrid:
    along_m, across_m, cell_m = (float(number) for number in numbers)
    return OffsetGrid(first_m=(along_m, across_m), cell_m=cell_m, shape=(shape[0], shape[1]))


def _flat(table: Floats) -> Floats:
    return table.astype(np.float64).reshape(len(table), -1)


def _distributions(table: Floats) -> Floats:
    # 16 bits do not sum to 1 exactly.
    flat = _flat(table)
    return flat / flat.sum(axis=0)


def _shaped(table: Floats, grid: OffsetGrid) -> NDArray[np.float16]:
    return table.reshape(-1, *grid.shape).astype(np.float16)
