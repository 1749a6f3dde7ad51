# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Turbulence models: eddy viscosity and wall friction for the momentum equation.

Friction slows the air beside a wall, and changes the turbulence there. Its lists and padding are those of
`domain.WallFriction`. The wall is half a cell from the velocities that it slows.

Padding and index order are those of `pressure`; scalars are at cell centres.

Arguments of several functions: `cell_m` edge of a cell, h [m]; `dt_s` time step [s]; `nu_m2_s` molecular viscosity
[m2/s]; `k_m2_s2` flat padded turbulence energy [m2/s2]; `cells` (n,) flat padded indices of wall cells; `v` and `w`
velocities on y- and z-faces, padded as `u` is [m/s].
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.flow.domain import Domain
from gslcosim.flow.patches import Inlet, PlacedPatch
from gslcosim.flow.pressure import F32, HIGH, LOW, padded

VON_KARMAN = 0.41
WALL_ROUGHNESS_E = 9.8  # smooth wall
C_MU = 0.09
_C_MU_ROOT_4 = math.sqrt(math.sqrt(C_MU))
LAMINAR_SUBLAYER = 11.53  # y+ at which y+ = ln(E y+) / kappa
ETA_0_RNG = 4.38
BETA_RNG = 0.012
K_FLOOR_M2_S2 = 1e-10
EPSILON_FLOOR_M2_S3 = 1e-12
Velocity = tuple[F32, F32, F32]
SMAGORINSKY_CONSTANT = 0.12  # 0.1 to 0.2 in the literature, chosen here


@numba.njit(cache=True, nogil=True)
def log_law_friction(cells, k_m2_s2, nu_m2_s, cell_m, friction_m_s):
    """Set the wall friction from the turbulence energy beside the wall.

    u* = C_mu^(1/4) k^(1/2),  y+ = u* y / nu,  c = kappa u* / ln(E y+)   above the laminar sublayer, else nu / y
    [m/s] = [m/s];  y = h / 2, tau = c (U - U_wall) is the kinematic shear stress [m2/s2]

    Args:
        friction_m_s: Written: (n,) c [m/s].

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, section 2.3 (kappa 0.41, E 9.8).
    Held by: tests/unit/flow/test_turbulence.py (log law recovered)
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        speed = _C_MU_ROOT_4 * math.sqrt(k_m2_s2[cells[n]])
        y_plus = speed * y / nu_m2_s
        if y_plus > LAMINAR_SUBLAYER:
            friction_m_s[n] = VON_KARMAN * speed / elementary.log(WALL_ROUGHNESS_E * y_plus)
        else:
            friction_m_s[n] = nu_m2_s / y


@numba.njit(cache=True, nogil=True, inline="always")
def _speed_past_wall(c, wall_velocity, u, v, w, stride_x, stride_y):
    # At the centre of cell c, relative to its wall [m/s].
    a = 0.5 * (u[c] + u[c + stride_x]) - wall_velocity[0]
    b = 0.5 * (v[c] + v[c + stride_y]) - wall_velocity[1]
    d = 0.5 * (w[c] + w[c + 1]) - wall_velocity[2]
    return math.sqrt(a * a + b * b + d * d)


@numba.njit(cache=True, nogil=True)
def power_law_friction(cells, wall_velocity, u, v, w, stride_x, stride_y, nu_m2_s, cell_m, friction_m_s):
    """Set the wall friction from the speed beside the wall alone, for models without a turbulence energy.

    u+ = y+ below y+ = 11.81, u+ = 8.3 y+^(1/7) above; at the point y = h / 2 solved for u*, c = u*^2 / U
    [m/s]

    Args:
        wall_velocity: (n, 3) velocity of the wall [m/s].
        u: Flat padded x-face velocities [m/s].
        stride_x: Distance of x-neighbours in the flat arrays.
        stride_y: Same for y-neighbours.
        friction_m_s: Written: (n,) c [m/s].

    Source: Werner and Wengle 1993, Large-eddy simulation of turbulent flow over and around a cube in a plate channel
    (A = 8.3, B = 1/7), at the point instead of integrated over the cell.
    Held by: tests/unit/flow/test_turbulence.py
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        c = cells[n]
        speed = _speed_past_wall(c, wall_velocity[n], u, v, w, stride_x, stride_y)
        # u / u* = 8.3 (u* y / nu)^(1/7)  gives  u* = (u / 8.3)^(7/8) (nu / y)^(1/8)
        turbulent = elementary.pow(speed / 8.3, 0.875) * elementary.pow(nu_m2_s / y, 0.125)
        friction = nu_m2_s / y
        if turbulent * y / nu_m2_s > 11.81:
            friction = max(friction, turbulent * turbulent / speed)
        friction_m_s[n] = friction


