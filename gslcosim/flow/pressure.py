# pyright: basic
"""Pressure solver: makes a staggered velocity field divergence-free, by multigrid-preconditioned conjugate gradients.

All arrays are padded: cell (0, 0, 0) is at index (2, 2, 2), with two cells below and three above per axis.
Padding of potentials, right-hand sides and coefficients of closed faces is always zero.

The system is  sum over the six faces of  a_f (x_c - x_n) = b_c,  a_f >= 0 the face's coefficient:
0 closed, 1 between two air cells, 2 to an outlet (x = 0 on the face, half a cell away).

Arguments of several functions: `b` padded right-hand side [m/s]; `x_coefficient`, `y_coefficient` and `z_coefficient`
coefficients of the low-x, low-y and low-z faces.
"""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

LOW = 2  # padding below cell 0 on every axis
HIGH = 3  # padding above the last cell: one face more than cells, and the advection stencil's reach
F32 = NDArray[np.float32]
_COARSEST_SWEEPS = 6
_COARSEST_CELLS = 60


@numba.njit(cache=True, nogil=True)
def negative_divergence(u, v, w, x_coefficient, y_coefficient, z_coefficient, b):
    """Write inflow minus outflow of every cell, b = -(div u) h, and return its root mean square and maximum.

    b_c = u_i - u_{i+1} + v_j - v_{j+1} + w_k - w_{k+1}
    [m/s] = [m/s]

    Cells without an open face (solids) get zero.

    Args:
        u: Padded x-face velocities [m/s]; u[i, j, k] is on the low-x face of cell (i, j, k).
        v, w: Same on low-y and low-z faces [m/s].
        x_coefficient: Face coefficients of the pressure system, low-x faces.
        b: Written: padded right-hand side [m/s].

    Returns:
        (sum of squares over cells [m2/s2], largest magnitude [m/s]).

    Held by:
        tests/unit/flow/test_pressure.py (zero for a linear solenoidal field)
    """
    nx, ny, nz = b.shape
    row = np.zeros(nz, np.float32)
    largest = np.zeros(nz, np.float32)
    total = 0.0
    for i in range(LOW, nx - HIGH):
        row[:] = 0
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                is_open = (
                    x_coefficient[i, j, k] + x_coefficient[i + 1, j, k]
                    + y_coefficient[i, j, k] + y_coefficient[i, j + 1, k]
                    + z_coefficient[i, j, k] + z_coefficient[i, j, k + 1]
                ) > 0  # fmt: skip
                net = u[i, j, k] - u[i + 1, j, k] + v[i, j, k] - v[i, j + 1, k] + w[i, j, k] - w[i, j, k + 1]
                b[i, j, k] = net if is_open else np.float32(0)
            for k in range(LOW, nz - HIGH):
                row[k] += b[i, j, k] * b[i, j, k]
                largest[k] = max(largest[k], abs(b[i, j, k]))
        for k in range(LOW, nz - HIGH):
            total += row[k]
    return total, np.max(largest)


@numba.njit(cache=True, nogil=True)
def subtract_gradient(u, v, w, x, x_coefficient, y_coefficient, z_coefficient):
    """Correct face velocities in place so that they are divergence-free: u_f -= a_f (x_c - x_low).

    [m/s] = [m/s]: x is the pressure times dt / h.

    Args:
        u: Padded x-face velocities [m/s], modified.
        v, w: y- and z-face velocities [m/s], modified.
        x: Padded solution of the pressure system [m/s].

    Held by:
        tests/unit/flow/test_pressure.py (divergence after a projection)
    """
    nx, ny, nz = x.shape
    for i in range(LOW, nx - HIGH + 1):
        for j in range(LOW, ny - HIGH + 1):
            for k in range(LOW, nz - HIGH + 1):
                u[i, j, k] -= x_coefficient[i, j, k] * (x[i, j, k] - x[i - 1, j, k])
            for k in range(LOW, nz - HIGH + 1):
                v[i, j, k] -= y_coefficient[i, j, k] * (x[i, j, k] - x[i, j - 1, k])
            for k in range(LOW, nz - HIGH + 1):
                w[i, j, k] -= z_coefficient[i, j, k] * (x[i, j, k] - x[i, j, k - 1])


@numba.njit(cache=True, nogil=True)
def accumulate_scaled(target, x, factor):
    """Add factor * x to the target in place, including all padding."""
    nx, ny, nz = x.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                target[i, j, k] += factor * x[i, j, k]


