"""Point-mass flight of a rotorcraft: its force lags what its control wants."""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import numpy as np

from gslcosim.training.batch.free_space import array_at, is_hit, wind_at_inplace
from gslcosim.training.batch.reference_free_kernels import reference_free_njit
from gslcosim_services.world.physics.rotors import drag_force
from gslcosim_services.world.physics.simulation_loop import path_force_inplace


@reference_free_njit()
def fly_lagged_tick(search, path, vehicle, case, room, work, tick, time_s):
    """Fly a rotorcraft for a tick as a point mass that is upright.

    df/dt = j_ref + (f_wanted - f)/tau,  dv/dt = f - g + D(wind - v)/m
    [m/s^3] = [m/s^2]/[s],  [m/s^2] = [N]/[kg]

    f_wanted is what the vehicle's own control wants with its limits, and tau how long its attitude takes to give it,
    sideways, and its rotors, upwards. The wind is that at the tick's beginning. It stops where it hits something.

    Args:
        search: Record of `SEARCH`; place, velocity and force are advanced.
        path: Record of `records.STATE`; integral and heading are advanced.
        vehicle: Record of `records.CONSTANTS`.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that is advanced to.
        time_s: Time since the sources opened at the tick's beginning [s].

    Source:
        Our choice: the control of `world.physics`, whose attitude loop is much faster than its position loop.
    Deviation:
        Attitude and single rotors are left out; drag is that of an upright vehicle in hover; steps are those of point
        robots.
    Held by:
        tests/integration/training/test_batch_of_rotorcraft.py
    """
    p, v, f = search.position_m, search.velocity_m_s, search.force_m_s2
    dt_s = case.tick_s / case.n_substeps
    wind = array_at(work.wind_m_s, (work.n_places, 3), np.float64)[0]
    wind_at_inplace(wind, room, time_s, p[0], p[1], p[2])
    for i_substep in range(case.n_substeps):
        if is_hit(room, case.radius_m, case.half_height_m, p):
            search.is_touching = search.is_bumped = 1
            v[0] = v[1] = v[2] = 0.0
            return
        t_s = (tick - 1 - path.start_tick) * case.tick_s + i_substep * dt_s
        f_x, f_y, f_z, j_x, j_y, j_z = path_force_inplace(vehicle, path, p, v, t_s, dt_s)
        f[0] += j_x * dt_s + case.tilt_share * (f_x - f[0])
        f[1] += j_y * dt_s + case.tilt_share * (f_y - f[1])
        f[2] += j_z * dt_s + case.lift_share * (f_z - f[2])
        d_x, d_y, d_z = drag_force(vehicle, case.rotor_speeds_rad_s, wind[0] - v[0], wind[1] - v[1], wind[2] - v[2])
        v[0] += dt_s * (f[0] + d_x / vehicle.mass_kg)
        v[1] += dt_s * (f[1] + d_y / vehicle.mass_kg)
        v[2] += dt_s * (f[2] - vehicle.gravity_m_s2 + d_z / vehicle.mass_kg)
        for axis in range(3):
            p[axis] += dt_s * v[axis]
