"""Filaments in eddies, as runs have them, compared with masts and lasers near known leaks.

Each release is simulated in pieces of ten minutes, each with some minutes before it, in the wind of each minute, the
same over the whole field; eddies have the measured intensity, and half the instruments' height as their length.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Cell, Environment, Grid, WindFrames
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_validation.agreement import factor_of_two_share
from gslcosim_validation.gas_models import build_gas_scenario
from gslcosim_validation.laser_data import collect_laser_rows, find_daily_background, predict_plumes
from gslcosim_validation.mast_data import (
    find_hourly_background,
    find_source_m,
    methane_m3_per_kg,
    predict_releases,
    wind_record,
)
from gslcosim_validation.readers.laser_paths import LaserPaths
from gslcosim_validation.readers.mast_network import MastNetwork
from gslcosim_validation.release_pairs import LEAST_ROWS, ReleasePairs, pair_series
from gslcosim_validation.results import Effort, Figure, Findings, Progress, plain_estimate

Floats = NDArray[np.float64]

LEAST_PPM = 0.1
"""Least mean above background that counts, on either side, as where puffs stand beside masts."""
MOST_KG_S = 60.0 / 3600.0
"""Stronger leaks are jets, and beyond what Stanford's sensors read (the set's description)."""
STEP_S = 2.0
FILAMENTS_PER_S = 2.0
# That of a source of puffs and plumes in the cases beside.
SIGMA_M = 0.5
PIECE_S, WARM_UP_S = 600.0, 180.0
_CELL_M, _MARGIN_M, _HEIGHT_M = 4.0, 16.0, 16.0
# Of the 80 points of a beam.
_EACH_POINT = 2
MOST_INTENSITY = 2.0
_QUICK_RELEASES = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Release:
    """A release as its instruments saw it.

    Attributes:
        name: In the set.
        sources: Place [m] and flow of pure gas [m3/s] of each.
        points_m: (k, p, 3) sample points of the k instruments, over which a reading is the mean, world frame [m].
        wind_m_s: (n, 2) toward x and y in each of n periods.
        intensity_frac: Fluctuation of the wind over its mean speed.
        above_ppm: (n, k) readings above background, nan where there is none.
    """

    name: str
    sources: Sequence[tuple[Vec3, float]]
    points_m: Floats
    wind_m_s: Floats
    intensity_frac: float
    above_ppm: Floats

    @property
    def length_m(self) -> float:
        """Integral length of its eddies: half of the height at which gas is read (docs/gas.md)."""
        return 0.5 * float(np.median(self.points_m[..., 2]))


def simulate_release(release: Release, *, period_s: float, seed: int) -> Floats:
    """Return the (n, k) mixing ratios [ppm] that filaments add at the instruments, means of each period."""
    n_rows = max(1, round(PIECE_S / period_s))
    n_before = max(1, round(WARM_UP_S / period_s))
    rows = np.arange(len(release.wind_m_s))
    pieces = [rows[first : first + n_rows] for first in rows[::n_rows]]
    # Before the first row the wind is that of the first row.
    return np.concatenate(
        [
            _simulate_piece(
                release,
                np.maximum(np.arange(piece[0] - n_before, piece[-1] + 1), 0),
                n_before,
                period_s=period_s,
                seed=seed + i,
            )
            for i, piece in enumerate(pieces)
        ]
    )


def _simulate_piece(release: Release, rows: NDArray[np.int64], n_before: int, *, period_s: float, seed: int) -> Floats:
    environment = _build_field(release, release.wind_m_s[rows], period_s)
    filament_m3 = (2.0 * np.pi) ** 1.5 * SIGMA_M**3
    gas = {
        "model": "filament",
        "gas": "methane",
        "sources": [
            {
                "position_m": place_m,
                "filaments_per_s": FILAMENTS_PER_S,
                "sigma_m": SIGMA_M,
                "ppm": 1e6 * flow_m3_s / (FILAMENTS_PER_S * filament_m3),
            }
            for place_m, flow_m3_s in release.sources
        ],
        "step_s": STEP_S,
        "turbulence": {
            "kind": "given",
            "intensity_frac": release.intensity_frac,
            "length_m": release.length_m,
            # Means of a period are compared, and hundreds of filaments are in each.
            "inner_intensity": 0.0,
        },
        "wall_images": True,
        "buoyancy": "none",
    }
    field = build_gas_field(build_gas_scenario(gas, name="field", seed=seed), environment)
    n_steps = max(1, round(period_s / STEP_S))
    points_m = release.points_m.reshape(-1, 3)
    field.advance(n_before * n_steps)
    means = np.zeros((len(rows) - n_before, len(points_m)))
    for mean in means:
        for _ in range(n_steps):
            field.advance(1)
            mean += field.mixing_ratio_ppm_at(points_m)[:, 0] / n_steps
    return means.reshape(len(means), *release.points_m.shape[:2]).mean(axis=2)


# Flat ground with open sides and top; the wind of each row is the same everywhere.
def _build_field(release: Release, wind_m_s: Floats, period_s: float) -> Environment:
    places_m = np.array([place_m for place_m, _ in release.sources])
    all_m = np.concatenate([release.points_m.reshape(-1, 3), places_m])[:, :2]
    low_m = _CELL_M * np.floor((all_m.min(axis=0) - _MARGIN_M) / _CELL_M)
    nx, ny = np.ceil((all_m.max(axis=0) + _MARGIN_M - low_m) / _CELL_M).astype(int).tolist()
    shape = (nx, ny, round(_HEIGHT_M / _CELL_M))
    occupancy = np.full(shape, Cell.OUTLET, np.uint8)
    occupancy[1:-1, 1:-1, :-1] = Cell.FREE
    velocity_m_s = np.zeros((len(wind_m_s), *shape, 3), np.float32)
    velocity_m_s[..., :2] = wind_m_s[:, None, None, None, :]
    return Environment(
        name="field",
        grid=Grid(origin_m=(float(low_m[0]), float(low_m[1]), 0.0), cell_m=_CELL_M, shape=shape),
        occupancy=occupancy,
        wind=WindFrames(velocity_m_s=velocity_m_s, period_s=period_s, is_looping=False),
        boxes=(),
        openings=(),
        content_hash="field",
    )


def measure(content: MastNetwork | LaserPaths, effort: Effort, progress: Progress) -> Findings:
    """Return how well filaments agree with each release of a set."""
    if isinstance(content, MastNetwork):
        releases, period_s = list(list_mast_releases(content)), content.period_s
    else:
        releases, period_s = list(list_laser_releases(content)), 60.0
    if effort == "quick":
        releases = releases[:_QUICK_RELEASES]
    pairs: list[ReleasePairs] = []
    for i, release in enumerate(releases):
        progress(f"release {release.name}", i / len(releases))
        ours = simulate_release(release, period_s=period_s, seed=1000 * (i + 1))
        label = np.full(len(ours), release.name)
        pairs += pair_series("open_ground", ours, release.above_ppm, label, floor=LEAST_PPM)
    figures: list[Figure] = []
    means = [each for each in pairs if each["quantity"] == "mean"]
    if means:
        p, o = (np.array([x for each in means for x in each[side]]) for side in ("modelled", "measured"))
        figures.append(Figure("fac2", plain_estimate(float(factor_of_two_share(p, o)), len(p)), n_releases=len(means)))
        figures.append(Figure("bias", plain_estimate(float(np.exp(np.log(p / o).mean())), len(p))))
    return Findings(figures=figures, pairs=pairs)


def list_mast_releases(network: MastNetwork) -> Iterator[Release]:
    """Yield the releases of a network whose places are known, without jets."""
    wind, volume = wind_record(network), methane_m3_per_kg(network)
    above = network.readings_ppm - find_hourly_background(network, predict_releases(network))
    speed = np.linalg.norm(wind.mean_world_m_s, axis=1)
    for each in network.releases:
        rows = (network.clock_s >= each.start_s) & (network.clock_s < each.end_s)
        source_m = find_source_m(network, each)
        if source_m is None or each.rate_kg_s > MOST_KG_S or rows.sum() < LEAST_ROWS:
            continue
        heights_m = [float(source_m[2])]
        if each.place is None and not network.has_several_places:
            # Of stacks of which one was in use, each has its share of what is expected.
            heights_m = [place_m[2] for place_m in network.places_m.values()]
        flow_m3_s = each.rate_kg_s * volume / len(heights_m)
        x_m, y_m, _ = source_m.tolist()
        yield Release(
            name=str(each.number),
            sources=[((x_m, y_m, height_m), flow_m3_s) for height_m in heights_m],
            points_m=network.masts_m[:, None, :],
            wind_m_s=wind.mean_world_m_s[rows],
            intensity_frac=_intensity(wind.across_std_m_s[rows], wind.up_std_m_s[rows], speed[rows]),
            above_ppm=above[rows],
        )


def list_laser_releases(paths: LaserPaths) -> Iterator[Release]:
    """Yield the releases that lasers saw; minutes without wind or beams are passed over."""
    laser = collect_laser_rows(paths)
    above = laser.readings_ppm - find_daily_background(laser, predict_plumes(paths, laser))
    speed = np.linalg.norm(laser.wind.mean_world_m_s, axis=1)
    for i, minutes in enumerate(paths.sources):
        for name in dict.fromkeys(laser.release[laser.source == i].tolist()):
            rows = (laser.source == i) & (laser.release == name)
            if rows.sum() < LEAST_ROWS:
                continue
            volume = float(laser.gas_m3_per_kg[rows].mean())
            yield Release(
                name=name,
                sources=[(each.position_m, each.rate_kg_s * volume) for each in minutes.open_sources],
                points_m=laser.sensors.points_m[:, ::_EACH_POINT],
                wind_m_s=laser.wind.mean_world_m_s[rows],
                intensity_frac=_intensity(laser.wind.across_std_m_s[rows], laser.wind.up_std_m_s[rows], speed[rows]),
                above_ppm=above[rows],
            )


# Between that across the wind and that upward, as gas.md has it; of the mean speed, in calm air no more than gas takes.
def _intensity(across_m_s: Floats, up_m_s: Floats, speed_m_s: Floats) -> float:
    return min(float(0.5 * (across_m_s + up_m_s).mean() / speed_m_s.mean()), MOST_INTENSITY)
