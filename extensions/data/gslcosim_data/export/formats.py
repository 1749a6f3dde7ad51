"""Export of a run in a format chosen by name."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, get_args

from gslcosim.base.errors import UsageError
from gslcosim_data.export.datasets import write_run_datasets
from gslcosim_data.export.tables import write_tables
from gslcosim_data.run import RunData
from gslcosim_formats.datasets import import_xarray
from gslcosim_ros.bag_export import iterate_messages, write_mcap, write_rosbag2
from gslcosim_ros.types import ros_types

ExtractFormat = Literal["parquet", "csv", "netcdf", "zarr", "mcap", "rosbag2"]
EXTRACT_FORMATS: tuple[ExtractFormat, ...] = get_args(ExtractFormat)


def extract_run(
    run: RunData, folder: Path, to: ExtractFormat, progress: Callable[[str], None] = lambda _: None
) -> tuple[Path, ...]:
    """Write a run in another program's format.

    Args:
        run: What to write.
        folder: Where; a new folder or an empty one.
        to: `parquet` and `csv` write a table for each stream and a dictionary of all columns; `netcdf` and `zarr` the
            gas and the wind on their grids; `mcap` and `rosbag2` messages of ROS 2.
        progress: Receives what is being written.

    Returns:
        The files that were written.

    Raises:
        UsageError: the folder holds something, or the extension `ros` or `xarray` is not installed.
        EnvironmentDataError: the room is needed and is not the one that was run in.
        OSError: the machine refuses.
    """
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"The folder is not empty: {folder}. Choose a new or empty folder, so that files do not mix.")
    if to in ("parquet", "csv"):
        folder.mkdir(parents=True, exist_ok=True)
        return tuple(write_tables(run, folder, to, lambda table: progress(f"table {table}")))
    if to in ("netcdf", "zarr"):
        import_xarray()
        folder.mkdir(parents=True, exist_ok=True)
        return tuple(write_run_datasets(run, folder, to, progress))
    types = ros_types()

    def report_count(n_messages: int) -> None:
        progress(f"message {n_messages}")

    if to == "mcap":
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{run.run_id}.mcap"
        write_mcap(iterate_messages(run, types), path, types, report_count)
        return (path,)
    if folder.exists():
        # Bags make their own folder.
        folder.rmdir()
    folder.parent.mkdir(parents=True, exist_ok=True)
    write_rosbag2(iterate_messages(run, types), folder, types, report_count)
    return tuple(sorted(folder.iterdir()))
