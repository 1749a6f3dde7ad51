"""Lasers over a field: `layout.json`, `minutes_source_*.csv` (seven beams at Chilbolton), one source a file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim_validation.readers.columns import Columns, build_error, read_columns
from gslcosim_validation.readers.documents import Document, read_document

# Wind directions scatter by no more than this.
_MAX_TAN_GAMMA = 10.0


@dataclass(frozen=True)
class LaserMinutes:
    """Readings of one source, a row a minute; the clock may leap between releases.

    `source` its name; `position_m`, `rate_kg_s` the truth; `release` (n,) which release a row belongs to; `clock_s`
    (n,) [s since 1970]; `beams_ppm` (n, k) mean mixing ratio along each beam; `wind_world_m_s` (n, 3) and
    `wind_std_m_s` (n, 3) mean and standard deviation within the minute; `temperature_k`, `pressure_pa` (n,).
    `tan_gamma_horizontal`, `tan_gamma_vertical` (n,): scatter of the wind's direction as published, nan where absurd.
    """

    source: str
    position_m: Vec3
    rate_kg_s: float
    release: NDArray[np.str_]
    clock_s: NDArray[np.float64]
    beams_ppm: NDArray[np.float64]
    wind_world_m_s: NDArray[np.float64]
    wind_std_m_s: NDArray[np.float64]
    temperature_k: NDArray[np.float64]
    pressure_pa: NDArray[np.float64]
    tan_gamma_horizontal: NDArray[np.float64]
    tan_gamma_vertical: NDArray[np.float64]

    @property
    def day(self) -> NDArray[np.int64]:
        """(n,) number of the day of each row."""
        return (self.clock_s // 86_400.0).astype(np.int64)


@dataclass(frozen=True)
class LaserPaths:
    """A scanning laser: its position, (k, 3) positions of its reflectors [m], and the readings of each source."""

    instrument_m: Vec3
    reflectors_m: NDArray[np.float64]
    sources: tuple[LaserMinutes, ...]


def read_laser_paths(folder: Path) -> LaserPaths:
    """Return the set in a folder."""
    layout = read_document(folder / "layout.json")
    names = sorted(layout.block("reflectors_m"), key=lambda name: int(name.rsplit("_", 1)[-1]))
    files = sorted(folder.glob("minutes_source_*.csv*"))
    return LaserPaths(
        instrument_m=layout.vector("instrument_m"),
        reflectors_m=np.array([layout.vector("reflectors_m", name) for name in names]),
        sources=tuple(_read_source(path, layout, len(names)) for path in files),
    )


def _read_source(path: Path, layout: Document, n_beams: int) -> LaserMinutes:
    table = read_columns(path)
    source = path.name.removeprefix("minutes_").split(".")[0]
    if source not in layout.block("sources"):
        raise build_error(
            layout.path,
            "sources",
            expected=f"{source}, of which {path.name} has readings",
            found=", ".join(layout.block("sources")),
            remedy="Take the layout of the same campaign.",
        )
    beams = [name for name in table.texts if name.startswith("ch4_beam_")]
    names = [f"ch4_beam_{i + 1}_ppm" for i in range(n_beams)]
    if len(beams) != n_beams:
        found = f"{len(beams)} columns ch4_beam_*_ppm"
        raise build_error(path, "", expected=f"{n_beams} beams, one for each reflector", found=found)
    beams_ppm = table.matrix(names, allow_gaps=True)
    for name, values in zip(names, beams_ppm.T, strict=True):
        table.require_ppm(name, values)
    release = np.array(table.words("release"))
    clock_s = table.clock_s("clock_time")
    for name in dict.fromkeys(release.tolist()):
        rows = np.flatnonzero(release == name)
        back = np.flatnonzero(np.diff(clock_s[rows]) <= 0.0)
        if len(back):
            row = int(rows[back[0] + 1])
            raise table.error("clock_time", row, "a later time than before", "an earlier one", "Sort the rows by time.")
    return LaserMinutes(
        source=source,
        position_m=layout.vector("sources", source, "place_m"),
        rate_kg_s=layout.number("sources", source, "rate_kg_s"),
        release=release,
        clock_s=clock_s,
        beams_ppm=beams_ppm,
        wind_world_m_s=table.matrix([f"wind_{axis}_m_s" for axis in "xyz"], allow_gaps=True),
        wind_std_m_s=table.matrix([f"wind_{axis}_std_m_s" for axis in "xyz"], allow_gaps=True),
        temperature_k=table.numbers("air_temperature_k", allow_gaps=True),
        pressure_pa=table.numbers("pressure_pa", allow_gaps=True),
        tan_gamma_horizontal=_scatter(table, "tan_gamma_horizontal"),
        tan_gamma_vertical=_scatter(table, "tan_gamma_vertical"),
    )


def _scatter(table: Columns, name: str) -> NDArray[np.float64]:
    values = table.numbers(name, allow_gaps=True)
    return np.where(values <= _MAX_TAN_GAMMA, values, np.nan)
