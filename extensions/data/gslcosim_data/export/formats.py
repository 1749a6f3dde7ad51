"""Export of a run in a format chosen by name, and the formats of this package: tables, and grids of gas and wind."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from gslcosim.base.errors import UsageError
from gslcosim.base.exporters import list_exporters
from gslcosim_data.run import RunData

Progress = Callable[[str], None]


def extract_run(run: RunData, folder: Path, to: str, progress: Progress = lambda _: None) -> tuple[Path, ...]:
    """Write a run in another program's format.

    Args:
        folder: Where; a new folder or an empty one.
        to: The name of a registered exporter of runs. `parquet` and `csv` write a table for each stream and a
            dictionary of all columns, `netcdf` and `zarr` the gas and the wind on their grids.

    Returns:
        The files that were written.
    """
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"The folder is not empty: {folder}. Choose a new or empty folder, so that files do not mix.")
    return tuple(list_exporters("run")[to].load()(run, folder, to, progress))


def write_stream_tables(run: RunData, folder: Path, to: Literal["parquet", "csv"], progress: Progress) -> list[Path]:
    """Write a table for each stream, as `parquet` or `csv`."""
    from gslcosim_data.export.tables import write_tables

    folder.mkdir(parents=True, exist_ok=True)
    return list(write_tables(run, folder, to, lambda table: progress(f"table {table}")))


def write_grids(run: RunData, folder: Path, to: Literal["netcdf", "zarr"], progress: Progress) -> list[Path]:
    """Write gas and wind on their grids, as `netcdf` or `zarr`."""
    from gslcosim_data.export.datasets import write_run_datasets
    from gslcosim_formats.datasets import import_xarray

    import_xarray()
    folder.mkdir(parents=True, exist_ok=True)
    return list(write_run_datasets(run, folder, to, progress))
