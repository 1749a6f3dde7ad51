"""How fast the gas is: `make bench-gas`; best of several runs, on one core, in the time that the core spends on it.

Beside its target stands each figure in units of what the same machine needs for a plain loop over all filaments in the
same run, so that figures of different machines can be compared.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "kit"))

from built_messages import build_body
from built_rooms import build_air

from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses
from gslcosim.contract.participant import Episode
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Cell, Grid
from gslcosim.environment.store import load_environment
from gslcosim.scenario import load_scenario
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.filament.plume import (
    NEUTRAL,
    FilamentPlume,
    Filaments,
    GasSource,
    filament_amount_mol,
    terminal_velocity_buoyancy,
)
from gslcosim_services.fields.filament.release import ConstantRelease
from gslcosim_services.fields.mixing_ratio import Walls, mixing_ratio_ppm_at, mixing_ratio_ppm_on_grid
from gslcosim_services.fields.models.filament_gas import build_gas_model
from gslcosim_services.fields.spatial_index import FilamentIndex

STEP_TARGET_NS = 25.0
EDDY_STEP_TARGET_NS = 150.0
READING_TARGET_US = 5.0
READING_TARGET_RATIO = 2.0
PLUME_TARGET_S = 3.0
TAPE_TARGET = 1000.0
# GADEN 3 in C++ on a core of the kind the targets were set on.
GADEN_STEP_NS = 60.0
GADEN_READING_US = 127.0
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
    return build_air(cells, wind[None], cell_m=CELL_M)


def plume_of(n, environment, age_s=150.0, buoyancy=NEUTRAL):
    """A plume of n filaments of up to this age, at steps of 0.1 s."""
    source = GasSource(
        position_world_m=(5.0, 1.0, 2.0),
        release=ConstantRelease(filaments_per_s=n / age_s),
        sigma_m=0.1,
        amount_mol=filament_amount_mol(10.0, 0.1),
        buoyancy=buoyancy,
    )
    plume = FilamentPlume(environment, (source,), step_s=0.1, growth_m2_s=0.001, diffusivity_m2_s=0.002, seed=1)
    plume.advance(round(age_s / 0.1))
    return plume


def best_s(action, n_runs=15):
    """Shortest time of some runs on the core [s]."""
    durations_s = []
    for _ in range(n_runs):
        started_s = time.thread_time()
        action()
        durations_s.append(time.thread_time() - started_s)
    return min(durations_s)


def report(text):
    """Write one line of the result."""
    sys.stdout.write(f"{text}\n")


def report_target(text, value, target, unit, *, is_least=False):
    """Write one figure beside what it should be."""
    is_met = value >= target if is_least else value <= target
    bound = "at least" if is_least else "at most"
    report(f"{text}: {value:.4g} {unit} ({bound} {target:g}: {'met' if is_met else 'MISSED'})")


@numba.njit(cache=True)
def plain_scan(position_m, strength, x, y, z):
    """One Gaussian for each filament, without cut-off, walls or index: the unit of all ratios."""
    total = 0.0
    for f in range(strength.shape[0]):
        dx, dy, dz = position_m[f, 0] - x, position_m[f, 1] - y, position_m[f, 2] - z
        total += strength[f] * np.exp(-20.0 * (dx * dx + dy * dy + dz * dz))
    return total


def scan_ns(n=60_000):
    """Time that a plain scan takes for each filament [ns]."""
    position_m, strength = np.random.default_rng(3).uniform(0.0, 15.0, (n, 3)), np.ones(n)
    plain_scan(position_m, strength, 1.0, 2.0, 3.0)
    return best_s(lambda: plain_scan(position_m, strength, 1.0, 2.0, 3.0), 30) / n * 1e9


def bench_plumes(environment):
    """Time that a step takes for each filament, best of many."""
    neutral, heavy = NEUTRAL, terminal_velocity_buoyancy(1.6, 1e-7)
    for name, n, buoyancy in (
        ("few", 1_500, neutral),
        ("many", 15_000, neutral),
        ("very many", 60_000, neutral),
        ("heavy gas", 15_000, heavy),
    ):
        plume = plume_of(n, environment, buoyancy=buoyancy)
        step_ns = best_s(lambda plume=plume: plume.advance(1), 100) / plume.n * 1e9
        report(f"  {name:>9}, {n:>6} filaments: {step_ns:5.1f} ns per filament and step")


def bench_births(environment):
    """Time of a step of an almost empty room with one birth: what a step costs before it moves anything."""
    plume = plume_of(10, environment, age_s=1.0)

    def begin():
        plume.reset(1)
        plume.advance(10)

    report(f"  one birth a step, hardly anything to move: {best_s(begin, 200) / 10 * 1e6:.1f} us a step")


def bench_steps(environment):
    """Time of a step among many filaments, beside its target."""
    bench_plumes(environment)
    bench_births(environment)
    plume = plume_of(60_000, environment)
    # The machine may be slower at one time than at another: both times are taken in turns.
    step_ns, unit_ns = 1e9, 1e9
    for _ in range(5):
        step_ns = min(step_ns, best_s(lambda: plume.advance(1), 5) / plume.n * 1e9)
        unit_ns = min(unit_ns, scan_ns())
    report_target("  a filament's step among 60000", step_ns, STEP_TARGET_NS, "ns")
    report(
        f"  that is {step_ns / unit_ns:.2f} filaments of a plain scan ({unit_ns:.1f} ns each); "
        f"GADEN 3: {GADEN_STEP_NS:g} ns on its own machine"
    )


def bench_eddies():
    """Time that a step takes for each filament of the quickstart's plume, with and without eddies, in turns."""
    plumes = {}
    for name, changes in (
        ("no memory", ["gas.turbulence.kind=none"]),
        ("given", ["gas.turbulence.kind=given"]),
        ("wind", ["gas.turbulence.kind=wind"]),
    ):
        overrides = ["gas.sources[0].filaments_per_s=60", *changes]
        scenario = load_scenario("warehouse_empty", overrides=overrides).scenario
        plumes[name] = build_gas_model(scenario, load_environment(prepare_environment(scenario))).plume
        plumes[name].advance(1500)
    spent_ns = dict.fromkeys(plumes, 1e9)
    for _ in range(10):
        for name, plume in plumes.items():
            spent_ns[name] = min(spent_ns[name], best_s(lambda plume=plume: plume.advance(40), 2) / 40 / plume.n * 1e9)
    for name in ("given", "wind"):
        report_target(
            f"  a filament's step with eddies ({name}), {spent_ns[name] / spent_ns['no memory']:.1f} times without",
            spent_ns[name], EDDY_STEP_TARGET_NS, "ns",
        )  # fmt: skip


