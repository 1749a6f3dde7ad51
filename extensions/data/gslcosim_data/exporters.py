"""Formats that this package registers for runs."""

from gslcosim.base.exporters import Exporter

_TABLES = "gslcosim_data.export.formats:write_stream_tables"
_GRIDS = "gslcosim_data.export.formats:write_grids"
EXPORTERS = (
    Exporter(name="parquet", of="run", summary="a table per stream and a dictionary of columns", function=_TABLES),
    Exporter(name="csv", of="run", summary="the same as text", function=_TABLES),
    Exporter(name="netcdf", of="run", summary="gas and wind on their grids (extra xarray)", function=_GRIDS),
    Exporter(name="zarr", of="run", summary="the same as a Zarr store (extra xarray)", function=_GRIDS),
)
