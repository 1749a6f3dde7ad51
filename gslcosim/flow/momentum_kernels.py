"""Momentum on the staggered grid: advection, viscous stress and pressure gradient, one kernel per component.

Padding, index order and face coefficients are those of `pressure`: u[i, j, k] is on the low-x face of
cell (i, j, k), v on the low-y, w on the low-z face; the kinematic viscosity and the pressure are at cell centres.
The viscosity is zero in all cells that are not air, and no viscous flux crosses an edge that touches such a cell: wall
friction is added afterwards, see `turbulence`.
"""
# pyright: basic

import numba
import numpy as np

from gslcosim.flow.pressure import HIGH, LOW


@numba.njit(cache=True, nogil=True, inline="always")
def upwind_value(speed, far_low, low, high, far_high):
    """Interpolate to the face between `low` and `high`: the upstream value plus half a cell of its central slope.

    phi_f = phi_c + (phi_d - phi_u) / 4      c the cell upstream of the face, u the one behind it, d the one ahead

    Second order and not limited: limiters (Koren's was tried) thicken the shear layer of a jet; the 60-120 s mean of
    the 15 m room then correlates 0.907 with pimpleFoam's instead of 0.935.

    Source: Fromm 1968, doi:10.1016/0021-9991(68)90015-6; on an even grid the same as OpenFOAM's `linearUpwind`.
    """
    is_forward = speed > 0
    centre = low if is_forward else high
    behind = far_low if is_forward else far_high
    ahead = high if is_forward else low
    return centre + np.float32(0.25) * (ahead - behind)


@numba.njit(cache=True, nogil=True, inline="always")
def edge_viscosity(a, b, c, d):
    """Average the four cells around an edge; zero if one of them is not air."""
    mean = np.float32(0.25) * (a + b + c + d)
    return mean if min(min(a, b), min(c, d)) > 0 else np.float32(0)


