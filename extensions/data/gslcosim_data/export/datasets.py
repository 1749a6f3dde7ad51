"""Gas and wind of a run as files of NetCDF and Zarr."""

from collections.abc import Callable
from pathlib import Path

from gslcosim_data.gas_dataset import build_gas_dataset
from gslcosim_data.run import RunData
from gslcosim_formats.datasets import GriddedFormat, build_environment_dataset, write_dataset


def write_run_datasets(run: RunData, folder: Path, to: GriddedFormat, progress: Callable[[str], None]) -> list[Path]:
    """Write the gas of a run, where it was recorded, and the wind of its environment."""
    files: list[Path] = []
    if any(len(one.tick) for one in run.gas_slices.values()):
        progress("gas")
        files.append(write_dataset(build_gas_dataset(run), folder, "gas", to))
    progress("wind")
    return [*files, write_dataset(build_environment_dataset(run.environment), folder, "wind", to)]
