"""Laws of turbulent dispersion that filaments in turbulent air keep: Taylor, Richardson, well mixed."""

import dataclasses

import numpy as np
import pytest
from built_gas import build_plume, build_source
from built_rooms import build_air

from gslcosim.environment.model import Cell
from gslcosim_services.fields.filament.release import ScheduledRelease
from gslcosim_services.fields.filament.turbulent_step import INNER_G
from gslcosim_services.fields.turbulence.air import (
    KEpsilonFields,
    build_turbulent_air,
    k_epsilon_from_intensity,
    lagrangian_time_s,
)
from gslcosim_validation.plume_statistics import (
    score_absolute_dispersion,
    score_richardson_constant,
)

VELOCITY_STD_M_S = 0.2
LENGTH_M = 1.0
K, EPSILON = k_epsilon_from_intensity(VELOCITY_STD_M_S, LENGTH_M)
TIME_SCALE_S = lagrangian_time_s(K, EPSILON)


def make_plume(room, air, *, seed, step_s, place_m, sigma_m=0.05):
    silent = build_source(place_m, release=ScheduledRelease(schedule=((0.0, 0.0),)), sigma_m=sigma_m, amount_mol=1e-6)
    return build_plume(room, (silent,), step_s=step_s, growth_m2_s=0.0, diffusivity_m2_s=0.0, seed=seed, air=air)


def make_even_air(room, *, k=K, epsilon=EPSILON):
    """Turbulence that is the same everywhere, the ground too."""
    strength = KEpsilonFields(k_m2_s2=np.full(room.grid.shape, k), epsilon_m2_s3=np.full(room.grid.shape, epsilon))
    air = build_turbulent_air(room, strength, is_open=True)
    air.nodes.nodes[...] = air.nodes.nodes[0, 0, -1]
    return air


@pytest.fixture(scope="module")
def dispersion():
    """Ways of pairs of tracers [m], (time, pair, tracer, axis), and times [s], in six histories of even turbulence."""
    room = build_air((100, 100, 100), cell_m=0.5)
    air = make_even_air(room)
    n_pairs, n_steps, step_s = 150, 100, TIME_SCALE_S / 25.0
    ways = []
    for seed in range(8):
        places_m = np.repeat(15.0 + 20.0 * np.random.default_rng(seed).random((n_pairs, 3)), 2, axis=0)
        plume = make_plume(room, air, seed=seed, step_s=step_s, place_m=(25.0, 25.0, 25.0))
        plume.add_filaments(places_m)
        history = []
        for _ in range(n_steps):
            plume.advance(1)
            history.append((plume.filaments.position_world_m - places_m).reshape(n_pairs, 2, 3))
        ways.append(history)
    return np.concatenate(ways, axis=1), step_s * np.arange(1, n_steps + 1)


@pytest.mark.slow
def test_absolute_dispersion_is_taylors(dispersion):
    """Within 20 % from a fifth to four Lagrangian time scales, Taylor 1922."""
    ways_m, time_s = dispersion
    seen = slice(4, None, 5)
    displacement_m = np.moveaxis(ways_m, 0, -1).reshape(-1, len(time_s))[:, seen]
    found = score_absolute_dispersion(
        displacement_m, time_s[seen], velocity_std_m_s=VELOCITY_STD_M_S, time_scale_s=TIME_SCALE_S
    )
    assert [each.value for each in found] == pytest.approx([1.0] * len(found), abs=0.2)


@pytest.mark.slow
def test_pairs_part_as_richardson_says(dispersion):
    """g = 0.5 within 20 %, from a third to two time scales, Ott and Mann 2000."""
    ways_m, time_s = dispersion
    seen = slice(8, 50, 4)
    separation2_m2 = ((ways_m[:, :, 0] - ways_m[:, :, 1]) ** 2).sum(axis=-1).T[:, seen]
    found = score_richardson_constant(separation2_m2, time_s[seen], dissipation_m2_s3=EPSILON)
    assert [each.value for each in found] == pytest.approx([0.5] * len(found), rel=0.2)


def test_sizes_grow_as_the_cube_of_time():
    """sigma^(2/3) = sigma0^(2/3) + (g_i eps / 6)^(1/3) t, Richardson 1926."""
    room = build_air((40, 40, 40), cell_m=0.5)
    air = make_even_air(room)
    plume = make_plume(room, air, seed=1, step_s=0.05, place_m=(10.0, 10.0, 10.0), sigma_m=0.01)
    plume.add_filaments(np.array([[10.0, 10.0, 10.0]]))
    plume.advance(60)
    expected = 0.01 ** (2 / 3) + (INNER_G * EPSILON / 6.0) ** (1 / 3) * 3.0
    assert plume.filaments.sigma_m[0] ** (2 / 3) == pytest.approx(expected, rel=1e-3)


@pytest.fixture(scope="module")
def uneven_air():
    """A closed box whose turbulence is sixteen times as strong above as below, with an obstacle."""
    room = build_air((24, 20, 16))
    occupancy = np.array(room.occupancy)
    occupancy[10:14, 8:12, :6] = Cell.SOLID
    room = dataclasses.replace(room, occupancy=occupancy)
    height = np.broadcast_to((np.arange(16) + 0.5) / 16, room.grid.shape)
    k = 0.01 * (1.0 + 15.0 * height)
    return room, build_turbulent_air(room, KEpsilonFields(k_m2_s2=k, epsilon_m2_s3=0.43 * k**1.5 / 0.8))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_full_room_stays_flat(uneven_air, seed):
    """Thomson 1987: 5 % in eight layers and in boxes of a metre, in one history, where turbulence is uneven."""
    room, air = uneven_air
    plume = make_plume(room, air, seed=seed, step_s=0.05, place_m=(1.0, 1.0, 3.0))
    places_m = np.random.default_rng(seed).random((24_000, 3)) * (6.0, 5.0, 4.0)
    cells = room.grid.cell_of(places_m)
    places_m = places_m[room.occupancy[tuple(cells.T)] == Cell.FREE]
    plume.add_filaments(places_m)
    plume.advance(200)
    found_m = plume.filaments.position_world_m
    assert len(found_m) == len(places_m)
    free = (room.occupancy == Cell.FREE).astype(float)
    counts, _ = np.histogramdd(found_m, bins=(24, 20, 16), range=((0, 6), (0, 5), (0, 4)))
    layers = counts.reshape(24, 20, 8, 2).sum(axis=(0, 1, 3)) / free.reshape(24, 20, 8, 2).sum(axis=(0, 1, 3))
    assert np.abs(layers / layers.mean() - 1.0).max() < 0.05
    boxes = (6, 4, 5, 4, 4, 4)
    number, volume = (each.reshape(boxes).sum(axis=(1, 3, 5)) for each in (counts, free))
    full = (number / volume * volume.mean())[volume == volume.max()]
    # Counts of independent tracers have the variance of chance, their mean; what is above it is uneven mixing.
    assert max(full.var() - full.mean(), 0.0) ** 0.5 / full.mean() < 0.05
