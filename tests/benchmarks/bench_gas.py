"""How fast the gas is: run with `python tests/benchmarks/bench_gas.py`; best of several runs, one core."""

import sys
import time

import numpy as np

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell, Environment, WindFrames
from gslcosim.fields.concentration import Walls, mixing_ratio_ppm_at, mixing_ratio_ppm_on_grid
from gslcosim.fields.filament_index import FilamentIndex
from gslcosim.fields.filaments import FilamentPlume, Filaments, GasSource, amount_of_filament_mol
from gslcosim.fields.release import ConstantRelease

ROOM_M = (15.0, 15.0, 8.0)
CELL_M = 0.2
N_READINGS = 200


def swirling_room(size_m=ROOM_M):
    """A closed room with a smooth rotating wind of some decimetres a second and a rack in it."""
    shape = tuple(round(side_m / CELL_M) for side_m in size_m)
    cells = np.zeros(shape, np.uint8)
    cells[35:40, 20:45, :15] = Cell.SOLID
    centres = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=CELL_M, shape=shape).centres_m()
    a, b, c = (np.pi * centres[..., i] / size_m[i] for i in range(3))
    wind = 0.4 * np.stack(
        [
            np.sin(a) ** 2 * np.sin(2 * b) * (1 + 0.5 * np.cos(c)),
            -np.sin(2 * a) * np.sin(b) ** 2 * (1 + 0.5 * np.cos(c)),
            0.3 * np.sin(2 * a) * np.cos(3 * b) * np.sin(c),
        ],
        -1,
    )
    wind[cells == Cell.SOLID] = 0.0
    return Environment(
        name="room",
        grid=Grid(origin_m=(0.0, 0.0, 0.0), cell_m=CELL_M, shape=shape),
        occupancy=cells,
        wind=WindFrames(velocity_m_s=wind[None].astype(np.float32)),
        boxes=(),
        openings=(),
        content_hash="room",
    )


def plume_of(n, environment, age_s=150.0):
    """A plume of n filaments of up to this age, at steps of 0.1 s."""
    source = GasSource(
        position_world_m=(5.0, 1.0, 2.0),
        release=ConstantRelease(filaments_per_s=n / age_s),
        sigma_m=0.1,
        amount_mol=amount_of_filament_mol(10.0, 0.1),
    )
    plume = FilamentPlume(environment, (source,), step_s=0.1, growth_m2_s=0.001, diffusivity_m2_s=0.002, seed=1)
    plume.advance(round(age_s / 0.1))
    return plume


def best_s(action, n_runs=15):
    """Shortest wall time of some runs [s]."""
    durations_s = []
    for _ in range(n_runs):
        started_s = time.perf_counter()
        action()
        durations_s.append(time.perf_counter() - started_s)
    return min(durations_s)


def report(text):
    """Write one line of the result."""
    sys.stdout.write(f"{text}\n")


def bench_steps(environment):
    """Time of a step, for plumes of different size."""
    for n in (1_500, 15_000, 60_000):
        plume = plume_of(n, environment)
        step_s = best_s(lambda plume=plume: plume.advance(1))
        report(f"step, {n:>6} filaments: {step_s * 1e6:8.1f} us, {step_s / plume.n * 1e9:5.1f} ns per filament")
    started_s = time.perf_counter()
    plume_of(5_000, environment, age_s=500.0)
    report(f"500 s of a plume of 10 filaments a second: {time.perf_counter() - started_s:.2f} s")


def spread_filaments(n, size_m):
    """Filaments of all ages up to 150 s, evenly spread over a room."""
    rng = np.random.default_rng(2)
    return Filaments(
        position_world_m=rng.uniform((0.0, 0.0, 0.0), size_m, (n, 3)),
        sigma_m=np.sqrt(0.01 + 0.001 * rng.uniform(0.0, 150.0, n)),
        source_index=np.zeros(n, np.int32),
        amount_mol=np.array([amount_of_filament_mol(10.0, 0.1)]),
        gas_index=np.zeros(1, np.int32),
    )


def bench_readings(environment, filaments, points):
    """Time of a reading with and without the index; returns the former [s]."""
    walls = Walls.of(environment)
    index = FilamentIndex(min_m=environment.grid.origin_m, max_m=environment.grid.max_m)
    build_s = best_s(lambda: index.build(filaments))
    scan_s = best_s(lambda: mixing_ratio_ppm_at(points, filaments, walls=walls), 5) / len(points)
    indexed_s = best_s(lambda: index.mixing_ratio_ppm_at(points, walls=walls)) / len(points)
    gaps_m = np.linalg.norm(filaments.position_world_m[:, None] - points[:20], axis=-1)
    in_reach = (gaps_m < 5 * filaments.sigma_m[:, None]).sum() / 20
    report(
        f"  {len(filaments.sigma_m):>6} filaments: plain scan {scan_s * 1e6:6.1f} us, "
        f"with index {indexed_s * 1e6:5.2f} us ({scan_s / indexed_s:4.1f} times less); "
        f"index built in {build_s * 1e6:3.0f} us; {in_reach:.0f} in reach"
    )
    return indexed_s


def bench_pictures(environment):
    """Time of a slice and of a whole grid at 1,500 filaments."""
    filaments = plume_of(1_500, environment).filaments
    grid = {"first_point_m": (0.125, 0.125, 2.0), "spacing_m": 0.25}
    slice_s = best_s(lambda: mixing_ratio_ppm_on_grid(filaments, shape=(60, 60, 1), **grid))
    volume_s = best_s(lambda: mixing_ratio_ppm_on_grid(filaments, shape=(60, 60, 32), **grid))
    report(f"1500 filaments: slice of 60x60 {slice_s * 1e6:.0f} us, grid of 60x60x32 {volume_s * 1e3:.2f} ms")


def main():
    """Print all figures."""
    environment = swirling_room()
    points = np.random.default_rng(1).uniform((1.0, 1.0, 1.0), (14.0, 14.0, 3.0), (N_READINGS, 3))
    plume_of(50, environment, age_s=1.0)
    bench_steps(environment)
    report("reading, plumes in one room (more filaments are denser gas):")
    for n in (3_000, 60_000):
        bench_readings(environment, plume_of(n, environment).filaments, points)
    report("reading, filaments evenly spread (more filaments fill a larger hall):")
    hall_m = (67.2, 67.2, 8.0)
    few_s = bench_readings(environment, spread_filaments(3_000, ROOM_M), points)
    many_s = bench_readings(swirling_room(hall_m), spread_filaments(60_000, hall_m), points)
    report(f"  a reading among 60000 takes {many_s / few_s:.2f} times that among 3000")
    bench_pictures(environment)


if __name__ == "__main__":
    main()