@numba.njit(cache=True, nogil=True)
def apply_friction(velocity, out, faces, owners, wall_speed_m_s, friction_m_s, dt_s, cell_m, stage_weight):
    """Slow one velocity component at walls, in place.

    out -= g dt / h * c (u - u_wall) / 2    for each half face: a face lies in two cells, each with its own walls
    [m/s] = [s] / [m] * [m/s] [m/s]

    Args:
        velocity: Flat padded velocities at the start of the stage [m/s].
        out: Flat padded velocities at its end [m/s], modified; may not be `velocity`.
        faces: (m,) flat indices of the half faces.
        owners: (m,) index into `friction_m_s`.
        wall_speed_m_s: (m,) speed of the wall along the component [m/s].
        friction_m_s: (n,) c of each wall cell [m/s].
        stage_weight: g of the Runge-Kutta stage.

    Held by:
        tests/analytic/flow/test_channels.py, tests/unit/flow/test_moving_wall.py
    """
    factor = 0.5 * stage_weight * dt_s / cell_m
    for m in range(faces.shape[0]):
        face = faces[m]
        out[face] -= np.float32(factor * friction_m_s[owners[m]] * (velocity[face] - wall_speed_m_s[m]))


@numba.njit(cache=True, nogil=True)
def wall_production(
    cells, wall_velocity, u, v, w, stride_x, stride_y, k_m2_s2, nu_m2_s, friction_m_s, cell_m, production
):
    """Replace the production of turbulence energy in wall cells by that of the log layer.

    P = c |U - U_wall| u* / (kappa y),   u* = C_mu^(1/4) k^(1/2);   0 inside the laminar sublayer
    [m2/s3] = [m/s] [m/s] [m/s] / [m]

    Args:
        wall_velocity: (n, 3) velocity of the wall [m/s].
        u: Flat padded x-face velocities [m/s].
        stride_x: Distance of x-neighbours in the flat arrays.
        stride_y: Same for y-neighbours.
        friction_m_s: (n,) c from `log_law_friction` [m/s].
        production: Flat padded production [m2/s3], modified in wall cells.

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, section 2.3.
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        c = cells[n]
        speed = _speed_past_wall(c, wall_velocity[n], u, v, w, stride_x, stride_y)
        star = _C_MU_ROOT_4 * math.sqrt(k_m2_s2[c])
        is_turbulent = star * y / nu_m2_s > LAMINAR_SUBLAYER
        production[c] = np.float32(friction_m_s[n] * speed * star / (VON_KARMAN * y) if is_turbulent else 0.0)


@numba.njit(cache=True, nogil=True)
def wall_dissipation(cells, k_m2_s2, nu_m2_s, cell_m, epsilon):
    """Set the dissipation in wall cells to that of the log layer, or of the laminar sublayer.

    epsilon = C_mu^(3/4) k^(3/2) / (kappa y),   2 nu k / y^2 inside the sublayer
    [m2/s3] = [m3/s3] / [m]

    Args:
        epsilon: Flat padded dissipation [m2/s3], modified in wall cells.

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, section 2.3.
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        k = k_m2_s2[cells[n]]
        star = _C_MU_ROOT_4 * math.sqrt(k)
        if star * y / nu_m2_s > LAMINAR_SUBLAYER:
            epsilon[cells[n]] = np.float32(star**3 / (VON_KARMAN * y))
        else:
            epsilon[cells[n]] = np.float32(2.0 * nu_m2_s * k / (y * y))


@numba.njit(cache=True, nogil=True)
def mirror_into_ghosts(velocity, faces, starts, sources):
    """Set the velocities inside obstacles, near their surface, to minus the mean of the adjacent ones, in place.

    The interpolated velocity on the surface is then that of a wall at rest. A wall one cell thick has one value for
    both of its sides, the mean.

    Args:
        velocity: Flat padded velocities of one component [m/s], modified at `faces`.
        faces: (n,) flat indices.
        starts: (n + 1,) start of each ghost's sources.
        sources: Flat indices of open faces.

    Held by:
        tests/unit/flow/test_ghosts.py
    """
    for n in range(faces.shape[0]):
        total = 0.0
        for m in range(starts[n], starts[n + 1]):
            total += velocity[sources[m]]
        velocity[faces[n]] = np.float32(-total / (starts[n + 1] - starts[n]))


