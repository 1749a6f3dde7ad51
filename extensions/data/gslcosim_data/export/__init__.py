"""Export of runs: tables as Parquet or CSV, grids as NetCDF or Zarr."""