def bench_warehouse():
    """Time of 500 s of the quickstart's plume."""
    scenario = load_scenario("warehouse_empty").scenario
    environment = load_environment(prepare_environment(scenario))
    plume = build_gas_model(scenario, environment).plume

    def release():
        plume.reset(scenario.seed)
        plume.advance(round(500.0 / scenario.gas.step_s))

    report_target(
        f"500 s of the warehouse's plume ({10 * 500} filaments released)", best_s(release, 3), PLUME_TARGET_S, "s"
    )
    return environment


def bench_tape(environment):
    """Speed of a run's fields from tape, in simulated time per time, with a nose and an anemometer."""
    scenario = load_scenario("warehouse_empty", overrides=["gas.tape=true"]).scenario
    with tempfile.TemporaryDirectory() as cache:
        os.environ["GSLCOSIM_CACHE"] = cache
        core = FieldsCore(scenario, environment)
        core.reset(Episode(seed=1))
        n_ticks = round(scenario.referee.stop.time_limit_s * 1e9 / scenario.tick_ns)
        inboxes = [{keys.BODIES: BodyPoses(tick=tick, bodies=(_body(tick),))} for tick in range(n_ticks)]
        slices = scenario.recording.gas_every_s
        spent_s = np.array([_spent_on_blocks(core, inboxes) for _ in range(5)])
        size = sum(path.stat().st_size for path in Path(cache).rglob("*.npy")) / 1e6
        factor = n_ticks * scenario.tick_ns / 1e9 / spent_s.min(axis=0).sum()
        report_target(
            f"gas from tape, readings and a slice every {slices:g} s ({size:.0f} MB for {n_ticks} ticks)",
            factor, TAPE_TARGET, "times real time", is_least=True,
        )  # fmt: skip
        gas = core.gas
        core.reset(Episode(seed=1))
        places_m = np.array([(6.0, 1.5, 2.0)])
        started_s = time.thread_time()
        for _ in range(n_ticks):
            gas.mixing_ratio_ppm_at(places_m)
            gas.advance(1)
        report(f"  without messages and slices: {n_ticks * 0.1 / (time.thread_time() - started_s):.0f} times real time")


# Short blocks of a run, so that each meets a quiet moment in one of the runs.
def _spent_on_blocks(core, inboxes, n_ticks=100):
    core.reset(Episode(seed=1))
    spent_s = []
    for first in range(0, len(inboxes), n_ticks):
        started_s = time.thread_time()
        for tick in range(first, min(first + n_ticks, len(inboxes))):
            core.step(tick, inboxes[tick])
        spent_s.append(time.thread_time() - started_s)
    return spent_s


def _body(tick):
    # On its way through the room, as a vehicle is.
    along = (tick % 1000) / 1000.0
    return build_body("beetle", (2.0 + 11.0 * along, 1.0 + 8.0 * along, 2.0))


def spread_filaments(n, size_m):
    """Filaments of all ages up to 150 s, evenly spread over a room."""
    rng = np.random.default_rng(2)
    return Filaments(
        position_world_m=rng.uniform((0.0, 0.0, 0.0), size_m, (n, 3)),
        sigma_m=np.sqrt(0.01 + 0.001 * rng.uniform(0.0, 150.0, n)),
        source_index=np.zeros(n, np.int32),
        amount_mol=np.array([filament_amount_mol(10.0, 0.1)]),
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
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    environment = swirling_room()
    points = np.random.default_rng(1).uniform((1.0, 1.0, 1.0), (14.0, 14.0, 3.0), (N_READINGS, 3))
    plume_of(50, environment, age_s=1.0)
    report("step with trilinear wind, eddies and walls:")
    bench_steps(environment)
    bench_eddies()
    report("reading, plumes in one room (more filaments are denser gas):")
    for n in (3_000, 60_000):
        bench_readings(environment, plume_of(n, environment).filaments, points)
    report("reading, filaments evenly spread (more filaments fill a larger hall):")
    hall_m = (67.2, 67.2, 8.0)
    few_s = bench_readings(environment, spread_filaments(3_000, ROOM_M), points)
    many_s = bench_readings(swirling_room(hall_m), spread_filaments(60_000, hall_m), points)
    report_target("  a reading among 60000", many_s * 1e6, READING_TARGET_US, "us")
    report_target("  in readings among 3000", many_s / few_s, READING_TARGET_RATIO, "times")
    unit_us = scan_ns() * 60.0
    report(
        f"  that is {unit_us / (many_s * 1e6):.0f} times less than a plain scan of 60000 ({unit_us:.0f} us); "
        f"GADEN 3: {GADEN_READING_US:g} us on its own machine"
    )
    bench_pictures(environment)
    bench_tape(bench_warehouse())


if __name__ == "__main__":
    main()