@numba.njit(cache=True, nogil=True)
def strain_squared(u, v, w, cell_m, out):
    """Write 2 S:S at cell centres, S the strain rate, from central differences of the face velocities.

    2 S:S = 2 (u_x^2 + v_y^2 + w_z^2) + (u_y + v_x)^2 + (u_z + w_x)^2 + (v_z + w_y)^2
    [1/s2] = [m/s / m]^2

    Args:
        u: Padded x-face velocities [m/s].
        out: Written: padded 2 S:S [1/s2].

    Held by:
        tests/unit/flow/test_turbulence.py (exact for linear fields)
    """
    nx, ny, nz = u.shape
    per_cell = np.float32(1 / cell_m)
    quarter = np.float32(0.25 / cell_m)
    two = np.float32(2)
    row = np.zeros(nz, np.float32)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                a = per_cell * (u[i + 1, j, k] - u[i, j, k])
                b = per_cell * (v[i, j + 1, k] - v[i, j, k])
                c = per_cell * (w[i, j, k + 1] - w[i, j, k])
                row[k] = two * (a * a + b * b + c * c)
            for k in range(LOW, nz - HIGH):
                s = quarter * (
                    u[i, j + 1, k] + u[i + 1, j + 1, k] - u[i, j - 1, k] - u[i + 1, j - 1, k]
                    + v[i + 1, j, k] + v[i + 1, j + 1, k] - v[i - 1, j, k] - v[i - 1, j + 1, k]
                )  # fmt: skip
                row[k] += s * s
            for k in range(LOW, nz - HIGH):
                s = quarter * (
                    u[i, j, k + 1] + u[i + 1, j, k + 1] - u[i, j, k - 1] - u[i + 1, j, k - 1]
                    + w[i + 1, j, k] + w[i + 1, j, k + 1] - w[i - 1, j, k] - w[i - 1, j, k + 1]
                )  # fmt: skip
                row[k] += s * s
            for k in range(LOW, nz - HIGH):
                s = quarter * (
                    v[i, j, k + 1] + v[i, j + 1, k + 1] - v[i, j, k - 1] - v[i, j + 1, k - 1]
                    + w[i, j + 1, k] + w[i, j + 1, k + 1] - w[i, j - 1, k] - w[i, j - 1, k + 1]
                )  # fmt: skip
                out[i, j, k] = row[k] + s * s


@numba.njit(cache=True, nogil=True)
def production_from_strain(nu, nu_m2_s, production):
    """Turn 2 S:S into the production of turbulence energy, P = nu_t 2 S:S [m2/s3], in place.

    Args:
        nu: Padded total viscosity, nu_t + nu_m2_s in air and 0 elsewhere [m2/s].
        production: Padded 2 S:S [1/s2], becomes P.
    """
    nx, ny, nz = nu.shape
    molecular = np.float32(nu_m2_s)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                production[i, j, k] *= max(nu[i, j, k] - molecular, np.float32(0))


@numba.njit(cache=True, nogil=True, inline="always")
def _limited_value(speed, courant, far_low, low, high, far_high):
    # Upwind value at the middle of the time step, with van Leer's limiter without a division by zero.
    is_forward = speed > 0
    centre = low if is_forward else high
    behind = far_low if is_forward else far_high
    ahead = high if is_forward else low
    a = centre - behind
    b = ahead - centre
    product = a * b
    total = a + b
    slope = np.float32(2) * product / (total if total != 0 else np.float32(1))
    slope = slope if product > 0 else np.float32(0)
    return centre + np.float32(0.5) * (np.float32(1) - courant) * slope


@numba.njit(cache=True, nogil=True, inline="always")
def _flux_row(speed, far_low, low, high, far_high, nu_low, nu_high, molecular, own, per_sigma, per_cell, dt, row, n_k):
    # Advective and diffusive flux of a scalar through one row of faces; the five rows are those around the faces.
    for k in range(LOW, n_k):
        courant = abs(speed[k]) * dt * per_cell
        row[k] = speed[k] * _limited_value(speed[k], courant, far_low[k], low[k], high[k], far_high[k])
    half = np.float32(0.5)
    for k in range(LOW, n_k):
        both = min(nu_low[k], nu_high[k])
        diffusivity = own + per_sigma * (half * (nu_low[k] + nu_high[k]) - molecular)
        diffusivity = diffusivity if both > 0 else np.float32(0)
        row[k] -= diffusivity * per_cell * (high[k] - low[k])


