"""Formats that this package registers for environments."""

from gslcosim.base.exporters import Exporter

_FUNCTION = "gslcosim_formats.export:write_environment"
_SUMMARIES = {
    "gaden": "occupancy and wind of GADEN",
    "gsl_bench": "an environment of GSL-Bench",
    "vtk": "wind and cells for ParaView",
    "netcdf": "wind and cells on their grid (extra xarray)",
    "zarr": "the same as a Zarr store (extra xarray)",
    "stl": "solids as surfaces",
    "openfoam_points": "wind as points of OpenFOAM",
    "mjcf": "the scene of MuJoCo",
}
EXPORTERS = tuple(
    Exporter(name=name, of="environment", summary=summary, function=_FUNCTION) for name, summary in _SUMMARIES.items()
)