@numba.njit(cache=True, nogil=True)
def smooth_first_colour(x, b, inverse_diagonal, colour_masks, colour):
    """Start a Gauss-Seidel sweep from x = 0: one colour becomes b / diagonal, the other 0.

    Args:
        x: Written: padded potential [m/s].
        inverse_diagonal: 1 / sum of the six coefficients, 0 in solids.
        colour_masks: (2, nz) float32, 1 where k has the parity of the row's index.
        colour: 0 or 1, the parity of i + j + k that is set.
    """
    nx, ny, nz = x.shape
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            parity = (i + j + colour) & 1
            for k in range(LOW, nz - HIGH):
                x[i, j, k] = colour_masks[parity, k] * b[i, j, k] * inverse_diagonal[i, j, k]


@numba.njit(cache=True, nogil=True)
def smooth_colour(x, b, x_coefficient, y_coefficient, z_coefficient, inverse_diagonal, colour_masks, colour):
    """Solve the equation of every cell of one chequerboard colour for its own value, in place.

    x_c = (b_c + sum a_f x_n) / sum a_f   for cells with (i + j + k) mod 2 = colour

    The whole row is computed and only one colour of it stored: that vectorises, a stride of two does not.
    Cells of one colour do not touch, so their order does not matter.

    Args:
        x: Padded potential [m/s], modified.
        inverse_diagonal: 1 / sum of the six coefficients, 0 in solids.
        colour_masks: (2, nz) float32, 1 where k has the parity of the row's index.
        colour: 0 or 1.

    Held by:
        tests/unit/flow/test_pressure.py (the V-cycle is symmetric and contracts)
    """
    nx, ny, nz = x.shape
    row = np.empty(nz, np.float32)
    ax, ay, az = x_coefficient, y_coefficient, z_coefficient
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                row[k] = (
                    b[i, j, k]
                    + ax[i, j, k] * x[i - 1, j, k] + ax[i + 1, j, k] * x[i + 1, j, k]
                    + ay[i, j, k] * x[i, j - 1, k] + ay[i, j + 1, k] * x[i, j + 1, k]
                    + az[i, j, k] * x[i, j, k - 1] + az[i, j, k + 1] * x[i, j, k + 1]
                ) * inverse_diagonal[i, j, k]  # fmt: skip
            parity = (i + j + colour) & 1
            for k in range(LOW, nz - HIGH):
                x[i, j, k] += colour_masks[parity, k] * (row[k] - x[i, j, k])


@numba.njit(cache=True, nogil=True)
def restrict_residual(x, b, x_coefficient, y_coefficient, z_coefficient, coarse_b):
    """Sum the residual b - A x of the eight cells below each coarse cell.

    Args:
        x: Padded potential [m/s].
        coarse_b: Written: right-hand side of the coarser level [m/s].
    """
    ncx, ncy, ncz = coarse_b.shape
    nx, ny, nz = x.shape
    ax, ay, az = x_coefficient, y_coefficient, z_coefficient
    row = np.zeros(nz + 1, np.float32)
    for ci in range(LOW, ncx - HIGH):
        for cj in range(LOW, ncy - HIGH):
            row[:] = 0
            for child in range(4):
                i = 2 * ci - LOW + child // 2
                j = 2 * cj - LOW + child % 2
                if i >= nx - HIGH or j >= ny - HIGH:  # the outer half of the last coarse cell of an odd count
                    continue
                for k in range(LOW, nz - HIGH):
                    row[k] += b[i, j, k] - (
                        ax[i, j, k] * (x[i, j, k] - x[i - 1, j, k])
                        + ax[i + 1, j, k] * (x[i, j, k] - x[i + 1, j, k])
                        + ay[i, j, k] * (x[i, j, k] - x[i, j - 1, k])
                        + ay[i, j + 1, k] * (x[i, j, k] - x[i, j + 1, k])
                        + az[i, j, k] * (x[i, j, k] - x[i, j, k - 1])
                        + az[i, j, k + 1] * (x[i, j, k] - x[i, j, k + 1])
                    )
            for ck in range(LOW, ncz - HIGH):
                k = 2 * ck - LOW
                coarse_b[ci, cj, ck] = row[k] + row[k + 1]


@numba.njit(cache=True, nogil=True)
def prolong(x, coarse_x, inverse_diagonal):
    """Add each coarse cell's correction to the (up to) eight cells below it, in place; solids stay 0.

    Args:
        x: Padded potential of the finer level [m/s], modified.
        coarse_x: Padded correction [m/s].
        inverse_diagonal: Of the finer level; 0 marks solids.
    """
    nx, ny, nz = x.shape
    row = np.zeros(nz + 2, np.float32)
    for i in range(LOW, nx - HIGH):
        ci = (i + LOW) // 2
        for j in range(LOW, ny - HIGH):
            cj = (j + LOW) // 2
            for ck in range(LOW, coarse_x.shape[2] - HIGH):
                row[2 * ck - LOW] = coarse_x[ci, cj, ck]
                row[2 * ck - LOW + 1] = coarse_x[ci, cj, ck]
            for k in range(LOW, nz - HIGH):
                x[i, j, k] += row[k] if inverse_diagonal[i, j, k] > 0 else np.float32(0)


