"""Lasers over a field: `layout.json`, `minutes_source_*.csv`, each of sources that were open together (Chilbolton)."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim_validation.readers.columns import Columns, build_error, read_columns
from gslcosim_validation.readers.documents import Document, read_document

# Wind directions scatter by no more than this.
_MAX_TAN_GAMMA = 10.0
_BEAM = re.compile(r"ch4_beam_(?P<number>\d+)_ppm")
# Of a source of the layout: the minutes in which it was open, if they have not its name.
_MINUTES = "minutes"


@dataclass(frozen=True)
class OpenSource:
    """The truth of one source: its name, `position_m` and `rate_kg_s`."""

    name: str
    position_m: Vec3
    rate_kg_s: float


@dataclass(frozen=True)
class LaserMinutes:
    """Readings of one source, or of several that were open together, a row a minute; the clock may leap.

    `source` name of these minutes, mostly that of their source; `position_m`, `rate_kg_s` the truth of it, and of the
    first where several were open; `beside` the others; `release` (n,) which release a row belongs to; `clock_s`
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
    beside: tuple[OpenSource, ...] = ()
    first_name: str = ""

    @property
    def open_sources(self) -> tuple[OpenSource, ...]:
        """All sources that were open."""
        return (OpenSource(self.first_name or self.source, self.position_m, self.rate_kg_s), *self.beside)

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
    reflectors_m = {_number(layout, name): layout.vector("reflectors_m", name) for name in layout.block("reflectors_m")}
    files = sorted(folder.glob("minutes_source_*.csv*"))
    return LaserPaths(
        instrument_m=layout.vector("instrument_m"),
        reflectors_m=np.array([reflectors_m[number] for number in sorted(reflectors_m)]),
        sources=tuple(_read_source(path, layout, sorted(reflectors_m)) for path in files),
    )


# Of a reflector, by which its beam is known.
def _number(layout: Document, name: str) -> int:
    end = name.rsplit("_", 1)[-1]
    if not end.isdecimal():
        remedy = "Number it as its beam, ch4_beam_N_ppm, is."
        raise build_error(layout.path, "reflectors_m", expected="names that end with _N", found=name, remedy=remedy)
    return int(end)


# Those whose name or `minutes` is that of the file.
def _sources_of(path: Path, layout: Document) -> tuple[str, tuple[OpenSource, ...]]:
    minutes = path.name.removeprefix("minutes_").split(".")[0]
    listed = layout.block("sources")
    names = [name for name in listed if (layout.get("sources", name, _MINUTES) or name) == minutes]
    if not names:
        raise build_error(
            layout.path,
            "sources",
            expected=f"{minutes}, of which {path.name} has readings",
            found=", ".join(listed),
            remedy="Take the layout of the same campaign, or rename the file or the source so that they agree; where "
            f'sources were open together, give each of them "{_MINUTES}": "{minutes}".',
        )
    return minutes, tuple(
        OpenSource(name, layout.vector("sources", name, "place_m"), layout.number("sources", name, "rate_kg_s"))
        for name in names
    )


def _read_source(path: Path, layout: Document, beams: list[int]) -> LaserMinutes:
    table = read_columns(path)
    minutes, (first, *beside) = _sources_of(path, layout)
    found = {int(each["number"]): each.string for name in table.texts if (each := _BEAM.fullmatch(name))}
    names = [f"ch4_beam_{number}_ppm" for number in beams]
    if unknown := [name for number, name in found.items() if number not in beams]:
        remedy = "Add its reflector to layout.json, or leave the column out."
        raise build_error(
            path, "", expected=f"beams with a reflector ({', '.join(names)})", found=", ".join(unknown), remedy=remedy
        )
    # A beam without a column read nothing; one in another unit is refused.
    is_there = [any(each.startswith(name.removesuffix("ppm")) for each in table.texts) for name in names]
    if not any(is_there):
        table.require(names)
    beams_ppm = np.full((table.n_rows, len(beams)), np.nan)
    for k in np.flatnonzero(is_there).tolist():
        beams_ppm[:, k] = table.require_ppm(names[k], table.numbers(names[k], allow_gaps=True))
    release = np.array(table.words("release"))
    clock_s = table.clock_s("clock_time")
    for name in dict.fromkeys(release.tolist()):
        rows = np.flatnonzero(release == name)
        back = np.flatnonzero(np.diff(clock_s[rows]) <= 0.0)
        if len(back):
            row = int(rows[back[0] + 1])
            raise table.error("clock_time", row, "a later time than before", "an earlier one", "Sort the rows by time.")
    return LaserMinutes(
        source=minutes,
        position_m=first.position_m,
        rate_kg_s=first.rate_kg_s,
        release=release,
        clock_s=clock_s,
        beams_ppm=beams_ppm,
        wind_world_m_s=table.matrix([f"wind_{axis}_m_s" for axis in "xyz"], allow_gaps=True),
        wind_std_m_s=table.matrix([f"wind_{axis}_std_m_s" for axis in "xyz"], allow_gaps=True),
        temperature_k=table.numbers("air_temperature_k", allow_gaps=True),
        pressure_pa=table.numbers("pressure_pa", allow_gaps=True),
        tan_gamma_horizontal=_scatter(table, "tan_gamma_horizontal"),
        tan_gamma_vertical=_scatter(table, "tan_gamma_vertical"),
        beside=tuple(beside),
        first_name=first.name,
    )


def _scatter(table: Columns, name: str) -> NDArray[np.float64]:
    values = table.numbers(name, allow_gaps=True)
    return np.where(values <= _MAX_TAN_GAMMA, values, np.nan)