@numba.njit(cache=True, nogil=True)
def transport_scalar(scalar, u, v, w, nu, nu_m2_s, diffusivity_m2_s, sigma, dt_s, cell_m, out):
    """Advect and diffuse a scalar for one time step, without sources and sinks.

    out = s + dt (-div(u s) + div((D + nu_t / sigma) grad s))
    [s] = [s] + [s] [1/s]

    One explicit step: the face value is upwind plus a van Leer slope, taken at the middle of the time step, so it is of
    second order in smooth regions and creates no new extrema. Nothing diffuses into solids or through the box.

    Args:
        scalar: Padded scalar at cell centres; its padding at inlets holds the incoming value.
        u: Padded x-face velocities [m/s].
        nu: Padded total viscosity nu_t + nu_m2_s, 0 outside air [m2/s].
        diffusivity_m2_s: Molecular diffusivity of the scalar, D [m2/s].
        sigma: Turbulent Prandtl number of the scalar.
        out: Written: padded scalar after the step; not `scalar`.

    Stability: (|u| + |v| + |w|) dt < h and nu dt < h^2 / 6, ensured by `solver`.
    Source: van Leer 1974, doi:10.1016/0021-9991(74)90019-9 (limiter).
    Held by: tests/unit/flow/test_turbulence.py (total conserved; constant unchanged; no new extrema)
    """
    nx, ny, nz = scalar.shape
    per_cell = np.float32(1 / cell_m)
    dt = np.float32(dt_s)
    molecular = np.float32(nu_m2_s)
    own = np.float32(diffusivity_m2_s)
    per_sigma = np.float32(1 / sigma)
    n_k = nz - HIGH
    s = scalar
    x_low = np.zeros((ny, nz), np.float32)
    x_high = np.zeros(nz, np.float32)
    y_low = np.zeros(nz, np.float32)
    y_high = np.zeros(nz, np.float32)
    z = np.zeros(nz, np.float32)
    for j in range(LOW, ny - HIGH):
        _flux_row(
            u[LOW, j], s[LOW - 2, j], s[LOW - 1, j], s[LOW, j], s[LOW + 1, j], nu[LOW - 1, j], nu[LOW, j],
            molecular, own, per_sigma, per_cell, dt, x_low[j], n_k,
        )  # fmt: skip
    for i in range(LOW, nx - HIGH):
        _flux_row(
            v[i, LOW], s[i, LOW - 2], s[i, LOW - 1], s[i, LOW], s[i, LOW + 1], nu[i, LOW - 1], nu[i, LOW],
            molecular, own, per_sigma, per_cell, dt, y_low, n_k,
        )  # fmt: skip
        for j in range(LOW, ny - HIGH):
            _flux_row(
                u[i + 1, j], s[i - 1, j], s[i, j], s[i + 1, j], s[i + 2, j], nu[i, j], nu[i + 1, j],
                molecular, own, per_sigma, per_cell, dt, x_high, n_k,
            )  # fmt: skip
            _flux_row(
                v[i, j + 1], s[i, j - 1], s[i, j], s[i, j + 1], s[i, j + 2], nu[i, j], nu[i, j + 1],
                molecular, own, per_sigma, per_cell, dt, y_high, n_k,
            )  # fmt: skip
            _z_flux_row(s[i, j], w[i, j], nu[i, j], molecular, own, per_sigma, per_cell, dt, z, n_k)
            for k in range(LOW, n_k):
                change = x_low[j, k] - x_high[k] + y_low[k] - y_high[k] + z[k] - z[k + 1]
                out[i, j, k] = s[i, j, k] + dt * per_cell * change
            x_low[j, :] = x_high
            y_low[:] = y_high


@numba.njit(cache=True, nogil=True, inline="always")
def _z_flux_row(s, w, nu, molecular, own, per_sigma, per_cell, dt, row, n_k):
    half = np.float32(0.5)
    for k in range(LOW, n_k + 1):
        courant = abs(w[k]) * dt * per_cell
        row[k] = w[k] * _limited_value(w[k], courant, s[k - 2], s[k - 1], s[k], s[k + 1])
    for k in range(LOW, n_k + 1):
        both = min(nu[k - 1], nu[k])
        diffusivity = own + per_sigma * (half * (nu[k - 1] + nu[k]) - molecular)
        diffusivity = diffusivity if both > 0 else np.float32(0)
        row[k] -= diffusivity * per_cell * (s[k] - s[k - 1])


