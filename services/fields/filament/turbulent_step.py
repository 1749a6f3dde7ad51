# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""One step of filaments in turbulent air: mean wind, large eddies, each filament's own velocity, and growth."""

import math

import numba
import numpy as np

from gslcosim.base import elementary
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim_services.fields.filament.counter_rng import derive_step_key, normal_at
from gslcosim_services.fields.filament.filament_step import (
    NOT_FINITE,
    cell_index,
    is_step_in_free_air,
    trace_displacement,
    trace_reflections,
)
from gslcosim_services.fields.turbulence.air import (
    AMPLITUDE,
    EPSILON_ROOT,
    OWN_RATE,
    OWN_STD,
    SHEAR_SQUARE,
    node_value_with_slopes,
    wind_with_slopes,
)
from gslcosim_services.fields.turbulence.eddies import eddy_velocity

INNER_G = 0.03
"""Part of Richardson's constant that is within a filament: pairs of its molecules part as INNER_G eps t^3."""
# sigma^2 = (INNER_G / 6) eps t^3 along each axis of a filament that begins as a point.
_GROWTH = elementary.cbrt(INNER_G / 6.0)


@numba.njit(cache=True, nogil=True)
def grown_variance_m2(variance_m2, epsilon_root, length_m, dt_s):
    """Return a filament's sigma^2 after a step [m2].

    d(sigma^2)/dt = 3 b eps^(1/3) sigma^(4/3), b = (g_i / 6)^(1/3): Richardson's law, with the eddies of the
    integral length as the largest that spread a filament from within; exact below that size.

    Args:
        variance_m2: sigma^2 before [m2].
        epsilon_root: Cube root of the dissipation [m^(2/3)/s].
        length_m: Integral length [m].
        dt_s: The step [s].

    Source:
        Richardson 1926, Proceedings of the Royal Society A 110, 709: diffusivity proportional to r^(4/3).
    Held by:
        tests/analytic/test_turbulent_plume.py
    """
    rate = _GROWTH * epsilon_root
    if variance_m2 < length_m * length_m:
        root = elementary.cbrt(variance_m2) + rate * dt_s
        return root * root * root
    return variance_m2 + 3.0 * rate * length_m * elementary.cbrt(length_m) * dt_s