@numba.njit(cache=True, nogil=True)
def apply_operator(x, x_coefficient, y_coefficient, z_coefficient, ax_out):
    """Write A x and return x . A x.

    (A x)_c = sum a_f (x_c - x_n)

    Args:
        x: Padded vector.
        ax_out: Written: padded product.

    Returns:
        The scalar product of x and A x, summed along rows, then over rows in index order (float64).
    """
    nx, ny, nz = x.shape
    ax, ay, az = x_coefficient, y_coefficient, z_coefficient
    row = np.zeros(nz, np.float32)
    total = 0.0
    for i in range(LOW, nx - HIGH):
        row[:] = 0
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                ax_out[i, j, k] = (
                    ax[i, j, k] * (x[i, j, k] - x[i - 1, j, k])
                    + ax[i + 1, j, k] * (x[i, j, k] - x[i + 1, j, k])
                    + ay[i, j, k] * (x[i, j, k] - x[i, j - 1, k])
                    + ay[i, j + 1, k] * (x[i, j, k] - x[i, j + 1, k])
                    + az[i, j, k] * (x[i, j, k] - x[i, j, k - 1])
                    + az[i, j, k + 1] * (x[i, j, k] - x[i, j, k + 1])
                )
            for k in range(LOW, nz - HIGH):
                row[k] += x[i, j, k] * ax_out[i, j, k]
        for k in range(LOW, nz - HIGH):
            total += row[k]
    return total


@numba.njit(cache=True, nogil=True)
def descend(x, residual, direction, a_direction, step):
    """Take one step of conjugate gradients in place: x += s d, r -= s A d.

    Args:
        x: Padded solution, modified.
        residual: Padded residual b - A x, modified.
        direction: Padded search direction d.
        a_direction: A d.
        step: s.

    Returns:
        (sum of squares of the new residual, its largest magnitude).
    """
    nx, ny, nz = x.shape
    step32 = np.float32(step)
    row = np.zeros(nz, np.float32)
    largest = np.zeros(nz, np.float32)
    total = 0.0
    for i in range(LOW, nx - HIGH):
        row[:] = 0
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                x[i, j, k] += step32 * direction[i, j, k]
            for k in range(LOW, nz - HIGH):
                residual[i, j, k] -= step32 * a_direction[i, j, k]
            for k in range(LOW, nz - HIGH):
                row[k] += residual[i, j, k] * residual[i, j, k]
                largest[k] = max(largest[k], abs(residual[i, j, k]))
        for k in range(LOW, nz - HIGH):
            total += row[k]
    return total, np.max(largest)


@numba.njit(cache=True, nogil=True)
def scalar_product(x, y):
    """Return x . y over the cells, summed along rows, then over rows in index order (float64)."""
    nx, ny, nz = x.shape
    row = np.zeros(nz, np.float32)
    total = 0.0
    for i in range(LOW, nx - HIGH):
        row[:] = 0
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                row[k] += x[i, j, k] * y[i, j, k]
        for k in range(LOW, nz - HIGH):
            total += row[k]
    return total


@numba.njit(cache=True, nogil=True)
def turn_direction(direction, preconditioned, factor):
    """Form the next search direction in place: d = z + factor d."""
    nx, ny, nz = direction.shape
    factor32 = np.float32(factor)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                direction[i, j, k] = preconditioned[i, j, k] + factor32 * direction[i, j, k]


def padded(shape: tuple[int, int, int]) -> F32:
    """Return zeros for a grid of cells with the padding that all flow kernels expect, float32."""
    return np.zeros(tuple(n + LOW + HIGH for n in shape), np.float32)


@dataclass(frozen=True, kw_only=True)
class SolveStats:
    """Statistics of a pressure solve: iterations, and the largest residual before and after [m/s]."""

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
        smooth_first_colour(self.x, b, self.inverse_diagonal, self.colour_masks, 0)
        self._smooth(b, 1)

    # The mirror image of the sweep above, so that the whole cycle is symmetric.
    def smooth_back(self, b: F32) -> None:
        self._smooth(b, 1)
        self._smooth(b, 0)

    def smooth(self, b: F32) -> None:
        self._smooth(b, 0)
        self._smooth(b, 1)

    def _smooth(self, b: F32, colour: int) -> None:
        smooth_colour(self.x, b, *self.coefficients, self.inverse_diagonal, self.colour_masks, colour)

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
                even = 2 * np.arange(coarse_shape[other])
                faces = np.take(faces, even, axis=other) + np.take(faces, even + 1, axis=other)
            target[tuple(slice(LOW, LOW + n) for n in faces.shape)] = 0.5 * faces
            coarse.append(target)
        return coarse[0], coarse[1], coarse[2]