@numba.njit(cache=True, nogil=True)
def react_k_epsilon(k_old, e_old, k_moved, e_moved, production, nu, dt_s, c_1, c_2):
    """Apply production and dissipation to the moved k and epsilon, sinks implicitly, in place.

    k = (k' + dt P) / (1 + dt e / k)
    e = (e' + dt C_1 P e / k) / (1 + dt C_2 e / k)         primes: after transport; right-hand k, e: before the step
    [m2/s2], [m2/s3]

    Args:
        k_old: Padded turbulence energy before the step [m2/s2].
        e_old: Padded dissipation before the step [m2/s3].
        k_moved: Padded energy after transport, becomes the new energy [m2/s2].
        e_moved: Padded dissipation after transport, becomes the new dissipation [m2/s3].
        production: Padded P [m2/s3].
        nu: Padded total viscosity; 0 marks cells that are not air, which are unchanged.
        c_1: C_1 of the production, float32.
        c_2: C_2 of the dissipation, float32.

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, equations 2.2-2.4 (C_1 1.44, C_2 1.92).
    Held by: tests/unit/flow/test_turbulence.py (decay)
    """
    nx, ny, nz = k_old.shape
    dt = np.float32(dt_s)
    one = np.float32(1)
    k_floor = np.float32(K_FLOOR_M2_S2)
    e_floor = np.float32(EPSILON_FLOOR_M2_S3)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                rate = e_old[i, j, k] / max(k_old[i, j, k], k_floor)
                energy = (k_moved[i, j, k] + dt * production[i, j, k]) / (one + dt * rate)
                loss = (e_moved[i, j, k] + dt * c_1 * rate * production[i, j, k]) / (one + dt * c_2 * rate)
                is_air = nu[i, j, k] > 0
                k_moved[i, j, k] = max(energy, k_floor) if is_air else k_old[i, j, k]
                e_moved[i, j, k] = max(loss, e_floor) if is_air else e_old[i, j, k]


@numba.njit(cache=True, nogil=True)
def strain_sink_rng(energy, dissipation, production, nu, c_mu, dt_s, moved):
    """Add the strain term of the renormalised k-epsilon model to the moved dissipation, in place.

    de/dt = -R P e / k,   R = eta (1 - eta / eta_0) / (1 + beta eta^3),   eta = S k / e = sqrt(P / (C_mu e))
    [m2/s3 / s] = [m2/s3] [1/s]; eta_0 = 4.38, beta = 0.012

    Under strong strain (eta above eta_0: shear layers, separation) R is negative: more dissipation, less eddy
    viscosity.

    Args:
        energy: Padded k before the step [m2/s2].
        dissipation: Padded epsilon before the step [m2/s3].
        production: Padded P [m2/s3].
        nu: Padded total viscosity; 0 marks cells that are not air, which are unchanged.
        c_mu: C_mu of the model.
        moved: Padded epsilon after transport [m2/s3], modified.

    Source: Yakhot, Orszag, Thangam, Gatski and Speziale 1992, doi:10.1063/1.858424, equations 31 and 32.
    Held by: tests/unit/flow/test_turbulence.py (homogeneous shear)
    """
    nx, ny, nz = energy.shape
    k_floor = np.float32(K_FLOOR_M2_S2)
    e_floor = np.float32(EPSILON_FLOOR_M2_S3)
    dt = np.float32(dt_s)
    one = np.float32(1)
    per_c_mu = np.float32(1 / c_mu)
    per_eta_0 = np.float32(1 / ETA_0_RNG)
    beta = np.float32(BETA_RNG)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                loss = max(dissipation[i, j, k], e_floor)
                rate = loss / max(energy[i, j, k], k_floor)
                eta = np.sqrt(per_c_mu * production[i, j, k] / loss)
                share = eta * (one - eta * per_eta_0) / (one + beta * eta * eta * eta)
                change = dt * share * rate * production[i, j, k]
                # The sink is implicit: the remaining dissipation is positive.
                gain = moved[i, j, k] - change if change < 0 else moved[i, j, k] / (one + change / loss)
                moved[i, j, k] = gain if nu[i, j, k] > 0 else moved[i, j, k]


