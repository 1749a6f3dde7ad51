"""The pressure solver: makes a staggered velocity field divergence-free."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow import pressure_kernels as kernels
from gslcosim.flow.pressure_kernels import HIGH, LOW

F32 = NDArray[np.float32]

_COARSEST_SWEEPS = 6
_COARSEST_CELLS = 60


def padded(shape: tuple[int, int, int]) -> F32:
    """Return zeros for a grid of cells with the padding that all flow kernels expect, float32."""
    return np.zeros(tuple(n + LOW + HIGH for n in shape), np.float32)


@dataclass(frozen=True, kw_only=True)
class SolveStats:
    """How a pressure solve went: iterations, and the largest residual before and after [m/s]."""

    iterations: int
    first_max_m_s: float
    last_max_m_s: float


class _Level:
    # One grid of the multigrid hierarchy with its coefficients and work arrays.
    def __init__(self, coefficients: tuple[F32, F32, F32]) -> None:
        self.coefficients = coefficients
        ax, ay, az = coefficients
        diagonal = ax + ay + az
        diagonal[:-1] += ax[1:]
        diagonal[:, :-1] += ay[:, 1:]
        diagonal[:, :, :-1] += az[:, :, 1:]
        inner = (slice(LOW, -HIGH),) * 3
        self.inverse_diagonal = np.zeros_like(ax)
        has_face = diagonal[inner] > 0
        np.divide(1, diagonal[inner], out=self.inverse_diagonal[inner], where=has_face)
        self.colour_masks = np.zeros((2, ax.shape[2]), np.float32)
        self.colour_masks[0, ::2] = 1
        self.colour_masks[1, 1::2] = 1
        self.x = np.zeros_like(ax)
        self.b = np.zeros_like(ax)

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(n - LOW - HIGH for n in self.x.shape)

    # One red-black sweep from x = 0 towards the right-hand side b.
    def smooth_from_zero(self, b: F32) -> None:
        kernels.smooth_first_colour(self.x, b, self.inverse_diagonal, self.colour_masks, 0)
        self._smooth(b, 1)

    # The mirror image of the sweep above, so that the whole cycle is symmetric.
    def smooth_back(self, b: F32) -> None:
        self._smooth(b, 1)
        self._smooth(b, 0)

    def smooth(self, b: F32) -> None:
        self._smooth(b, 0)
        self._smooth(b, 1)

    def _smooth(self, b: F32, colour: int) -> None:
        kernels.smooth_colour(self.x, b, *self.coefficients, self.inverse_diagonal, self.colour_masks, colour)

    # Coefficient of a coarse face: half the sum of the four fine ones on it (area over distance).
    def coarsened(self) -> "tuple[F32, F32, F32]":
        fine_shape = self.shape
        coarse_shape = tuple((n + 1) // 2 for n in fine_shape)
        coarse = []
        for axis, fine in enumerate(self.coefficients):
            source = fine[(slice(LOW, None),) * 3]
            target = padded(coarse_shape)  # pyright: ignore[reportArgumentType]
            faces = _take_even(source, axis, coarse_shape[axis] + 1)
            if fine_shape[axis] % 2:  # the last boundary face lies inside the last coarse cell: move it out
                last = np.take(source, fine_shape[axis], axis=axis)
                faces[(slice(None),) * axis + (-1,)] += last
            for other in (a for a in range(3) if a != axis):
                faces = _sum_pairs(faces, other, coarse_shape[other])
            target[tuple(slice(LOW, LOW + n) for n in faces.shape)] = 0.5 * faces
            coarse.append(target)
        return coarse[0], coarse[1], coarse[2]


# Entries 0, 2, 4 … along an axis, n of them; zeros beyond the end.
def _take_even(values: F32, axis: int, n: int) -> F32:
    index = 2 * np.arange(n)
    taken = np.take(values, np.minimum(index, values.shape[axis] - 1), axis=axis)
    taken[(slice(None),) * axis + (index >= values.shape[axis],)] = 0
    return taken


# Sums of neighbouring pairs along an axis, n of them.
def _sum_pairs(values: F32, axis: int, n: int) -> F32:
    return np.take(values, 2 * np.arange(n), axis=axis) + np.take(values, 2 * np.arange(n) + 1, axis=axis)


class PressureSolver:
    """Conjugate gradients with one multigrid V-cycle as preconditioner.

    V-cycle: one red-black Gauss-Seidel sweep before and its mirror image after, piecewise-constant transfer, coarse
    coefficients from the four fine faces. The cycle is symmetric, so plain conjugate gradients apply.

    Source: Trottenberg, Oosterlee, Schüller 2001, Multigrid, sections 2.4 and 7.8 (multigrid as preconditioner).
    Held by: tests/unit/flow/test_pressure.py
    """

    def __init__(self, coefficients: tuple[F32, F32, F32], *, is_closed: bool) -> None:
        """Build the hierarchy.

        Args:
            coefficients: Padded coefficients of the low-x, low-y and low-z faces; see `pressure_kernels`.
            is_closed: No outlet: the potential is known up to a constant, and its mean is set to zero.
        """
        self._is_closed = is_closed
        self.levels = [_Level(coefficients)]
        while np.prod(self.levels[-1].shape) > _COARSEST_CELLS and max(self.levels[-1].shape) > 2:
            self.levels.append(_Level(self.levels[-1].coarsened()))
        self._fine = self.levels[0]
        self._n_air = int(np.count_nonzero(self._fine.inverse_diagonal))
        self.x = np.zeros_like(coefficients[0])
        self._direction = np.zeros_like(self.x)
        self._a_direction = np.zeros_like(self.x)

    def project(
        self,
        u: F32,
        v: F32,
        w: F32,
        *,
        tolerance_m_s: float,
        max_tolerance_m_s: float = np.inf,
        max_iterations: int = 60,
    ) -> SolveStats:
        """Make face velocities divergence-free in place; the potential used is left in `x` [m/s].

        Args:
            u: Padded x-face velocities [m/s], modified.
            v: y-face velocities [m/s], modified.
            w: z-face velocities [m/s], modified.
            tolerance_m_s: Largest root mean square of divergence times cell that may remain [m/s].
            max_tolerance_m_s: Largest divergence times cell that may remain in any cell [m/s].
            max_iterations: Iterations after which it stops anyway; the caller judges by the result.

        Returns:
            Iterations and residuals.
        """
        fine = self._fine
        sum_of_squares, first = kernels.negative_divergence(u, v, w, *fine.coefficients, fine.b)
        if self._is_closed:
            self._remove_mean(fine.b)
        self.x[:] = 0
        target = tolerance_m_s**2 * self._n_air
        iterations, last = self._iterate(sum_of_squares, float(first), target, max_tolerance_m_s, max_iterations)
        kernels.subtract_gradient(u, v, w, self.x, *fine.coefficients)
        return SolveStats(iterations=iterations, first_max_m_s=float(first), last_max_m_s=last)

    # Conjugate gradients on A x = b with b in the finest level's `b`, which becomes the residual.
    # Returns the iterations taken and the largest residual left.
    def _iterate(
        self, sum_of_squares: float, largest: float, target: float, max_target: float, max_iterations: int
    ) -> tuple[int, float]:
        fine, direction = self._fine, self._direction
        previous_product = 0.0
        for iteration in range(max_iterations):
            if not (sum_of_squares > target or largest > max_target):  # also ends at once on NaN
                return iteration, largest
            self._precondition()
            product = kernels.scalar_product(fine.x, fine.b)
            factor = product / previous_product if iteration else 0.0
            kernels.turn_direction(direction, fine.x, factor)
            curvature = kernels.apply_operator(direction, *fine.coefficients, self._a_direction)
            if not curvature > 0:
                return iteration, largest
            step = product / curvature
            sum_of_squares, last = kernels.descend(self.x, fine.b, direction, self._a_direction, step)
            largest, previous_product = float(last), product
        return max_iterations, largest

    # One V-cycle: the finest `x` becomes an approximate solution for the residual in the finest `b`.
    def _precondition(self) -> None:
        for fine, coarse in zip(self.levels, self.levels[1:]):
            fine.smooth_from_zero(fine.b)
            kernels.restrict_residual(fine.x, fine.b, *fine.coefficients, coarse.b)
        coarsest = self.levels[-1]
        coarsest.smooth_from_zero(coarsest.b)
        for _ in range(_COARSEST_SWEEPS):
            coarsest.smooth(coarsest.b)
            coarsest.smooth_back(coarsest.b)
        coarsest.smooth_back(coarsest.b)
        for fine, coarse in zip(self.levels[-2::-1], self.levels[:0:-1]):
            kernels.prolong(fine.x, coarse.x, fine.inverse_diagonal)
            fine.smooth_back(fine.b)
        if self._is_closed:
            self._remove_mean(self._fine.x)

    # Subtract the mean over air cells.
    def _remove_mean(self, values: F32) -> None:
        inner = (slice(LOW, -HIGH),) * 3
        is_air = self._fine.inverse_diagonal[inner] > 0
        values[inner] -= np.float32(values[inner].sum(dtype=np.float64) / self._n_air) * is_air