# Entries 0, 2, 4 … along an axis, n of them; zeros beyond the end.
def _take_even(values: F32, axis: int, n: int) -> F32:
    index = 2 * np.arange(n)
    taken = np.take(values, np.minimum(index, values.shape[axis] - 1), axis=axis)
    taken[(slice(None),) * axis + (index >= values.shape[axis],)] = 0
    return taken


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
            coefficients: Padded coefficients of the low-x, low-y and low-z faces; see this module.
            is_closed: No outlet: the potential is determined up to a constant, and its mean is set to zero.
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
        source_m_s: F32 | None = None,
    ) -> SolveStats:
        """Make face velocities divergence-free in place; the potential used is left in `x` [m/s].

        Args:
            u: Padded x-face velocities [m/s], modified.
            v, w: y- and z-face velocities [m/s], modified.
            tolerance_m_s: Largest remaining root mean square of divergence times cell edge [m/s].
            max_tolerance_m_s: Largest remaining divergence times cell edge in any cell [m/s].
            max_iterations: Limit of the iterations; the result shows whether the tolerances were met.
            source_m_s: Padded divergence times cell edge that has to remain [m/s]: volume released into or removed from
            cells.

        Returns:
            Iterations and residuals.
        """
        fine = self._fine
        sum_of_squares, first = negative_divergence(u, v, w, *fine.coefficients, fine.b)
        if source_m_s is not None:
            fine.b += source_m_s
            sum_of_squares, first = float(np.sum(np.square(fine.b), dtype=np.float64)), np.abs(fine.b).max()
        if self._is_closed:
            self._remove_mean(fine.b)
        self.x[:] = 0
        target = tolerance_m_s * tolerance_m_s * self._n_air
        iterations, last = self._iterate(sum_of_squares, float(first), target, max_tolerance_m_s, max_iterations)
        subtract_gradient(u, v, w, self.x, *fine.coefficients)
        return SolveStats(iterations=iterations, first_max_m_s=float(first), last_max_m_s=last)

    # Conjugate gradients on A x = b with b in the finest level's `b`, which becomes the residual. Returns the number of
    # iterations and the largest remaining residual.
    def _iterate(
        self, sum_of_squares: float, largest: float, target: float, max_target: float, max_iterations: int
    ) -> tuple[int, float]:
        fine, direction = self._fine, self._direction
        previous_product = 0.0
        for iteration in range(max_iterations):
            if not (sum_of_squares > target or largest > max_target):  # also ends at once on NaN
                return iteration, largest
            self._precondition()
            product = scalar_product(fine.x, fine.b)
            factor = product / previous_product if iteration else 0.0
            turn_direction(direction, fine.x, factor)
            curvature = apply_operator(direction, *fine.coefficients, self._a_direction)
            if not curvature > 0:
                return iteration, largest
            step = product / curvature
            sum_of_squares, last = descend(self.x, fine.b, direction, self._a_direction, step)
            largest, previous_product = float(last), product
        return max_iterations, largest

    # One V-cycle: the finest `x` becomes an approximate solution for the residual in the finest `b`.
    def _precondition(self) -> None:
        for fine, coarse in zip(self.levels, self.levels[1:]):
            fine.smooth_from_zero(fine.b)
            restrict_residual(fine.x, fine.b, *fine.coefficients, coarse.b)
        coarsest = self.levels[-1]
        coarsest.smooth_from_zero(coarsest.b)
        for _ in range(_COARSEST_SWEEPS):
            coarsest.smooth(coarsest.b)
            coarsest.smooth_back(coarsest.b)
        coarsest.smooth_back(coarsest.b)
        for fine, coarse in zip(self.levels[-2::-1], self.levels[:0:-1]):
            prolong(fine.x, coarse.x, fine.inverse_diagonal)
            fine.smooth_back(fine.b)
        if self._is_closed:
            self._remove_mean(self._fine.x)

    # Subtract the mean over air cells.
    def _remove_mean(self, values: F32) -> None:
        inner = (slice(LOW, -HIGH),) * 3
        is_air = self._fine.inverse_diagonal[inner] > 0
        values[inner] -= np.float32(values[inner].sum(dtype=np.float64) / self._n_air) * is_air
