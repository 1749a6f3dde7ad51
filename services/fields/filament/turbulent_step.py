# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""One step of filaments in turbulent air: mean wind, large eddies, each filament's own velocity, and growth."""

import math

import numba
import numpy as np

from gslcosim.base import elementary
from gslcosim_services.fields.filament.counter_rng import derive_step_key, normal_at
from gslcosim_services.fields.filament.filament_step import NOT_FINITE, move_near_walls
from gslcosim_services.fields.turbulence.air import eddy_velocity_at, nodes_with_slopes
from gslcosim_services.fields.turbulence.eddies import EPSILON_ROOT, OWN_RATE, OWN_STD, slopes_of
from gslcosim_services.fields.turbulence.vector_kernels import N_SUMS
from gslcosim_services.fields.turbulence.wall_faces import wind_beside_walls

# An even change from this share of the velocity at its end carries a filament as far, in the mean square, as noise does
# that begins at rest: a third of its end's variance times the time's square.
_FROM_REST = 2.0 / math.sqrt(3.0) - 1.0
# Columns of `held`, after the velocity of eddies, its change, that of the filament's own, and the last wind.
OWN, GROWTH, N_HELD = 12, 13, 14
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


@numba.njit(cache=True, nogil=True, inline="always")
def _renew_velocity(x, y, z, u, v, w, p, held, own_velocity, sigma_m, first, air, layers, origin_m, cell_m, hold_s,
                    lead_s, late_s, step_key, sums):  # fmt: skip
    # Writes to `held` how filament p's velocities and size change until the next renewal.
    node = nodes_with_slopes(air.nodes, origin_m, cell_m, x, y, z)
    s, rate, (sx, sy, sz) = np.float64(node[OWN_STD]), np.float64(node[OWN_RATE]), slopes_of(node, OWN_STD)
    kept = elementary.exp(-hold_s * rate)
    pushed, spread = (1.0 - kept) / rate, math.sqrt(1.0 - kept * kept)
    is_newborn = held[p, OWN] == 0.0
    for c, slope in enumerate((sx, sy, sz)):
        now = own_velocity[p, c]
        later = kept * now + pushed * slope + spread * normal_at(step_key, first + np.uint64(c))
        if is_newborn:
            now = own_velocity[p, c] = _FROM_REST * later
        held[p, 6 + c] = (later - now) / hold_s
    vx, vy, vz = own_velocity[p, 0], own_velocity[p, 1], own_velocity[p, 2]
    # The newborn have no velocity of eddies yet. Then where the filament will be with the velocities that it has.
    for moment in range(0 if is_newborn else 1, 2):
        ahead_s = lead_s if moment == 1 else -late_s
        e = eddy_velocity_at(
            air, layers[moment], origin_m, cell_m, x + ahead_s * (u + held[p, 0] + s * vx),
            y + ahead_s * (v + held[p, 1] + s * vy), z + ahead_s * (w + held[p, 2] + s * vz), sums,
        )  # fmt: skip
        for c in range(3):
            held[p, 3 + c] = (e[c] - held[p, c]) / lead_s
            if moment == 0:
                held[p, c] = e[c]
    grown_m = math.sqrt(grown_variance_m2(sigma_m * sigma_m, node[EPSILON_ROOT], air.length_m, hold_s))
    held[p, OWN], held[p, GROWTH] = s, (grown_m - sigma_m) / hold_s