@numba.njit(cache=True, nogil=True)
def buoyancy_production(energy, dissipation, nu, nu_m2_s, stratification, sigma, c_1, dt_s, k_moved, e_moved):
    """Add the effect of buoyancy on turbulence to the moved k and epsilon, in place.

    G = -nu_t / sigma N^2;   k += dt G, epsilon += dt C_1 G e / k where air is unstable;
    k /= 1 + dt |G| / k where it is stable
    [m2/s3] = [m2/s] [1/s2]

    Args:
        energy: Padded k before the step [m2/s2].
        dissipation: Padded epsilon before the step [m2/s3].
        nu: Padded total viscosity, 0 outside air [m2/s].
        stratification: Padded N^2, above 0 where air is stable [1/s2].
        sigma: Turbulent Schmidt or Prandtl number of the scalar that makes the air light.
        c_1: C_1 of the production of epsilon, float32.
        k_moved: Padded k after transport, modified.
        e_moved: Padded epsilon after transport, modified.

    Source: Rodi 1987, doi:10.1029/JC092iC05p05305: buoyancy acts on epsilon only where it produces turbulence.
    Held by: tests/unit/flow/test_buoyancy.py
    """
    nx, ny, nz = energy.shape
    molecular = np.float32(nu_m2_s)
    per_sigma = np.float32(1 / sigma)
    dt = np.float32(dt_s)
    one, zero = np.float32(1), np.float32(0)
    k_floor = np.float32(K_FLOOR_M2_S2)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                made = -max(nu[i, j, k] - molecular, zero) * per_sigma * stratification[i, j, k]
                old = max(energy[i, j, k], k_floor)
                gain = max(made, zero)
                k_moved[i, j, k] = (k_moved[i, j, k] + dt * gain) / (one + dt * max(-made, zero) / old)
                e_moved[i, j, k] += dt * c_1 * gain * dissipation[i, j, k] / old


@numba.njit(cache=True, nogil=True)
def eddy_viscosity_k_epsilon(k_new, e_new, nu_m2_s, nu, energy, dissipation, c_mu):
    """Copy the new k and epsilon and set nu = nu_m2_s + C_mu k^2 / epsilon [m2/s] in air.

    Args:
        k_new: Padded new energy [m2/s2].
        e_new: Padded new dissipation [m2/s3].
        nu: Padded total viscosity, modified where it is not 0.
        energy: Written: copy of `k_new` in all cells of the box.
        dissipation: Written: copy of `e_new`.
        c_mu: C_mu, float32.

    Source: Launder and Spalding 1974, equation 2.1 (C_mu 0.09).
    """
    nx, ny, nz = nu.shape
    molecular = np.float32(nu_m2_s)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                eddy = c_mu * k_new[i, j, k] * k_new[i, j, k] / max(e_new[i, j, k], np.float32(EPSILON_FLOOR_M2_S3))
                nu[i, j, k] = molecular + eddy if nu[i, j, k] > 0 else np.float32(0)
                energy[i, j, k] = k_new[i, j, k]
            for k in range(LOW, nz - HIGH):
                dissipation[i, j, k] = e_new[i, j, k]


@numba.njit(cache=True, nogil=True)
def eddy_viscosity_smagorinsky(strain, constant, nu_m2_s, cell_m, nu):
    """Set nu = nu_m2_s + (C h)^2 |S| in air, |S| = sqrt(2 S:S).

    [m2/s] = [m]^2 [1/s]

    Args:
        strain: Padded 2 S:S [1/s2].
        constant: Smagorinsky's C.
        nu: Padded total viscosity, modified where it is not 0.

    Source: Smagorinsky 1963, doi:10.1175/1520-0493(1963)091<0099:GCEWTP>2.3.CO;2.
    """
    nx, ny, nz = nu.shape
    molecular = np.float32(nu_m2_s)
    squared_length = np.float32((constant * cell_m) ** 2)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                total = molecular + squared_length * np.sqrt(strain[i, j, k])
                nu[i, j, k] = total if nu[i, j, k] > 0 else np.float32(0)


