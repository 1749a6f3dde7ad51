"""Leaks of a light gas into a box with holes: `cases.csv`, `series/*.csv`, `geometry.json` (NIST's quarter garage)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim_validation.readers.columns import Columns, build_error, find_table, read_columns
from gslcosim_validation.readers.documents import Document, read_document

_LITRES_PER_MINUTE = 1e-3 / 60.0


@dataclass(frozen=True)
class SquareHole:
    """A square hole in the wall x = 0: its centre and side [m]."""

    y_m: float
    z_m: float
    side_m: float


@dataclass(frozen=True)
class LeakCase:
    """One leak and what the rake read.

    `release_m3_s` volume of gas per second, for `release_s`; `time_s` (n,); `volume_percent` (n, k) at the k heights
    of the rake from below.
    """

    name: str
    release_s: float
    release_m3_s: float
    leak: str
    position_m: Vec3
    vents: str
    holes: tuple[SquareHole, ...]
    time_s: NDArray[np.float64]
    volume_percent: NDArray[np.float64]

    def profile_at(self, time_s: float) -> NDArray[np.float64]:
        """Return the (k,) readings at a time [s], between rows in proportion; nan after the series."""
        columns = (self.volume_percent[:, i] for i in range(self.volume_percent.shape[1]))
        return np.array([np.interp(time_s, self.time_s, column, right=np.nan) for column in columns])


@dataclass(frozen=True)
class LeakBox:
    """A box with leaks: inner size [m], (k, 3) places of the rake's sensors from below [m], density of the gas."""

    size_m: Vec3
    rake_m: NDArray[np.float64]
    leak_area_m2: dict[str, float]
    gas_density_kg_m3: float
    air_temperature_k: float
    cases: tuple[LeakCase, ...]


def read_leak_box(folder: Path) -> LeakBox:
    """Return the set in a folder."""
    geometry = read_document(folder / "geometry.json")
    table = read_columns(folder / "cases.csv")
    heights_m = geometry.get("sensors", "z_m")
    if not (isinstance(heights_m, list) and heights_m == sorted(heights_m)):
        raise build_error(geometry.path, "sensors.z_m", expected="heights from below [m]", found=repr(heights_m))
    rake_xy_m = geometry.number("sensors", "rake_x_m"), geometry.number("sensors", "rake_y_m")
    return LeakBox(
        size_m=(geometry.number("box_m", "x"), geometry.number("box_m", "y"), geometry.number("box_m", "z")),
        rake_m=np.array([(*rake_xy_m, height_m) for height_m in heights_m]),
        leak_area_m2={name: geometry.number("leaks", name, "outlet_area_m2") for name in geometry.block("leaks")},
        gas_density_kg_m3=geometry.number("helium", "density_kg_m3_294K"),
        air_temperature_k=273.15 + geometry.number("air_temperature_degC"),
        cases=tuple(_read_case(folder, table, i, geometry, len(heights_m)) for i in range(table.n_rows)),
    )


def _read_case(folder: Path, table: Columns, i: int, geometry: Document, n_heights: int) -> LeakCase:
    name, vents = table.words("case")[i], table.words("vents")[i]
    series = read_columns(find_table(folder / "series", name))
    openings = geometry.get("vents", vents, "openings")
    if not openings:
        remedy = f"Add it to {geometry.path.name}."
        raise table.error("vents", i, "vents that the geometry has", vents, remedy)
    return LeakCase(
        name=name,
        release_s=float(table.numbers("release_duration_s")[i]),
        release_m3_s=float(table.numbers("leak_rate_report_l_min")[i]) * _LITRES_PER_MINUTE,
        leak=table.words("leak")[i],
        position_m=table.point("leak", i),
        vents=vents,
        holes=tuple(SquareHole(each["y_m"], each["z_m"], each["side_m"]) for each in openings),
        time_s=series.rising_s(),
        volume_percent=series.matrix([f"helium_{k + 1}_volume_percent" for k in range(n_heights)], allow_gaps=True),
    )
