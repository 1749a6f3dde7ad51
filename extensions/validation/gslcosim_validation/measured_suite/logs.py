"""Measured logs as estimators receive them, and the true releases for the scorer alone."""

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.gases import GASES, air_density_mol_m3
from gslcosim_search.fixed_sensors.plume_response import SensorPaths
from gslcosim_validation.mast_data import find_source_m, methane_m3_per_kg
from gslcosim_validation.readers.folder import MeasuredData, MeasuredSet
from gslcosim_validation.readers.laser_paths import LaserPaths
from gslcosim_validation.readers.mast_network import MastNetwork
from gslcosim_validation.readers.room_sensors import RoomExperiment, RoomSensors

Floats = NDArray[np.float64]

_DAY_S = 86_400.0

FORMATS = ("mast_network", "laser_paths", "room_sensors")
"""Formats whose logs make trials."""

PLANE_RADIUS_M = 20.0
"""Largest error of a correct position where masts have no candidate positions [m]."""

LASER_RADIUS_M = 3.0
"""Largest error of a correct position where lasers see the source [m]."""

ROOM_RADIUS_M = 1.5
"""Largest error of a correct position in a room, where sensors stand 1.8 m apart [m]."""

ROOM_PERIOD_S = 1.0
"""Readings of a room are means over this [s]."""

LASER_PERIOD_S = 60.0
"""Rows of lasers are minutes [s]."""


@dataclass(frozen=True, kw_only=True)
class LogSite:
    """Facts that an estimator receives before the log begins; none of them comes from the releases.

    Attributes:
        sensors: Points or paths of the k sensors.
        names: (k,) of the sensors.
        places_m: Candidate places by name, (3,) each [m]; empty: the source may be anywhere.
        source_height_m: Height of the source where there are no candidate places; nan where it is not known.
        period_s: From one row to the next.
        finds_events: Whether the log has times without a release, so that events are to be found; otherwise a source is
            open in each row, and `LogRow.source` groups the rows of each.
        wind_height_m: Where the wind is measured; nan where it is not known.
    """

    sensors: SensorPaths
    names: tuple[str, ...]
    period_s: float
    places_m: Mapping[str, Floats] = field(default_factory=dict[str, Floats])
    source_height_m: float = math.nan
    finds_events: bool = False
    wind_height_m: float = math.nan

    @property
    def has_points(self) -> bool:
        """True if the sensors are point sensors."""
        return self.sensors.points_m.shape[1] == 1

    @property
    def sensors_m(self) -> Floats:
        """(k, 3) places of point sensors, and the middles of paths [m]."""
        return self.sensors.points_m.mean(axis=1)

    def snap(self, x_m: float, y_m: float) -> tuple[str | None, tuple[float, float]]:
        """Return the candidate place nearest to a point, and where it is [m]; None and the point without candidates."""
        if not self.places_m:
            return None, (float(x_m), float(y_m))
        name = min(self.places_m, key=lambda name: math.dist(self.places_m[name][:2], (x_m, y_m)))
        return name, (float(self.places_m[name][0]), float(self.places_m[name][1]))

    def find_likeliest_m(self, points_m: Floats, weights: Floats) -> tuple[float, float]:
        """Return the candidate place with most of the weight of (n, 2) points nearest to it [m]."""
        places_m = np.array([place_m[:2] for place_m in self.places_m.values()])
        nearest = np.hypot(*(points_m[:, None] - places_m[None]).transpose(2, 0, 1)).argmin(axis=1)
        x_m, y_m = places_m[int(np.bincount(nearest, weights, len(places_m)).argmax())].tolist()
        return x_m, y_m


@dataclass(frozen=True)
class LogRow:
    """One row of a log; nan is a value that was not measured.

    `start_s` of its period [s since 1970]; `readings_ppm` (k,); `wind_world_m_s` (2,) toward x and y; `wind_std_m_s`
    (3,) deviation of the components within the period; `gas_m3_per_kg` volume of a kilogram of the gas in that air;
    `source` number of the source that is open, the same for rows that belong together; -1 if unnamed.
    """

    start_s: float
    readings_ppm: Floats
    wind_world_m_s: Floats
    wind_std_m_s: Floats
    gas_m3_per_kg: float
    source: int