class TurbulenceModel(Protocol):
    """Sets eddy viscosity and wall friction from the flow."""

    nu: F32
    nu_m2_s: float
    friction_m_s: NDArray[np.float64]

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Advance the model by a time step in the given face velocities; `scratch` may be overwritten."""
        ...


# Padded molecular viscosity in air, zero elsewhere.
def _molecular(domain: Domain, nu_m2_s: float) -> F32:
    return np.where(domain.air, np.float32(nu_m2_s), np.float32(0))


class Laminar:
    """No turbulence: constant viscosity [m2/s], friction of a laminar layer at walls."""

    def __init__(self, domain: Domain, nu_m2_s: float) -> None:
        self.nu_m2_s = nu_m2_s
        self.nu = _molecular(domain, nu_m2_s)
        # The factor c of `tau = c (U - U_wall)` of a laminar wall layer: c = nu / (h / 2).
        self.friction_m_s = np.full(domain.friction.cells.size, 2.0 * nu_m2_s / domain.cell_m)

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Do nothing."""


class Smagorinsky:
    """Large-eddy simulation: eddy viscosity from the resolved strain, power-law friction at walls.

    The resulting wind is unsteady; average it over time for a steady one.
    """

    def __init__(self, domain: Domain, nu_m2_s: float, *, constant: float = SMAGORINSKY_CONSTANT) -> None:
        """Start from still air."""
        self._domain = domain
        self._constant = constant
        self.nu_m2_s = nu_m2_s
        self.nu = _molecular(domain, nu_m2_s)
        self.friction_m_s = np.zeros(domain.friction.cells.size)

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Recompute eddy viscosity and friction."""
        cell_m, walls = self._domain.cell_m, self._domain.friction
        u, v, w = velocity
        strain_squared(*velocity, cell_m, scratch[0])
        eddy_viscosity_smagorinsky(scratch[0], self._constant, self.nu_m2_s, cell_m, self.nu)
        _, ny, nz = self.nu.shape
        power_law_friction(
            walls.cells, walls.velocity_m_s, u.ravel(), v.ravel(), w.ravel(), ny * nz, nz,
            self.nu_m2_s, cell_m, self.friction_m_s,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class KEpsilonConstants:
    """Constants of a k-epsilon model; `has_strain_sink`: with the term of the renormalised model, `strain_sink_rng`."""

    c_mu: float
    c_1: float
    c_2: float
    sigma_k: float
    sigma_epsilon: float
    has_strain_sink: bool


# Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, table 2.1.
STANDARD = KEpsilonConstants(c_mu=C_MU, c_1=1.44, c_2=1.92, sigma_k=1.0, sigma_epsilon=1.3, has_strain_sink=False)
# Yakhot, Orszag, Thangam, Gatski and Speziale 1992, doi:10.1063/1.858424.
RENORMALISED = KEpsilonConstants(
    c_mu=0.0845, c_1=1.42, c_2=1.68, sigma_k=0.7194, sigma_epsilon=0.7194, has_strain_sink=True
)


class KEpsilon:
    """The k-epsilon model with wall functions in k; with its standard constants that of pimpleFoam's `kEpsilon`.

    The room starts with the turbulence of the inlet, as AutoGDM+ sets it: k = 1.5 (I U)^2,
    epsilon = C_mu^(3/4) k^(3/2) / L with L = 0.1 times the inlet's shorter side.
    """

    def __init__(self, domain: Domain, nu_m2_s: float, constants: KEpsilonConstants = STANDARD) -> None:
        self._domain = domain
        self._constants = constants
        # N^2 of the air [1/s2] and the turbulent Schmidt number of the scalar that makes it light: set by
        # `buoyancy.Buoyancy`.
        self.stratification_per_s2: F32 | None = None
        self.scalar_sigma = 1.0
        self.nu_m2_s = nu_m2_s
        self.nu = _molecular(domain, nu_m2_s)
        self.friction_m_s = np.zeros(domain.friction.cells.size)
        k, epsilon = start_turbulence(domain)
        self.k = np.full_like(self.nu, k)
        self.epsilon = np.full_like(self.nu, epsilon)
        for placed in domain.inlets:
            inlet_k, inlet_epsilon = inlet_turbulence(placed, domain)
            self.k[placed.layer(placed.outside)] = inlet_k
            self.epsilon[placed.layer(placed.outside)] = inlet_epsilon
        self.set_turbulence(self.k.copy(), self.epsilon.copy())

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Advance k and epsilon by one explicit step, then the eddy viscosity and the wall friction."""
        cell_m, walls = self._domain.cell_m, self._domain.friction
        production, k_new, e_new = scratch
        constants, nu_m2_s = self._constants, self.nu_m2_s
        u, v, w = velocity
        _, ny, nz = self.nu.shape
        self._fill_outlets()
        strain_squared(*velocity, cell_m, production)
        production_from_strain(self.nu, self.nu_m2_s, production)
        wall_production(
            walls.cells, walls.velocity_m_s, u.ravel(), v.ravel(), w.ravel(), ny * nz, nz, self.k.ravel(),
            self.nu_m2_s, self.friction_m_s, cell_m, production.ravel(),
        )  # fmt: skip
        for scalar, sigma, moved in (
            (self.k, constants.sigma_k, k_new),
            (self.epsilon, constants.sigma_epsilon, e_new),
        ):
            transport_scalar(scalar, *velocity, self.nu, nu_m2_s, nu_m2_s, sigma, dt_s, cell_m, moved)
        if self.stratification_per_s2 is not None:
            buoyancy_production(
                self.k, self.epsilon, self.nu, nu_m2_s, self.stratification_per_s2, self.scalar_sigma,
                np.float32(constants.c_1), dt_s, k_new, e_new,
            )  # fmt: skip
        if constants.has_strain_sink:
            strain_sink_rng(self.k, self.epsilon, production, self.nu, constants.c_mu, dt_s, e_new)
        react_k_epsilon(
            self.k, self.epsilon, k_new, e_new, production, self.nu, dt_s,
            np.float32(constants.c_1), np.float32(constants.c_2),
        )  # fmt: skip
        self.set_turbulence(k_new, e_new)

    def set_turbulence(self, k_m2_s2: F32, epsilon_m2_s3: F32) -> None:
        """Set padded k and epsilon, with the walls' values, and derive viscosity and friction; epsilon is modified."""
        cells, cell_m, nu = self._domain.friction.cells, self._domain.cell_m, self.nu_m2_s
        wall_dissipation(cells, k_m2_s2.ravel(), nu, cell_m, epsilon_m2_s3.ravel())
        c_mu = np.float32(self._constants.c_mu)
        eddy_viscosity_k_epsilon(k_m2_s2, epsilon_m2_s3, nu, self.nu, self.k, self.epsilon, c_mu)
        log_law_friction(cells, self.k.ravel(), nu, cell_m, self.friction_m_s)

    # Outside an outlet k and epsilon are those inside.
    def _fill_outlets(self) -> None:
        for placed in self._domain.outlets:
            for scalar in (self.k, self.epsilon):
                value = scalar[placed.layer(slice(placed.inside, placed.inside + 1))]
                scalar[placed.layer(placed.outside)] = value


