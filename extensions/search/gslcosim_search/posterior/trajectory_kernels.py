# pyright: basic

"""Kernels of trajectories that go backward from a nose: the time that its air spent in each cell of a room."""

import math

import numba
import numpy as np

# Vertical fluctuations over horizontal ones.
VERTICAL_SHARE = 0.6


@numba.njit(cache=True, nogil=True)
def add_residence_inplace(
    place_m, spread_m, winds_m_s, step_s, low_m, high_m, fluctuation_m_s, persistence, normals, first, n_particles,
    cell_m, residence_s,
):  # fmt: skip
    """Add the mean time that air spent in each cell before it came to a place, in a wind that is the same everywhere.

    x' = x - dt (U + s q),  q' = r q + sqrt(1 - r^2) n        each particle and component, s upward `VERTICAL_SHARE` s

    A particle that the wind brings in from outside of the box is over. One that meets the box's border by its
    fluctuation alone, or its floor or ceiling, stays where it is along that axis, and its fluctuation changes sign.

    Args:
        place_m: (3,) where the air came to, in the box, world frame [m].
        spread_m: Standard deviation of the particles' places around it [m].
        winds_m_s: (n_steps, 3) wind U in each step, the newest first; as many steps are followed.
        step_s: Time of a step dt [s].
        low_m, high_m: (3,) corners of the box [m]; cells begin at the lower one.
        fluctuation_m_s: Standard deviation s of the horizontal fluctuation.
        persistence: Correlation r of a particle's fluctuation from step to step.
        normals: (n,) standard normal numbers, taken in a ring from `first` on.
        n_particles: Number of particles.
        cell_m: Edge of the cells of `residence_s` [m].
        residence_s: (nx, ny, nz) time in each cell [s]; added to.

    Source:
        Flesch, Wilson, Yee 1995, Backward-time Lagrangian stochastic dispersion models (remembered, unverified).
    Held by:
        extensions/search/tests/unit/posterior/test_trajectories.py
    """
    n_normals, at = normals.size, first % normals.size
    fresh, share_s = math.sqrt(1.0 - persistence * persistence), step_s / n_particles
    x_m, q, draws = np.empty(3), np.empty(3), np.empty(6)
    cell = np.empty(3, np.int64)
    for _ in range(n_particles):
        for d in range(6):
            draws[d] = normals[at]
            at = at + 1 if at + 1 < n_normals else 0
        for d in range(3):
            x_m[d], q[d] = place_m[d] + spread_m * draws[d], draws[3 + d]
            if not low_m[d] <= x_m[d] < high_m[d]:
                x_m[d] = place_m[d]
            cell[d] = int((x_m[d] - low_m[d]) / cell_m)
        for step in range(winds_m_s.shape[0]):
            residence_s[cell[0], cell[1], cell[2]] += share_s
            came_from_outside = False
            for d in range(3):
                draws[d] = normals[at]
                at = at + 1 if at + 1 < n_normals else 0
                mean_m = x_m[d] - step_s * winds_m_s[step, d]
                came_from_outside = came_from_outside or (d < 2 and not low_m[d] <= mean_m < high_m[d])
                q[d] = persistence * q[d] + fresh * draws[d]
                share = fluctuation_m_s if d < 2 else VERTICAL_SHARE * fluctuation_m_s
                next_m = mean_m - step_s * share * q[d]
                if low_m[d] <= next_m < high_m[d]:
                    x_m[d] = next_m
                    cell[d] = int((next_m - low_m[d]) / cell_m)
                else:
                    q[d] = -q[d]
            if came_from_outside:
                break


@numba.njit(cache=True, nogil=True)
def smooth_inplace(values, share, spare):
    """Spread values over their neighbours, an axis after another: v_i' = (1 - 2 a) v_i + a (v_(i-1) + v_(i+1)).

    Args:
        values: (nx, ny, nz) numbers; modified. At the ends they keep what would leave.
        share: Share a for each neighbour.
        spare: Array of the same shape, overwritten.

    Held by:
        extensions/search/tests/unit/posterior/test_trajectories.py
    """
    nx, ny, nz = values.shape
    for axis in range(3):
        spare[:] = values
        for i in range(nx):
            for j in range(ny):
                for k in range(nz):
                    if axis == 0:
                        sides = spare[max(i - 1, 0), j, k] + spare[min(i + 1, nx - 1), j, k]
                    elif axis == 1:
                        sides = spare[i, max(j - 1, 0), k] + spare[i, min(j + 1, ny - 1), k]
                    else:
                        sides = spare[i, j, max(k - 1, 0)] + spare[i, j, min(k + 1, nz - 1)]
                    values[i, j, k] = (1.0 - 2.0 * share) * spare[i, j, k] + share * sides
