"""Friction at walls: how strongly a wall slows the air beside it, and what it does to turbulence there.

Lists and padding are those of `domain.WallFriction`. The wall is half a cell from the velocities that it slows.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic

import math

import numba
import numpy as np

VON_KARMAN = 0.41
WALL_ROUGHNESS_E = 9.8  # smooth wall
C_MU = 0.09
LAMINAR_SUBLAYER = 11.53  # y+ at which y+ = ln(E y+) / kappa


@numba.njit(cache=True, nogil=True)
def viscous_friction(friction_m_s, nu_m2_s, cell_m):
    """Set the friction velocity factor c of `tau = c (U - U_wall)` of a laminar wall layer: c = nu / (h / 2) [m/s]."""
    for n in range(friction_m_s.shape[0]):
        friction_m_s[n] = 2.0 * nu_m2_s / cell_m


@numba.njit(cache=True, nogil=True)
def log_law_friction(cells, k_m2_s2, nu_m2_s, cell_m, friction_m_s):
    """Set the wall friction from the turbulence energy beside the wall.

    u* = C_mu^(1/4) k^(1/2),  y+ = u* y / nu,  c = kappa u* / ln(E y+)   above the laminar sublayer, else nu / y
    [m/s] = [m/s];  y = h / 2, tau = c (U - U_wall) is the kinematic shear stress [m2/s2]

    Args:
        cells: (n,) flat padded indices of wall cells.
        k_m2_s2: Flat padded turbulence energy [m2/s2].
        nu_m2_s: Molecular viscosity [m2/s].
        cell_m: Edge of a cell, h [m].
        friction_m_s: Written: (n,) c [m/s].

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, section 2.3 (kappa 0.41, E 9.8).
    Held by: tests/unit/flow/test_turbulence.py (log law recovered)
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        speed = C_MU**0.25 * math.sqrt(k_m2_s2[cells[n]])
        y_plus = speed * y / nu_m2_s
        if y_plus > LAMINAR_SUBLAYER:
            friction_m_s[n] = VON_KARMAN * speed / math.log(WALL_ROUGHNESS_E * y_plus)
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
        cells: (n,) flat padded indices of wall cells.
        wall_velocity: (n, 3) velocity of the wall [m/s].
        u: Flat padded x-face velocities [m/s].
        v: y-face velocities [m/s].
        w: z-face velocities [m/s].
        stride_x: Distance of x-neighbours in the flat arrays.
        stride_y: Same for y-neighbours.
        nu_m2_s: Molecular viscosity [m2/s].
        cell_m: Edge of a cell, h [m].
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
        turbulent = (speed / 8.3) ** 0.875 * (nu_m2_s / y) ** 0.125
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
        dt_s: Time step [s].
        cell_m: Edge of a cell, h [m].
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
        cells: (n,) flat padded indices of wall cells.
        wall_velocity: (n, 3) velocity of the wall [m/s].
        u: Flat padded x-face velocities [m/s].
        v: y-face velocities [m/s].
        w: z-face velocities [m/s].
        stride_x: Distance of x-neighbours in the flat arrays.
        stride_y: Same for y-neighbours.
        k_m2_s2: Flat padded turbulence energy [m2/s2].
        nu_m2_s: Molecular viscosity [m2/s].
        friction_m_s: (n,) c from `log_law_friction` [m/s].
        cell_m: Edge of a cell [m].
        production: Flat padded production [m2/s3], modified in wall cells.

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, section 2.3.
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        c = cells[n]
        speed = _speed_past_wall(c, wall_velocity[n], u, v, w, stride_x, stride_y)
        star = C_MU**0.25 * math.sqrt(k_m2_s2[c])
        is_turbulent = star * y / nu_m2_s > LAMINAR_SUBLAYER
        production[c] = np.float32(friction_m_s[n] * speed * star / (VON_KARMAN * y) if is_turbulent else 0.0)


@numba.njit(cache=True, nogil=True)
def wall_dissipation(cells, k_m2_s2, nu_m2_s, cell_m, epsilon):
    """Set the dissipation in wall cells to that of the log layer, or of the laminar sublayer.

    epsilon = C_mu^(3/4) k^(3/2) / (kappa y),   2 nu k / y^2 inside the sublayer
    [m2/s3] = [m3/s3] / [m]

    Args:
        cells: (n,) flat padded indices of wall cells.
        k_m2_s2: Flat padded turbulence energy [m2/s2].
        nu_m2_s: Molecular viscosity [m2/s].
        cell_m: Edge of a cell [m].
        epsilon: Flat padded dissipation [m2/s3], modified in wall cells.

    Source: Launder and Spalding 1974, doi:10.1016/0045-7825(74)90029-2, section 2.3.
    """
    y = 0.5 * cell_m
    for n in range(cells.shape[0]):
        k = k_m2_s2[cells[n]]
        star = C_MU**0.25 * math.sqrt(k)
        if star * y / nu_m2_s > LAMINAR_SUBLAYER:
            epsilon[cells[n]] = np.float32(star**3 / (VON_KARMAN * y))
        else:
            epsilon[cells[n]] = np.float32(2.0 * nu_m2_s * k / (y * y))


@numba.njit(cache=True, nogil=True)
def mirror_into_ghosts(velocity, faces, starts, sources):
    """Set the velocities inside obstacles, beside their surface, to minus the mean of those beside them, in place.

    In between, on the surface, the velocity is then that of a wall at rest. A wall one cell thick has one value for
    both of its sides, the mean.

    Args:
        velocity: Flat padded velocities of one component [m/s], modified at `faces`.
        faces: (n,) flat indices.
        starts: (n + 1,) where each ghost's sources start.
        sources: Flat indices of open faces.

    Held by:
        tests/unit/flow/boundaries/test_ghosts.py
    """
    for n in range(faces.shape[0]):
        total = 0.0
        for m in range(starts[n], starts[n + 1]):
            total += velocity[sources[m]]
        velocity[faces[n]] = np.float32(-total / (starts[n + 1] - starts[n]))
