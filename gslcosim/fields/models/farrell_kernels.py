"""Farrell's open-field wind: a horizontal, gusty flow that its corners stir."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def _edge(values, i_component, a, b):
    # Straight between the corners; the four are (0, 0), (0, 1), (1, 0), (1, 1) of x and y.
    low = (1.0 - b) * values[i_component, 0] + b * values[i_component, 1]
    high = (1.0 - b) * values[i_component, 2] + b * values[i_component, 3]
    return (1.0 - a) * low + a * high


@numba.njit(cache=True, nogil=True)
def set_edges_inplace(wind_m_s, corners_m_s):
    """Set the wind on the border of the field to values straight between those of the corners.

    Args:
        wind_m_s: (nx, ny, 2) wind at nodes, world frame xy [m/s]; its border is modified.
        corners_m_s: (2, 4) component by corner, corners in the order (0, 0), (0, 1), (1, 0), (1, 1) of x and y [m/s].
    """
    nx, ny, _ = wind_m_s.shape
    for c in range(2):
        for i in range(nx):
            a = i / (nx - 1)
            wind_m_s[i, 0, c] = _edge(corners_m_s, c, a, 0.0)
            wind_m_s[i, ny - 1, c] = _edge(corners_m_s, c, a, 1.0)
        for j in range(ny):
            b = j / (ny - 1)
            wind_m_s[0, j, c] = _edge(corners_m_s, c, 0.0, b)
            wind_m_s[nx - 1, j, c] = _edge(corners_m_s, c, 1.0, b)


@numba.njit(cache=True, nogil=True)
def advance_wind_inplace(wind_m_s, spare_m_s, dx_m, dy_m, viscosity_m2_s, dt_s, n_steps):
    """Advance the wind inside the field by explicit steps; the border stays.

    du/dt = -u du/dx - v du/dy + nu (d2u/dx2 + d2u/dy2), and the same for v
    [m/s2] = [m/s] [m/s] / [m] + [m2/s] [m/s] / [m2]

    First-order upwind differences for advection, central ones for diffusion, Euler in time.

    Args:
        wind_m_s: (nx, ny, 2) wind at nodes, world frame xy [m/s]; modified.
        spare_m_s: (nx, ny, 2) working memory.
        dx_m: Distance of nodes along x [m].
        dy_m: Distance of nodes along y [m].
        viscosity_m2_s: Eddy viscosity nu, half of Farrell's K [m2/s].
        dt_s: Step [s]; stable below `gslcosim.fields.models.farrell.stable_step_s`.
        n_steps: How many.

    Source:
        Farrell et al. 2002, doi:10.1023/A:1016283702837, eq. of the mean wind field; parameters as in pompy/models.py.
    Deviation:
        Upwind instead of central differences: stable without diffusion.
    Held by:
        tests/unit/fields/models/test_farrell.py (decay of a sine, constants stay, box of two side lengths)
    """
    nx, ny, _ = wind_m_s.shape
    for _ in range(n_steps):
        for i in range(1, nx - 1):
            for j in range(1, ny - 1):
                u, v = wind_m_s[i, j, 0], wind_m_s[i, j, 1]
                for c in range(2):
                    here = wind_m_s[i, j, c]
                    west, east = wind_m_s[i - 1, j, c], wind_m_s[i + 1, j, c]
                    south, north = wind_m_s[i, j - 1, c], wind_m_s[i, j + 1, c]
                    along_x = (here - west if u > 0.0 else east - here) / dx_m
                    along_y = (here - south if v > 0.0 else north - here) / dy_m
                    spreading = (west - 2.0 * here + east) / (dx_m * dx_m) + (south - 2.0 * here + north) / (
                        dy_m * dy_m
                    )
                    spare_m_s[i, j, c] = here + dt_s * (-u * along_x - v * along_y + viscosity_m2_s * spreading)
        for i in range(1, nx - 1):
            for j in range(1, ny - 1):
                wind_m_s[i, j, 0] = spare_m_s[i, j, 0]
                wind_m_s[i, j, 1] = spare_m_s[i, j, 1]


@numba.njit(cache=True, nogil=True)
def advance_gusts_inplace(gusts_m_s, rates_m_s2, transition, spread, draws):
    """Advance the gusts at the corners by one exact step of a noisy oscillator.

    dx = y dt, dy = -(w^2 x + 2 z w y) dt + b dW      x gust [m/s], y its rate [m/s2], w [rad/s], z damping ratio

    Args:
        gusts_m_s: (2, 4) gusts x by component and corner [m/s]; modified.
        rates_m_s2: (2, 4) their rates y [m/s2]; modified.
        transition: (2, 2) solution of the equation without noise over a step (see `exact_step`).
        spread: (2, 2) lower triangle L with L L^T the covariance that a step's noise adds.
        draws: (2, 4, 2) standard normal numbers.
    """
    for c in range(2):
        for k in range(4):
            x, y = gusts_m_s[c, k], rates_m_s2[c, k]
            gusts_m_s[c, k] = transition[0, 0] * x + transition[0, 1] * y + spread[0, 0] * draws[c, k, 0]
            rates_m_s2[c, k] = (
                transition[1, 0] * x
                + transition[1, 1] * y
                + spread[1, 0] * draws[c, k, 0]
                + spread[1, 1] * draws[c, k, 1]
            )


@numba.njit(cache=True, nogil=True)
def blow_inplace(
    wind_m_s, spare_m_s, gusts_m_s, rates_m_s2, mean_m_s, transition, spread, draws, dx_m, dy_m, viscosity_m2_s,
    dt_s, n_substeps,
):  # fmt: skip
    """Advance gusts, border and inside by as many steps of the wind's clock as there are draws.

    Args:
        wind_m_s: (nx, ny, 2) wind at nodes, world frame xy [m/s]; modified.
        spare_m_s: (nx, ny, 2) working memory.
        gusts_m_s: (2, 4) see `advance_gusts_inplace`; modified.
        rates_m_s2: (2, 4) see `advance_gusts_inplace`; modified.
        mean_m_s: (2,) mean wind [m/s].
        transition: (2, 2) see `advance_gusts_inplace`.
        spread: (2, 2) see `advance_gusts_inplace`.
        draws: (n, 2, 4, 2) standard normal numbers.
        dx_m: Distance of nodes along x [m].
        dy_m: Distance of nodes along y [m].
        viscosity_m2_s: Eddy viscosity [m2/s].
        dt_s: Length of a substep [s].
        n_substeps: Substeps of the inside in a step of the clock.
    """
    for n in range(draws.shape[0]):
        advance_gusts_inplace(gusts_m_s, rates_m_s2, transition, spread, draws[n])
        corners_m_s = gusts_m_s.copy()
        for c in range(2):
            for k in range(4):
                corners_m_s[c, k] += mean_m_s[c]
        set_edges_inplace(wind_m_s, corners_m_s)
        advance_wind_inplace(wind_m_s, spare_m_s, dx_m, dy_m, viscosity_m2_s, dt_s, n_substeps)


@numba.njit(cache=True, nogil=True)
def wind_in_cells(wind_m_s, nx, ny):
    """Return the wind at the centres of (nx, ny) cells that share the field's box, by bilinear interpolation.

    Args:
        wind_m_s: (mx, my, 2) wind at nodes, the outermost on the border of the field [m/s].
        nx: Cells along x.
        ny: Cells along y.

    Returns:
        (nx, ny, 1, 3) float32 wind, horizontal and the same at all heights [m/s].
    """
    mx, my, _ = wind_m_s.shape
    result = np.empty((nx, ny, 1, 3), np.float32)
    for i in range(nx):
        s = (i + 0.5) / nx * (mx - 1)
        p = min(int(s), mx - 2)
        a = s - p
        for j in range(ny):
            t = (j + 0.5) / ny * (my - 1)
            q = min(int(t), my - 2)
            b = t - q
            for c in range(2):
                low = (1.0 - b) * wind_m_s[p, q, c] + b * wind_m_s[p, q + 1, c]
                high = (1.0 - b) * wind_m_s[p + 1, q, c] + b * wind_m_s[p + 1, q + 1, c]
                result[i, j, 0, c] = (1.0 - a) * low + a * high
            result[i, j, 0, 2] = 0.0
    return result