def start_turbulence(domain: Domain) -> tuple[float, float]:
    """Return k [m2/s2] and epsilon [m2/s3] of the air at the start: those of the most turbulent inlet."""
    return max((inlet_turbulence(placed, domain) for placed in domain.inlets), default=(1e-4, 1e-5))


def inlet_turbulence(placed: PlacedPatch, domain: Domain) -> tuple[float, float]:
    """Return k [m2/s2] and epsilon [m2/s3] of the air that an inlet brings."""
    inlet = placed.patch
    assert isinstance(inlet, Inlet)
    assert placed.inflow is not None
    speed = placed.inflow.typical_speed_m_s
    sides = [(row.stop - row.start) * domain.cell_m for row in placed.rows]
    length = 0.1 * min(sides) if inlet.turbulence_length_m is None else inlet.turbulence_length_m
    k = max(1.5 * float(np.square(inlet.turbulence_intensity * speed)), 1e-8)
    return k, _C_MU_ROOT_4 * _C_MU_ROOT_4 * _C_MU_ROOT_4 * k * math.sqrt(k) / length


def make_model(name: str, domain: Domain, nu_m2_s: float) -> TurbulenceModel:
    """Return the turbulence model of that name: k_epsilon, rng_k_epsilon, smagorinsky or laminar."""
    models: dict[str, Callable[[Domain, float], TurbulenceModel]] = {
        "k_epsilon": KEpsilon,
        "rng_k_epsilon": lambda domain, nu_m2_s: KEpsilon(domain, nu_m2_s, RENORMALISED),
        "smagorinsky": Smagorinsky,
        "laminar": Laminar,
    }
    if name not in models:
        raise ValueError(f"turbulence: expected one of {', '.join(models)}, was {name!r}.")
    return models[name](domain, nu_m2_s)


def still_velocity(domain: Domain) -> Velocity:
    """Return zero face velocities for a domain."""
    return padded(domain.shape), padded(domain.shape), padded(domain.shape)
