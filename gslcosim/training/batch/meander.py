"""Meandering plumes: the wandering paths of a search, kept as far back as the front has come since."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import math

from gslcosim.training.batch.pcg64 import next_normal_inplace, seed_inplace
from gslcosim.training.batch.reference_free_kernels import reference_free_njit
from gslcosim_services.fields.models.gaussian_plume import distances_along_and_across, plume_ppm, spreads_at


@reference_free_njit()
def begin_paths_inplace(wanders, memory, case, names, seed):
    """Begin the paths of a search's plumes at their first knots; see `gaussian_plume.WanderingPath`.

    Args:
        wanders: (2 n_plumes or more,) records of `WANDER`: sideways and upward, plume by plume; written.
        memory: (n,) numbers of the search, with the knots; written.
        case: Record of `CASE`.
        names: Bytes of the streams' names.
        seed: The search's seed, which counts where the gas has none of its own.
    """
    gas_seed = seed if case.gas_seed < 0 else case.gas_seed
    for w in range(2 * case.n_plumes):
        first = case.first_wander_name + w * case.n_wander_name
        seed_inplace(wanders[w].stream, gas_seed, names[first : first + case.n_wander_name])
        wanders[w].n_knots = 1
        memory[case.first_knot + w * case.n_knots] = next_normal_inplace(wanders[w].stream)


@reference_free_njit()
def _extend_inplace(wander, memory, case, first, n):
    step = math.sqrt(1.0 - case.wander_rho**2)
    while wander.n_knots < n:
        last = memory[first + (wander.n_knots - 1) % case.n_knots]
        knot = case.wander_rho * last + next_normal_inplace(wander.stream) * step
        memory[first + wander.n_knots % case.n_knots] = knot
        wander.n_knots += 1


@reference_free_njit()
def _path_at(memory, case, first, time_s):
    position = time_s / case.knot_s
    i = int(position)
    a = position - i
    scale = math.sqrt((1.0 - a) * (1.0 - a) + a * a + 2.0 * a * (1.0 - a) * case.wander_rho)
    return ((1.0 - a) * memory[first + i % case.n_knots] + a * memory[first + (i + 1) % case.n_knots]) / scale


@reference_free_njit()
def meandering_ppm(plume, i_plume, wanders, memory, case, tick, x_m, y_m, z_m):
    """Return the mixing ratio of a meandering plume [ppm by volume]; see `gaussian_plume.MeanderingPlume`.

    Args:
        plume: Record of `PLUME`: the mean plume.
        i_plume: Which of the case's plumes it is.
        wanders: (2 n_plumes or more,) records of `WANDER`; paths are drawn on to the time.
        memory: (n,) numbers of the search, with the knots; written.
        case: Record of `CASE`.
        tick: The tick that ends.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    time_s = (case.warm_up_steps + tick // case.gas_ticks_per_step * case.gas_steps_per_tick) * case.gas_step_s
    sideways, upward = 2 * i_plume, 2 * i_plume + 1
    first_y, first_z = case.first_knot + sideways * case.n_knots, case.first_knot + upward * case.n_knots
    n = int(time_s / case.knot_s) + 2
    _extend_inplace(wanders[sideways], memory, case, first_y, n)
    _extend_inplace(wanders[upward], memory, case, first_z, n)
    along_m, across_m = distances_along_and_across(plume, x_m, y_m)
    left_s = time_s - max(along_m, 0.0) / plume.speed_m_s
    if not along_m > 0.0 or left_s < 0.0:
        return 0.0
    sigma_y_m, sigma_z_m = spreads_at(plume, along_m)
    f, wander = case.instantaneous_frac, math.sqrt(1.0 - case.instantaneous_frac**2)
    aside_m = wander * sigma_y_m * _path_at(memory, case, first_y, left_s)
    rise_m = wander * sigma_z_m * _path_at(memory, case, first_z, left_s)
    return plume_ppm(plume, along_m, across_m - aside_m, z_m, rise_m, f * sigma_y_m, f * sigma_z_m)