@dataclass(frozen=True)
class MeasuredLog:
    """A whole log: `start_s` (n,), `readings_ppm` (n, k), `wind_world_m_s` (n, 2) and so on, as `LogRow` has them."""

    start_s: Floats
    readings_ppm: Floats
    wind_world_m_s: Floats
    wind_std_m_s: Floats
    gas_m3_per_kg: Floats
    source: NDArray[np.int64]

    def rows(self) -> Iterator[LogRow]:
        """Yield the rows in the order of time; each has copies, so that no estimator changes those of another."""
        for i in range(len(self.start_s)):
            yield LogRow(
                float(self.start_s[i]),
                self.readings_ppm[i].copy(),
                self.wind_world_m_s[i].copy(),
                self.wind_std_m_s[i].copy(),
                float(self.gas_m3_per_kg[i]),
                int(self.source[i]),
            )


@dataclass(frozen=True, kw_only=True)
class TrueRelease:
    """True source of one release, for the scorer alone.

    `place` the candidate place, None where there is nothing to choose; `position_m` (3,) [m], nan where the log of
    releases has none.
    """

    name: str
    start_s: float
    end_s: float
    place: str | None
    position_m: Floats
    rate_kg_s: float
    source: int = -1


@dataclass(frozen=True, kw_only=True)
class LogCase:
    """A log with its truth.

    `within_m` is the largest error of a correct position where there are no candidate places; `hash` of the files.
    """

    name: str
    site: LogSite
    log: MeasuredLog
    releases: tuple[TrueRelease, ...]
    within_m: float
    hash: str


def load_log_cases(data: MeasuredData) -> tuple[LogCase, ...]:
    """Return the logs of a folder, one of each set of masts or lasers."""
    cases: list[LogCase] = []
    for each in data.sets:
        if each.format == "mast_network":
            cases.append(_case_of_masts(each, data.read(each, MastNetwork)))
        elif each.format == "laser_paths":
            cases.append(_case_of_lasers(each, data.read(each, LaserPaths)))
        elif each.format == "room_sensors":
            cases.append(_case_of_room(each, data.read(each, RoomSensors)))
    if not cases:
        found = ", ".join(f"{each.name} ({each.format})" for each in data.sets) or "no set"
        raise UsageError(
            f"--data: expected a log of a format that makes trials ({', '.join(FORMATS)}), found {found}. "
            f"docs/measured-data.md describes each format.\nFolder: {data.folder}"
        )
    return tuple(cases)


# Candidate places that are all at one position would give the answer away, so estimators do not receive them.
def _case_of_masts(measured: MeasuredSet, network: MastNetwork) -> LogCase:
    n = len(network.clock_s)
    places_m = {name: np.array(place_m) for name, place_m in network.places_m.items()}
    heights_m = [float(place_m[2]) for place_m in places_m.values()]
    site = LogSite(
        sensors=SensorPaths.of_points(network.masts_m),
        names=network.masts,
        places_m=places_m if network.has_several_places else {},
        source_height_m=math.nan if network.has_several_places or not heights_m else heights_m[0],
        period_s=network.period_s,
        finds_events=True,
        wind_height_m=float(np.median(network.masts_m[:, 2])),
    )
    log = MeasuredLog(
        network.clock_s,
        network.readings_ppm,
        network.wind_world_m_s,
        np.full((n, 3), np.nan),
        np.full(n, methane_m3_per_kg(network)),
        np.full(n, -1),
    )
    releases = []
    for release in network.releases:
        source_m = find_source_m(network, release)
        releases.append(
            TrueRelease(
                name=f"release={release.number}",
                start_s=release.start_s,
                end_s=release.end_s,
                place=release.place if network.has_several_places else None,
                position_m=np.full(3, np.nan) if source_m is None else source_m,
                rate_kg_s=release.rate_kg_s,
            )
        )
    return LogCase(
        name=measured.name,
        site=site,
        log=log,
        releases=tuple(releases),
        within_m=PLANE_RADIUS_M,
        hash=_hash_files(measured.folder, ("site.json", "minutes.csv*", "releases.csv")),
    )