# Division by zero as in numpy: the movement is checked anyway.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def move_turbulent_filaments_inplace(
    position_world_m, sigma_m, birth_steps, filament_id, source_index, own_velocity, held, n, source_buoyancy,
    buoyancy_power, velocity_m_s, air, layers, occupancy, wall_faces, origin_m, cell_m, step, step_s, n_hold, key,
):  # fmt: skip
    """Advance all filaments by one step in turbulent air and drop those that left through an outlet.

    dp = (U + u + b / sigma^q) dt + s v dt
    v' = e v + grad(s) T (1 - e) + sqrt(1 - e^2) xi,  e = exp(-h / T),  T its time, see `OWN_SHARE`

    U is the mean wind half way along the step, u the velocity of the large eddies, which has no divergence; s v is a
    filament's own velocity. The gradient keeps a well-mixed gas well mixed where the turbulence is uneven. Walls
    reflect the filament's own part and its velocity.

    A filament's velocities are renewed each `n_hold` steps, in turns by its number: eddies drift with filaments, so
    what a filament feels changes more slowly than its place. In this time h its s and its growth stay, and u and v go
    evenly to what they will be at its end.

    Args:
        position_world_m: (>= n, 3) filament centres, world frame, xyz [m]; modified.
        sigma_m: (>= n,) standard deviations [m]; modified.
        birth_steps: (>= n,) time of birth in steps since the start of the plume, with fraction; reordered.
        filament_id: (>= n,) int64, distinct; reordered.
        source_index: (>= n,) int32 index into the tables of sources; reordered.
        own_velocity: (>= n, 3) velocity v of each filament for itself, in its standard deviations; modified.
        held: (>= n, N_HELD) velocity u of eddies [m/s] and its change [m/s2], change of v [1/s], wind of the
            step before [m/s], standard deviation s of its own velocity [m/s], and growth of sigma [m/s] of each
            filament, zeros for the newborn; float32, modified.
        n: Number of filaments.
        source_buoyancy: (n_sources,) coefficient b of the gas's vertical velocity, upward [m^(1 + q)/s].
        buoyancy_power: Its power q of the size.
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s], held over the step.
        air: `AirNodes`.
        layers: Two `EddyLayers`, at the step's start and `n_hold` steps later.
        occupancy: (nx, ny, nz) uint8, 0 free, 1 solid, 2 outlet.
        wall_faces: Of `find_wall_faces`: no wind blows through these.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        step: Number of the step.
        step_s: Length of a step dt [s].
        n_hold: Steps between two times at which a filament's velocities are renewed.
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
    sums = np.empty(N_SUMS, np.float32)
    n_left = 0
    for p in range(n):
        x, y, z = position_world_m[p, 0], position_world_m[p, 1], position_world_m[p, 2]
        dt_s = min(step - birth_steps[p], 1.0) * step_s
        if held[p, OWN] == 0.0:
            u, v, w = wind_beside_walls(velocity_m_s, wall_faces, origin_m, cell_m, x, y, z)
        else:
            u, v, w = held[p, 9], held[p, 10], held[p, 11]
        turn = (step + filament_id[p]) % n_hold
        if dt_s > 0.0 and (turn == 0 or held[p, OWN] == 0.0):
            late_s = step_s - dt_s
            _renew_velocity(
                x, y, z, u, v, w, p, held, own_velocity, sigma_m[p], np.uint64(filament_id[p]) * np.uint64(3), air,
                layers, origin_m, cell_m, (n_hold - turn) * step_s - late_s, n_hold * step_s - late_s, late_s,
                step_key, sums,
            )  # fmt: skip
        own, half_s = held[p, OWN], 0.5 * dt_s
        ex = own * (own_velocity[p, 0] + half_s * held[p, 6])
        ey = own * (own_velocity[p, 1] + half_s * held[p, 7])
        ez = own * (own_velocity[p, 2] + half_s * held[p, 8])
        dx = held[p, 0] + half_s * held[p, 3]
        dy = held[p, 1] + half_s * held[p, 4]
        dz = held[p, 2] + half_s * held[p, 5]
        size = sigma_m[p] if buoyancy_power == 1 else elementary.pow(sigma_m[p], buoyancy_power)
        dz += source_buoyancy[source_index[p]] / size
        u, v, w = wind_beside_walls(
            velocity_m_s, wall_faces, origin_m, cell_m, x + half_s * (u + dx + ex), y + half_s * (v + dy + ey),
            z + half_s * (w + dz + ez),
        )  # fmt: skip
        held[p, 9], held[p, 10], held[p, 11] = u, v, w
        ex, ey, ez = ex * dt_s, ey * dt_s, ez * dt_s
        dx, dy, dz = (u + dx) * dt_s, (v + dy) * dt_s, (w + dz) * dt_s
        if not math.isfinite((dx + dy + dz) + (ex + ey + ez)):
            return NOT_FINITE
        x, y, z, has_left, flip_x, flip_y, flip_z = move_near_walls(
            occupancy, origin_m, cell_m, x, y, z, dx, dy, dz, ex, ey, ez
        )
        if has_left:
            continue
        for c, flip in enumerate((flip_x, flip_y, flip_z)):
            own_velocity[p, c] *= flip
            held[p, 6 + c] *= flip
        position_world_m[n_left, 0], position_world_m[n_left, 1], position_world_m[n_left, 2] = x, y, z
        for c in range(3):
            own_velocity[n_left, c] = own_velocity[p, c] + dt_s * held[p, 6 + c]
            held[n_left, c] = held[p, c] + dt_s * held[p, 3 + c]
        sigma_m[n_left] = sigma_m[p] + held[p, GROWTH] * dt_s
        if n_left != p:
            birth_steps[n_left] = birth_steps[p]
            filament_id[n_left] = filament_id[p]
            source_index[n_left] = source_index[p]
            for c in range(3, N_HELD):
                held[n_left, c] = held[p, c]
        n_left += 1
    return n_left
