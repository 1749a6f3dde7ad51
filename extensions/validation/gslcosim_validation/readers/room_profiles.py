"""Profiles of the mean wind in a ventilated room: `u_profiles.csv` and `geometry.json` (the room of IEA Annex 20)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim_validation.readers.columns import build_error, read_columns
from gslcosim_validation.readers.documents import Document, read_document


@dataclass(frozen=True)
class ProfileLine:
    """Mean wind along one line.

    `points_m` (n, 3) places [m]; `u_m_s` (n,) wind along x [m/s]; `of_models_m_s` what other programs gave there, by
    their name, nan where they gave nothing.
    """

    name: str
    points_m: NDArray[np.float64]
    u_m_s: NDArray[np.float64]
    of_models_m_s: dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class RoomProfiles:
    """A room with a slot under the ceiling of one end and an opening at the other, and wind along lines in it.

    `size_m` length along x, width y, height z [m]; `inlet_z_m`, `outlet_z_m` lower and upper edge [m] of slots over
    the whole width, in the walls x = 0 and x = length; `inlet_m_s` U0 [m/s]; `inlet_intensity` standard deviation of
    the wind in the inlet over U0 [1]; `inlet_length_m` length scale of its turbulence [m].
    """

    size_m: Vec3
    inlet_z_m: tuple[float, float]
    outlet_z_m: tuple[float, float]
    inlet_m_s: float
    inlet_intensity: float
    inlet_length_m: float
    lines: tuple[ProfileLine, ...]


def read_room_profiles(folder: Path) -> RoomProfiles:
    """Return the set in a folder."""
    geometry = read_document(folder / "geometry.json")
    table = read_columns(folder / "u_profiles.csv")
    names = np.array(table.words("line"))
    points_m = table.matrix(["x_m", "y_m", "z_m"])
    size_m = tuple(geometry.number("room_m", name) for name in ("length_x", "width_y", "height_z"))
    outside = np.flatnonzero(((points_m < 0.0) | (points_m > np.array(size_m))).any(axis=1))
    if len(outside):
        raise table.error("x_m", int(outside[0]), f"a point in the room of {size_m} m", f"{points_m[outside[0]]}", "")
    u_m_s = table.numbers("u_m_s")
    models = {
        name.removeprefix("u_").removesuffix("_m_s"): table.numbers(name, allow_gaps=True)
        for name in table.texts
        if name.startswith("u_") and name.endswith("_m_s") and name != "u_m_s"
    }
    lines = tuple(
        ProfileLine(
            name=name,
            points_m=points_m[names == name],
            u_m_s=u_m_s[names == name],
            of_models_m_s={model: values[names == name] for model, values in models.items()},
        )
        for name in dict.fromkeys(names.tolist())
    )
    return RoomProfiles(
        size_m=(size_m[0], size_m[1], size_m[2]),
        inlet_z_m=_edges(geometry, "inlet"),
        outlet_z_m=_edges(geometry, "outlet"),
        inlet_m_s=geometry.number("inlet", "u0_m_s"),
        inlet_intensity=geometry.number("inlet_turbulence", "intensity"),
        inlet_length_m=geometry.number("inlet_turbulence", "length_scale_m"),
        lines=lines,
    )


def _edges(geometry: Document, slot: str) -> tuple[float, float]:
    edges = geometry.get(slot, "z_m")
    if not (isinstance(edges, list) and len(edges) == 2 and edges[0] < edges[1]):
        raise build_error(geometry.path, f"{slot}.z_m", expected="lower and upper edge [m]", found=repr(edges))
    return float(edges[0]), float(edges[1])
