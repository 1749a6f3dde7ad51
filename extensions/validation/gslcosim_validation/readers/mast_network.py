"""Gas masts in a yard: `site.json`, `minutes.csv`, `releases.csv` (METEC, Stanford); masts of any names."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim_validation.readers.columns import Columns, build_error, find_table, read_columns
from gslcosim_validation.readers.documents import Document, read_document

LONGEST_GAP_S = 3600.0
STANDARD_PRESSURE_PA = 101_325.0
_READING = re.compile(r"ch4_(?P<mast>.+)_ppm")
_KG_H = 1.0 / 3600.0
# In the description of a site, such as METEC's.
_PRESSURE_IN_WORDS = re.compile(r"air pressure (?:near|of|about) (\d+(?:\.\d+)?) hPa")


@dataclass(frozen=True)
class LoggedRelease:
    """One release in the log of a site: times, rate, and position as far as the file has it.

    `place` the candidate place; None: the site has one place only, or the file names none.
    `position_m` east, north [m] of the emission point; None where the file has none.
    """

    number: int
    start_s: float
    end_s: float
    place: str | None
    position_m: tuple[float, float] | None
    rate_kg_s: float


@dataclass(frozen=True)
class MastNetwork:
    """Masts, candidate places, readings a minute, and releases.

    `masts` names, (k,) in the order of the readings; `masts_m` (k, 3) east, north, up [m]; `places_m` candidate
    places by name; `clock_s` (n,) [s since 1970, UTC]; `readings_ppm` (n, k), nan where a mast has no reading;
    `wind_world_m_s` (n, 2) toward east and north; `pressure_pa` of the air; `forward_ppm_s_g` the authors' own model
    by place, (n, k) ppm per g/s, where the folder has it.
    """

    masts: tuple[str, ...]
    masts_m: NDArray[np.float64]
    places_m: dict[str, Vec3]
    clock_s: NDArray[np.float64]
    readings_ppm: NDArray[np.float64]
    wind_world_m_s: NDArray[np.float64]
    pressure_pa: float
    releases: tuple[LoggedRelease, ...]
    forward_ppm_s_g: dict[str, NDArray[np.float64]]

    @property
    def period_s(self) -> float:
        """From one row to the next [s]: the median step, a minute in a log of one row."""
        return float(np.median(np.diff(self.clock_s))) if len(self.clock_s) > 1 else 60.0

    @property
    def has_several_places(self) -> bool:
        """True if the candidate positions differ horizontally, so that there is a choice."""
        return len({place_m[:2] for place_m in self.places_m.values()}) > 1


def read_mast_network(folder: Path) -> MastNetwork:
    """Return the set in a folder."""
    site = read_document(folder / "site.json")
    minutes = read_columns(find_table(folder, "minutes"))
    masts = tuple(found["mast"] for name in minutes.texts if (found := _READING.fullmatch(name)))
    known = site.block("masts")
    if not masts:
        other = next((name for name in minutes.texts if name.startswith("ch4_")), None)
        if other is not None:
            remedy = f"Convert column {other} and those like it to ppm, and rename them."
            raise build_error(minutes.path, "", expected="columns ch4_MAST_ppm", found=other, remedy=remedy)
        minutes.require(["ch4_MAST_ppm"])
    if set(masts) - set(known):
        raise build_error(
            minutes.path,
            "",
            expected=f"readings of the masts of site.json ({', '.join(sorted(known))})",
            found=", ".join(sorted(set(masts) - set(known))),
            remedy="Take the site.json of the same campaign, or give these masts there the names that they have here.",
        )
    # A mast without a column read nothing; one in another unit is refused.
    is_there = [any(name.startswith(f"ch4_{mast}_") for name in minutes.texts) for mast in known]
    minutes.require([f"ch4_{mast}_ppm" for mast, is_read in zip(known, is_there, strict=True) if is_read])
    readings_ppm = minutes.matrix([f"ch4_{name}_ppm" for name in masts], allow_gaps=True)
    for name, values in zip(masts, readings_ppm.T, strict=True):
        minutes.require_ppm(f"ch4_{name}_ppm", values)
    clock_s = minutes.require_rising("time_utc", minutes.clock_s("time_utc"), longest_gap_s=LONGEST_GAP_S)
    places_m = {name: _place_m(site, "candidate_places", name) for name in site.block("candidate_places")}
    return MastNetwork(
        masts=masts,
        masts_m=np.array([_place_m(site, "masts", name) for name in masts]),
        places_m=places_m,
        clock_s=clock_s,
        readings_ppm=readings_ppm,
        wind_world_m_s=minutes.matrix(["wind_east_m_s", "wind_north_m_s"], allow_gaps=True),
        pressure_pa=_pressure_pa(site),
        releases=_read_releases(folder, places_m, clock_s, minutes.path),
        forward_ppm_s_g=_read_forward(folder, masts, places_m, clock_s),
    )


def _place_m(site: Document, kind: str, name: str) -> Vec3:
    east_m, north_m, height_m = (site.number(kind, name, key) for key in ("east_m", "north_m", "height_m"))
    return east_m, north_m, height_m


# In the file as a number, or in the words that describe the site; else sea level.
def _pressure_pa(site: Document) -> float:
    if site.get("air_pressure_pa") is not None:
        return site.number("air_pressure_pa")
    found = _PRESSURE_IN_WORDS.search(str(site.get("site")))
    return 100.0 * float(found[1]) if found else STANDARD_PRESSURE_PA


def _read_releases(
    folder: Path, places_m: dict[str, Vec3], clock_s: NDArray[np.float64], minutes: Path
) -> tuple[LoggedRelease, ...]:
    table = read_columns(find_table(folder, "releases"), must_have_rows=False)
    if not table.n_rows:
        return ()
    numbers, rates = table.numbers("release"), table.numbers("rate_kg_h")
    starts, ends = table.clock_s("start_utc"), table.clock_s("end_utc")
    places = table.words("place") if "place" in table.texts else (None,) * table.n_rows
    has_points = {"east_m", "north_m"} <= set(table.texts)
    points = (table.numbers("east_m"), table.numbers("north_m")) if has_points else None
    for i, place in enumerate(places):
        if place is not None and place not in places_m:
            listed = ", ".join(places_m)
            remedy = "Take the site.json of the same campaign, or give the place there the name that it has here."
            raise table.error("place", i, f"one of {listed}", place, remedy)
        if ends[i] <= starts[i]:
            raise table.error("end_utc", i, "an end after the start", table.texts["end_utc"][i], "Swap the two.")
        if rates[i] <= 0.0:
            raise table.error("rate_kg_h", i, "a rate above 0", table.texts["rate_kg_h"][i], "Leave the row out.")
        if ends[i] < clock_s[0] or starts[i] > clock_s[-1]:
            remedy = f"Take the releases of the week of {minutes.name}."
            raise table.error("start_utc", i, "a time within the log", table.texts["start_utc"][i], remedy)
    return tuple(
        LoggedRelease(
            number=int(numbers[i]),
            start_s=float(starts[i]),
            end_s=float(ends[i]),
            place=places[i],
            position_m=(float(points[0][i]), float(points[1][i])) if points else None,
            rate_kg_s=float(rates[i]) * _KG_H,
        )
        for i in range(table.n_rows)
    )


# Rows of the authors' model are brought to those of the log; nan where it has none.
def _read_forward(
    folder: Path, masts: tuple[str, ...], places_m: dict[str, Vec3], clock_s: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    path = find_table(folder, "forward_authors")
    if not path.is_file():
        return {}
    table: Columns = read_columns(path)
    rows = np.searchsorted(clock_s, theirs := table.clock_s("time_utc"))
    is_logged = (rows < len(clock_s)) & (clock_s[np.minimum(rows, len(clock_s) - 1)] == theirs)
    forward = {}
    for place in places_m:
        values = np.full((len(clock_s), len(masts)), np.nan)
        for k, mast in enumerate(masts):
            column = table.numbers(f"{place}__{mast}_ppm_per_g_s", allow_gaps=True)
            values[rows[is_logged], k] = column[is_logged]
        forward[place] = values
    return forward