@numba.njit(cache=True, nogil=True, inline="always")
def _u_flux_x(u, nu, per_cell, i, j, row):
    # Flux of u through the centre plane of cell i (between faces i and i + 1), for a row along k.
    two = np.float32(2)
    half = np.float32(0.5)
    for k in range(LOW, u.shape[2] - HIGH):
        speed = half * (u[i, j, k] + u[i + 1, j, k])
        value = upwind_value(speed, u[i - 1, j, k], u[i, j, k], u[i + 1, j, k], u[i + 2, j, k])
        row[k] = speed * value - two * nu[i, j, k] * per_cell * (u[i + 1, j, k] - u[i, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _v_flux_y(v, nu, per_cell, i, j, row):
    two = np.float32(2)
    half = np.float32(0.5)
    for k in range(LOW, v.shape[2] - HIGH):
        speed = half * (v[i, j, k] + v[i, j + 1, k])
        value = upwind_value(speed, v[i, j - 1, k], v[i, j, k], v[i, j + 1, k], v[i, j + 2, k])
        row[k] = speed * value - two * nu[i, j, k] * per_cell * (v[i, j + 1, k] - v[i, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _w_flux_z(w, nu, per_cell, i, j, row):
    # row[k] is the flux through the centre of cell k; one more below, for the lowest face.
    two = np.float32(2)
    half = np.float32(0.5)
    for k in range(LOW - 1, w.shape[2] - HIGH + 1):
        speed = half * (w[i, j, k] + w[i, j, k + 1])
        value = upwind_value(speed, w[i, j, k - 1], w[i, j, k], w[i, j, k + 1], w[i, j, k + 2])
        row[k] = speed * value - two * nu[i, j, k] * per_cell * (w[i, j, k + 1] - w[i, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _xy_stress(u, v, nu, per_cell, i, j, row, n_k):
    # Viscous part of the flux through the edges along z at the low-x, low-y corner of cells (i, j, all k).
    for k in range(LOW, n_k):
        edge = edge_viscosity(nu[i - 1, j - 1, k], nu[i, j - 1, k], nu[i - 1, j, k], nu[i, j, k])
        row[k] = -edge * per_cell * (u[i, j, k] - u[i, j - 1, k] + v[i, j, k] - v[i - 1, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _xz_stress(u, w, nu, per_cell, i, j, row):
    for k in range(LOW, u.shape[2] - HIGH + 1):
        edge = edge_viscosity(nu[i - 1, j, k - 1], nu[i, j, k - 1], nu[i - 1, j, k], nu[i, j, k])
        row[k] = -edge * per_cell * (u[i, j, k] - u[i, j, k - 1] + w[i, j, k] - w[i - 1, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _yz_stress(v, w, nu, per_cell, i, j, row):
    for k in range(LOW, v.shape[2] - HIGH + 1):
        edge = edge_viscosity(nu[i, j - 1, k - 1], nu[i, j, k - 1], nu[i, j - 1, k], nu[i, j, k])
        row[k] = -edge * per_cell * (v[i, j, k] - v[i, j, k - 1] + w[i, j, k] - w[i, j - 1, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _add_u_flux_y(u, v, i, j, row):
    half = np.float32(0.5)
    for k in range(LOW, u.shape[2] - HIGH):
        speed = half * (v[i - 1, j, k] + v[i, j, k])
        row[k] += speed * upwind_value(speed, u[i, j - 2, k], u[i, j - 1, k], u[i, j, k], u[i, j + 1, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _add_v_flux_x(u, v, i, j, row):
    half = np.float32(0.5)
    for k in range(LOW, v.shape[2] - HIGH):
        speed = half * (u[i, j - 1, k] + u[i, j, k])
        row[k] += speed * upwind_value(speed, v[i - 2, j, k], v[i - 1, j, k], v[i, j, k], v[i + 1, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _add_u_flux_z(u, w, i, j, row):
    half = np.float32(0.5)
    for k in range(LOW, u.shape[2] - HIGH + 1):
        speed = half * (w[i - 1, j, k] + w[i, j, k])
        row[k] += speed * upwind_value(speed, u[i, j, k - 2], u[i, j, k - 1], u[i, j, k], u[i, j, k + 1])


@numba.njit(cache=True, nogil=True, inline="always")
def _add_v_flux_z(v, w, i, j, row):
    half = np.float32(0.5)
    for k in range(LOW, v.shape[2] - HIGH + 1):
        speed = half * (w[i, j - 1, k] + w[i, j, k])
        row[k] += speed * upwind_value(speed, v[i, j, k - 2], v[i, j, k - 1], v[i, j, k], v[i, j, k + 1])


@numba.njit(cache=True, nogil=True, inline="always")
def _add_w_flux_x(u, w, i, j, row):
    half = np.float32(0.5)
    for k in range(LOW, w.shape[2] - HIGH + 1):
        speed = half * (u[i, j, k - 1] + u[i, j, k])
        row[k] += speed * upwind_value(speed, w[i - 2, j, k], w[i - 1, j, k], w[i, j, k], w[i + 1, j, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _add_w_flux_y(v, w, i, j, row):
    half = np.float32(0.5)
    for k in range(LOW, w.shape[2] - HIGH + 1):
        speed = half * (v[i, j, k - 1] + v[i, j, k])
        row[k] += speed * upwind_value(speed, w[i, j - 2, k], w[i, j - 1, k], w[i, j, k], w[i, j + 1, k])


@numba.njit(cache=True, nogil=True, inline="always")
def _divergence_row(x_low, x_high, y_low, y_high, z, row, per_cell, n_k):
    # Rate of change of a face row from the fluxes around it; z[k] is the flux below face k, z[k + 1] above it.
    for k in range(LOW, n_k):
        row[k] = per_cell * (x_low[k] - x_high[k] + y_low[k] - y_high[k] + z[k] - z[k + 1])


@numba.njit(cache=True, nogil=True, inline="always")
def _advance_row(rate, velocity, base, pressure_low, pressure, coefficient, out, dt, per_cell, weight, n_k):
    # out = (1 - weight) base + weight (velocity + dt (rate - grad p)) on open faces, base on closed ones.
    one = np.float32(1)
    for k in range(LOW, n_k):
        gradient = coefficient[k] * per_cell * (pressure[k] - pressure_low[k])
        new = (one - weight) * base[k] + weight * (velocity[k] + dt * (rate[k] - gradient))
        out[k] = new if coefficient[k] > 0 else base[k]


@numba.njit(cache=True, nogil=True)
def advance_u(u, v, w, pressure, nu, coefficient, base, dt_s, cell_m, stage_weight, out):
    """Advance the x-velocities by one stage of a Runge-Kutta step.

    out = (1 - g) base + g (u + dt (-div(u u - 2 nu S) - grad p))     S the strain rate, g the stage's weight
    [m/s] = [s] [m/s2]

    Args:
        u: Padded x-face velocities at the start of the stage [m/s].
        v, w: Same, y, z-faces.
        pressure: Padded pressure over density at cell centres [m2/s2]; zero outside.
        nu: Padded kinematic viscosity at cell centres, molecular plus eddy [m2/s]; zero outside air.
        coefficient: Padded coefficients of the low-x faces: 0 closed, 1 open, 2 outlet.
        base: x-face velocities at the start of the step [m/s]; also the values of closed faces.
        dt_s: Time step [s].
        cell_m: Edge of a cell [m].
        stage_weight: g, 1 for the first stage of Heun's method and 1/2 for the second.
        out: Written on all faces of the box; may be `base`, may not be `u`.

    Stability: (|u| + |v| + |w|) dt < h and nu dt < h^2 / 12, ensured by `solver`.

    Held by:
        tests/analytic/flow/test_taylor_green.py (order), tests/unit/flow/test_solve.py (mirror images)
    """
    nx, ny, nz = u.shape
    per_cell = np.float32(1 / cell_m)
    dt = np.float32(dt_s)
    weight = np.float32(stage_weight)
    n_k = nz - HIGH
    x_low = np.zeros((ny, nz), np.float32)
    x_high = np.zeros(nz, np.float32)
    y_low = np.zeros(nz, np.float32)
    y_high = np.zeros(nz, np.float32)
    z = np.zeros(nz, np.float32)
    rate = np.zeros(nz, np.float32)
    # The fluxes before the first layer come from the same loop as the others: as separate code beside it they keep the
    # compiler from vectorising the whole kernel (measured: 3 times the time).
    for i in range(LOW - 1, nx - HIGH + 1):
        _xy_stress(u, v, nu, per_cell, i, LOW, y_low, n_k)
        _add_u_flux_y(u, v, i, LOW, y_low)
        for j in range(LOW, ny - HIGH):
            _u_flux_x(u, nu, per_cell, i, j, x_high)
            if i < LOW:
                x_low[j, :] = x_high
                continue
            _xy_stress(u, v, nu, per_cell, i, j + 1, y_high, n_k)
            _add_u_flux_y(u, v, i, j + 1, y_high)
            _xz_stress(u, w, nu, per_cell, i, j, z)
            _add_u_flux_z(u, w, i, j, z)
            _divergence_row(x_low[j], x_high, y_low, y_high, z, rate, per_cell, n_k)
            _advance_row(
                rate, u[i, j], base[i, j], pressure[i - 1, j], pressure[i, j], coefficient[i, j], out[i, j],
                dt, per_cell, weight, n_k,
            )  # fmt: skip
            x_low[j, :] = x_high
            y_low[:] = y_high


@numba.njit(cache=True, nogil=True)
def advance_v(u, v, w, pressure, nu, coefficient, base, dt_s, cell_m, stage_weight, out):
    """Advance the y-velocities by one stage; as `advance_u` with the axes exchanged."""
    nx, ny, nz = v.shape
    per_cell = np.float32(1 / cell_m)
    dt = np.float32(dt_s)
    weight = np.float32(stage_weight)
    n_k = nz - HIGH
    x_low = np.zeros((ny, nz), np.float32)
    x_high = np.zeros(nz, np.float32)
    y_low = np.zeros(nz, np.float32)
    y_high = np.zeros(nz, np.float32)
    z = np.zeros(nz, np.float32)
    rate = np.zeros(nz, np.float32)
    for i in range(LOW - 1, nx - HIGH):
        _v_flux_y(v, nu, per_cell, i, LOW - 1, y_low)
        for j in range(LOW, ny - HIGH + 1):
            _xy_stress(u, v, nu, per_cell, i + 1, j, x_high, n_k)
            _add_v_flux_x(u, v, i + 1, j, x_high)
            if i < LOW:
                x_low[j, :] = x_high
                continue
            _v_flux_y(v, nu, per_cell, i, j, y_high)
            _yz_stress(v, w, nu, per_cell, i, j, z)
            _add_v_flux_z(v, w, i, j, z)
            _divergence_row(x_low[j], x_high, y_low, y_high, z, rate, per_cell, n_k)
            _advance_row(
                rate, v[i, j], base[i, j], pressure[i, j - 1], pressure[i, j], coefficient[i, j], out[i, j],
                dt, per_cell, weight, n_k,
            )  # fmt: skip
            x_low[j, :] = x_high
            y_low[:] = y_high


@numba.njit(cache=True, nogil=True)
def advance_w(u, v, w, pressure, nu, coefficient, base, dt_s, cell_m, stage_weight, out):
    """Advance the z-velocities by one stage; as `advance_u` with the axes exchanged."""
    nx, ny, nz = w.shape
    per_cell = np.float32(1 / cell_m)
    dt = np.float32(dt_s)
    weight = np.float32(stage_weight)
    n_k = nz - HIGH + 1
    x_low = np.zeros((ny, nz), np.float32)
    x_high = np.zeros(nz, np.float32)
    y_low = np.zeros(nz, np.float32)
    y_high = np.zeros(nz, np.float32)
    z = np.zeros(nz, np.float32)
    rate = np.zeros(nz, np.float32)
    for i in range(LOW - 1, nx - HIGH):
        _yz_stress(v, w, nu, per_cell, i, LOW, y_low)
        _add_w_flux_y(v, w, i, LOW, y_low)
        for j in range(LOW, ny - HIGH):
            _xz_stress(u, w, nu, per_cell, i + 1, j, x_high)
            _add_w_flux_x(u, w, i + 1, j, x_high)
            if i < LOW:
                x_low[j, :] = x_high
                continue
            _yz_stress(v, w, nu, per_cell, i, j + 1, y_high)
            _add_w_flux_y(v, w, i, j + 1, y_high)
            _w_flux_z(w, nu, per_cell, i, j, z)
            for k in range(LOW, n_k):
                rate[k] = per_cell * (x_low[j, k] - x_high[k] + y_low[k] - y_high[k] + z[k - 1] - z[k])
            _advance_w_row(
                rate, w[i, j], base[i, j], pressure[i, j], coefficient[i, j], out[i, j], dt, per_cell, weight, n_k
            )
            x_low[j, :] = x_high
            y_low[:] = y_high


@numba.njit(cache=True, nogil=True, inline="always")
def _advance_w_row(rate, velocity, base, pressure, coefficient, out, dt, per_cell, weight, n_k):
    one = np.float32(1)
    for k in range(LOW, n_k):
        gradient = coefficient[k] * per_cell * (pressure[k] - pressure[k - 1])
        new = (one - weight) * base[k] + weight * (velocity[k] + dt * (rate[k] - gradient))
        out[k] = new if coefficient[k] > 0 else base[k]


@numba.njit(cache=True, nogil=True)
def survey_speeds(u, v, w, nu):
    """Return the largest |u| + |v| + |w| of a cell [m/s], largest viscosity [m2/s], and sum of squares [m2/s2].

    The speed of each component is the larger of the cell's two faces; its square is the mean of the two squares.
    The first two limit the time step; NaN anywhere makes them NaN. Half the sum of squares is the kinetic energy.
    """
    nx, ny, nz = u.shape
    half = np.float32(0.5)
    speed = np.zeros(nz, np.float32)
    viscosity = np.zeros(nz, np.float32)
    squares = np.zeros(nz, np.float32)
    total = np.zeros(nz, np.float32)  # a maximum ignores NaN, a sum does not
    sum_of_squares = 0.0
    for i in range(LOW, nx - HIGH):
        squares[:] = 0
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                along_x = max(abs(u[i, j, k]), abs(u[i + 1, j, k]))
                along_y = max(abs(v[i, j, k]), abs(v[i, j + 1, k]))
                along_z = max(abs(w[i, j, k]), abs(w[i, j, k + 1]))
                speed[k] = max(speed[k], along_x + along_y + along_z)
                viscosity[k] = max(viscosity[k], nu[i, j, k])
                total[k] += along_x + along_y + along_z + nu[i, j, k]
            for k in range(LOW, nz - HIGH):
                squares[k] += half * (
                    u[i, j, k] * u[i, j, k] + u[i + 1, j, k] * u[i + 1, j, k]
                    + v[i, j, k] * v[i, j, k] + v[i, j + 1, k] * v[i, j + 1, k]
                    + w[i, j, k] * w[i, j, k] + w[i, j, k + 1] * w[i, j, k + 1]
                )  # fmt: skip
        for k in range(LOW, nz - HIGH):
            sum_of_squares += squares[k]
    if not np.isfinite(np.sum(total)):
        return np.float32(np.nan), np.float32(np.nan), sum_of_squares
    return np.max(speed), np.max(viscosity), sum_of_squares


@numba.njit(cache=True, nogil=True)
def centre_velocity(u, v, w, out):
    """Average the two faces of every cell.

    Args:
        u: Padded x-face velocities [m/s].
        v, w: y- and z-face velocities [m/s].
        out: Written: (nx, ny, nz, 3) velocities at cell centres, xyz [m/s].
    """
    half = np.float32(0.5)
    nx, ny, nz, _ = out.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                a, b, c = i + LOW, j + LOW, k + LOW
                out[i, j, k, 0] = half * (u[a, b, c] + u[a + 1, b, c])
                out[i, j, k, 1] = half * (v[a, b, c] + v[a, b + 1, c])
                out[i, j, k, 2] = half * (w[a, b, c] + w[a, b, c + 1])
