"""Backend of xarray: `xarray.open_dataset(FOLDER, engine="gslcosim")` opens a run or an environment."""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

from xarray import Dataset
from xarray.backends import BackendEntrypoint

from gslcosim.environment.store import HEADER_FILE, load_environment
from gslcosim_data.gas_dataset import build_gas_dataset
from gslcosim_data.run import open_run
from gslcosim_formats.datasets import build_environment_dataset


class GslcosimBackend(BackendEntrypoint):
    """Opens the gas of a run's folder, or the wind and occupancy of an environment's folder."""

    description = "Open runs and environments of gslcosim"
    open_dataset_parameters = ("filename_or_obj", "drop_variables")

    def open_dataset(
        self, filename_or_obj: Any, *, drop_variables: str | Iterable[str] | None = None, **_: Any
    ) -> Dataset:
        """Return the dataset of a folder."""
        folder = Path(filename_or_obj)
        if (folder / HEADER_FILE).is_file():
            dataset = build_environment_dataset(load_environment(folder))
        else:
            dataset = build_gas_dataset(open_run(folder))
        names = [drop_variables] if isinstance(drop_variables, str) else [*(drop_variables or ())]
        return dataset.drop_vars(names, errors="ignore")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Return whether it is a folder of ours, so that `engine` may be left out."""
        if not isinstance(filename_or_obj, str | PathLike):
            return False
        folder = Path(filename_or_obj)
        return (folder / HEADER_FILE).is_file() or (folder / "recording.rrd").is_file()