@numba.njit(cache=True, nogil=True)
def move_turbulent_filaments_inplace(
    position_world_m, sigma_m, birth_steps, filament_id, source_index, own_velocity, n, source_buoyancy, buoyancy_power,
    velocity_m_s, air, layers, occupancy, origin_m, cell_m, step, step_s, key,
):  # fmt: skip
    """Advance all filaments by one step in turbulent air and drop those that left through an outlet.

    dp = (U + u + b / sigma^q) dt + s v dt
    v' = e v + grad(s) T (1 - e) + sqrt(1 - e^2) xi2,  e = exp(-dt / T),  T its time, see `OWN_SHARE`

    U is the mean wind, u the velocity of the large eddies, which has no divergence; s v is a filament's own velocity.
    The gradient keeps a well-mixed gas well mixed where the turbulence is uneven. Walls reflect the filament's own part
    and its velocity.

    Args:
        position_world_m: (>= n, 3) filament centres, world frame, xyz [m]; modified.
        sigma_m: (>= n,) standard deviations [m]; modified.
        birth_steps: (>= n,) time of birth in steps since the start of the plume, with fraction; reordered.
        filament_id: (>= n,) int64, distinct; reordered.
        source_index: (>= n,) int32 index into the tables of sources; reordered.
        own_velocity: (>= n, 3) velocity v of each filament for itself, in its standard deviations; modified.
        n: Number of filaments.
        source_buoyancy: (n_sources,) coefficient b of the gas's vertical velocity, upward [m^(1 + q)/s].
        buoyancy_power: Its power q of the size.
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s], held over the step.
        air: `AirNodes`.
        layers: `EddyLayers` of the step's middle.
        occupancy: (nx, ny, nz) uint8, 0 free, 1 solid, 2 outlet.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        step: Number of the step.
        step_s: Length of a step dt [s].
        key: 64 bits of the stream of filaments' own velocities, uint64.

    Returns:
        Number of filaments that are left, or NOT_FINITE.

    Source:
        Thomson 1987, Journal of Fluid Mechanics 180, 529, equation 32 for Gaussian isotropic turbulence, written for
        u / s; Obukhov 1959, Advances in Geophysics 6, 113 for two filaments.
    Held by:
        tests/analytic/test_turbulent_plume.py
    """
    step_key = derive_step_key(key, step)
    n_left = 0
    for p in range(n):
        x, y, z = position_world_m[p, 0], position_world_m[p, 1], position_world_m[p, 2]
        dt_s = min(step - birth_steps[p], 1.0) * step_s
        u, v, w = trilinear_wind(velocity_m_s, origin_m, cell_m, x, y, z)
        amplitude, ax, ay, az = node_value_with_slopes(air.nodes, AMPLITUDE, origin_m, cell_m, x, y, z)
        drift = wind_with_slopes(air.drift_m_s, origin_m, cell_m, x, y, z)
        g, gx, gy, gz = node_value_with_slopes(air.nodes, SHEAR_SQUARE, origin_m, cell_m, x, y, z)
        eu, ev, ew = eddy_velocity(layers, x, y, z, drift, amplitude, (ax, ay, az), g, (gx, gy, gz))
        s, sx, sy, sz = node_value_with_slopes(air.nodes, OWN_STD, origin_m, cell_m, x, y, z)
        rate, _, _, _ = node_value_with_slopes(air.nodes, OWN_RATE, origin_m, cell_m, x, y, z)
        epsilon_root, _, _, _ = node_value_with_slopes(air.nodes, EPSILON_ROOT, origin_m, cell_m, x, y, z)
        rise = source_buoyancy[source_index[p]] / elementary.pow(sigma_m[p], buoyancy_power)
        kept = elementary.exp(-dt_s * rate)
        pushed, spread = (1.0 - kept) / rate, math.sqrt(1.0 - kept * kept)
        first = np.uint64(filament_id[p]) * np.uint64(3)
        vx = kept * own_velocity[p, 0] + pushed * sx + spread * normal_at(step_key, first)
        vy = kept * own_velocity[p, 1] + pushed * sy + spread * normal_at(step_key, first + np.uint64(1))
        vz = kept * own_velocity[p, 2] + pushed * sz + spread * normal_at(step_key, first + np.uint64(2))
        ex, ey, ez = s * vx * dt_s, s * vy * dt_s, s * vz * dt_s
        dx, dy, dz = (u + eu) * dt_s, (v + ev) * dt_s, (w + ew + rise) * dt_s
        if not math.isfinite((dx + dy + dz) + (ex + ey + ez)):
            return NOT_FINITE
        nx, ny, nz = x + (dx + ex), y + (dy + ey), z + (dz + ez)
        i, ni = cell_index(x, origin_m[0], cell_m), cell_index(nx, origin_m[0], cell_m)
        j, nj = cell_index(y, origin_m[1], cell_m), cell_index(ny, origin_m[1], cell_m)
        k, nk = cell_index(z, origin_m[2], cell_m), cell_index(nz, origin_m[2], cell_m)
        if not ((i == ni and j == nj and k == nk) or is_step_in_free_air(occupancy, i, j, k, ni, nj, nk)):
            nx, ny, nz, has_left = trace_displacement(occupancy, origin_m, cell_m, x, y, z, dx, dy, dz, reflects=False)
            if has_left:
                continue
            nx, ny, nz, has_left, flip_x, flip_y, flip_z = trace_reflections(
                occupancy, origin_m, cell_m, nx, ny, nz, ex, ey, ez, reflects=True
            )
            if has_left:
                continue
            vx, vy, vz = flip_x * vx, flip_y * vy, flip_z * vz
        size_m2 = grown_variance_m2(sigma_m[p] * sigma_m[p], epsilon_root, air.length_m, dt_s)
        position_world_m[n_left, 0], position_world_m[n_left, 1], position_world_m[n_left, 2] = nx, ny, nz
        own_velocity[n_left, 0], own_velocity[n_left, 1], own_velocity[n_left, 2] = vx, vy, vz
        sigma_m[n_left] = math.sqrt(size_m2)
        birth_steps[n_left] = birth_steps[p]
        filament_id[n_left] = filament_id[p]
        source_index[n_left] = source_index[p]
        n_left += 1
    return n_left