# All sources together: where one hides the background of a day, another may not.
def _case_of_lasers(measured: MeasuredSet, paths: LaserPaths) -> LogCase:
    def joined(name: str) -> Floats:
        return np.concatenate([getattr(minutes, name) for minutes in paths.sources])

    clock_s = joined("clock_s")
    order = np.argsort(clock_s, kind="stable")
    air = zip(joined("temperature_k")[order], joined("pressure_pa")[order], strict=True)
    moles = np.array([air_density_mol_m3(t, p) for t, p in air])
    log = MeasuredLog(
        clock_s[order],
        joined("beams_ppm")[order],
        joined("wind_world_m_s")[order, :2],
        joined("wind_std_m_s")[order],
        1.0 / (GASES["methane"].molar_mass_kg_mol * moles),
        np.repeat(np.arange(len(paths.sources)), [len(minutes.clock_s) for minutes in paths.sources])[order],
    )
    site = LogSite(
        sensors=SensorPaths.of_beams(np.array(paths.instrument_m), paths.reflectors_m),
        names=tuple(f"beam_{i + 1}" for i in range(len(paths.reflectors_m))),
        period_s=LASER_PERIOD_S,
    )
    releases = tuple(
        TrueRelease(
            name=each.name,
            start_s=float(minutes.clock_s.min()),
            end_s=float(minutes.clock_s.max()) + LASER_PERIOD_S,
            place=None,
            position_m=np.array(each.position_m),
            rate_kg_s=each.rate_kg_s,
            source=i,
        )
        for i, minutes in enumerate(paths.sources)
        for each in minutes.open_sources
    )
    return LogCase(
        name=measured.name,
        site=site,
        log=log,
        releases=releases,
        within_m=LASER_RADIUS_M,
        hash=_hash_files(measured.folder, ("layout.json", "minutes_source_*.csv*")),
    )


# Experiments have no date: each counts as a day of its own. Neither rate nor start of the release is known, and what
# the files say of when gas was seen was found in the readings.
def _case_of_room(measured: MeasuredSet, room: RoomSensors) -> LogCase:
    parts = [_mean_rows(experiment) for experiment in room.experiments]
    start_s = [i * _DAY_S + time_s for i, (time_s, _) in enumerate(parts)]
    n, k = sum(len(each) for each in start_s), len(room.sensors)
    log = MeasuredLog(
        np.concatenate(start_s),
        np.concatenate([readings_ppm for _, readings_ppm in parts]).reshape(n, k),
        np.full((n, 2), np.nan),
        np.full((n, 3), np.nan),
        np.full(n, np.nan),
        np.repeat(np.arange(len(parts)), [len(each) for each in start_s]),
    )
    site = LogSite(sensors=SensorPaths.of_points(room.positions_m), names=room.sensors, period_s=ROOM_PERIOD_S)
    releases = tuple(
        TrueRelease(
            name=f"experiment={experiment.number}",
            start_s=float(clock_s[0]),
            end_s=float(clock_s[-1]) + ROOM_PERIOD_S,
            place=None,
            position_m=np.array(experiment.source_m),
            rate_kg_s=math.nan,
            source=i,
        )
        for i, (experiment, clock_s) in enumerate(zip(room.experiments, start_s, strict=True))
    )
    return LogCase(
        name=measured.name,
        site=site,
        log=log,
        releases=releases,
        within_m=ROOM_RADIUS_M,
        hash=_hash_files(measured.folder, ("room.json", "sensors.csv", "experiments.csv", "exp*.csv*")),
    )


# Times since the beginning, and means of the readings, at equal steps; gaps keep what was read last.
def _mean_rows(experiment: RoomExperiment) -> tuple[Floats, Floats]:
    step = ((experiment.time_s - experiment.time_s[0]) // ROOM_PERIOD_S).astype(np.int64)
    sums = np.zeros((int(step[-1]) + 1, experiment.readings_ppm.shape[1]))
    counts = np.zeros_like(sums)
    np.add.at(sums, step, np.nan_to_num(experiment.readings_ppm))
    np.add.at(counts, step, np.isfinite(experiment.readings_ppm))
    latest = np.maximum.accumulate(np.where(counts > 0, np.arange(len(sums))[:, None], 0), axis=0)
    with np.errstate(invalid="ignore"):
        means = np.take_along_axis(sums / counts, latest, axis=0)
    return ROOM_PERIOD_S * np.arange(len(sums), dtype=np.float64), means


def _hash_files(folder: Path, patterns: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for path in sorted(path for pattern in patterns for path in folder.glob(pattern)):
        digest.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
