"""Gridded data as xarray datasets, and as NetCDF and Zarr files: wind and occupancy of environments.

Names of variables and coordinates carry their units, and each has the attributes `units` and `long_name` of the CF
conventions.
"""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim import __version__
from gslcosim.base.errors import UsageError
from gslcosim.environment.model import Environment

if TYPE_CHECKING:
    import xarray as xr

GriddedFormat = Literal["netcdf", "zarr"]

AXES = ("x", "y", "z")

Variable = tuple[tuple[str, ...], Any, dict[str, Any]]
"""Dimensions, values and attributes: what xarray makes a variable of."""


def build_environment_dataset(environment: Environment) -> "xr.Dataset":
    """Return the occupancy and the wind of an environment.

    Returns:
        `wind_x_m_s`, `wind_y_m_s`, `wind_z_m_s` (time_s, x_m, y_m, z_m): wind at cell centres, world frame; a frame
        holds from its time on. `occupancy` (x_m, y_m, z_m): 0 air, 1 solid, 2 air at an outlet.
    """
    grid, wind = environment.grid, environment.wind
    cells = ("x_m", "y_m", "z_m")
    variables: dict[str, Variable] = {
        f"wind_{axis}_m_s": (
            ("time_s", *cells),
            wind.velocity_m_s[..., i],
            {"units": "m s-1", "long_name": f"wind along {axis}, world frame"},
        )
        for i, axis in enumerate(AXES)
    }
    variables["occupancy"] = (
        cells,
        environment.occupancy,
        {
            "long_name": "what fills the cell",
            "flag_values": np.arange(3, dtype=np.uint8),
            "flag_meanings": "air solid outlet",
        },
    )
    frames_s = np.arange(len(wind.velocity_m_s)) * wind.period_s
    coordinates = {
        "time_s": build_coordinate("time_s", frames_s, "s", "time since the start of the wind"),
        **{
            f"{axis}_m": build_coordinate(
                f"{axis}_m", grid.axis_centres_m(i), "m", f"centre of the cell, world frame, {axis}"
            )
            for i, axis in enumerate(AXES)
        },
    }
    return build_dataset(variables, coordinates, {"title": environment.name, "is_looping": int(wind.is_looping)})


def write_dataset(dataset: "xr.Dataset", folder: Path, name: str, to: GriddedFormat) -> Path:
    """Write a dataset as `NAME.nc` (NetCDF 4) or `NAME.zarr`, compressed, and return the path."""
    if to == "netcdf":
        path = folder / f"{name}.nc"
        packed = {str(variable): {"zlib": True, "complevel": 4} for variable in dataset.data_vars}
        dataset.to_netcdf(path, engine="h5netcdf", encoding=packed)
    else:
        path = folder / f"{name}.zarr"
        # Readers of all versions know format 2, and find its consolidated metadata without asking for them.
        dataset.to_zarr(path, mode="w-", zarr_format=2, consolidated=True)
    return path


def import_xarray() -> Any:
    """Return the module xarray, which comes with an extra."""
    try:
        return importlib.import_module("xarray")
    except ImportError as error:
        raise UsageError("Datasets of xarray need the extra xarray: pip install 'gslcosim-data[xarray]'.") from error


def build_coordinate(name: str, values: NDArray[Any], unit: str, meaning: str) -> Variable:
    """Return a coordinate along the dimension of its own name."""
    return ((name,), values, {"units": unit, "long_name": meaning})


def build_dataset(
    variables: Mapping[str, Variable], coordinates: Mapping[str, Variable], attributes: Mapping[str, Any]
) -> "xr.Dataset":
    """Return a dataset that also says which conventions it follows and what wrote it."""
    about = {
        "Conventions": "CF-1.11",
        "source": f"gslcosim {__version__}",
        "history": f"gslcosim {__version__} made it",
    }
    dataset: xr.Dataset = import_xarray().Dataset(dict(variables), dict(coordinates), {**attributes, **about})
    # Coordinates have no gaps, and CF (2.5.1) forbids the value for gaps that xarray would give each of them.
    for name in dataset.coords:
        dataset[name].encoding["_FillValue"] = None
    return dataset
