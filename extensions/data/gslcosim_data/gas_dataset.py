"""Recorded gas of a run as an xarray dataset."""

from typing import TYPE_CHECKING

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim_formats.datasets import AXES, Variable, build_coordinate, build_dataset

if TYPE_CHECKING:
    import xarray as xr

    from gslcosim_data.run import RunData


def build_gas_dataset(run: "RunData") -> "xr.Dataset":
    """Return the gas that a run recorded in the layer of the map.

    Returns:
        For each gas `GAS_ppm` (time_s, x_m, y_m), right within 1.4 %; `height_m` is the height of the layer.
    """
    slices = {gas: one for gas, one in run.gas_slices.items() if len(one.tick)}
    if not slices:
        raise UsageError(
            f"{run.run_id}: expected a recording with slices of gas, found none. "
            f"Record them now: gslcosim replay {run.folder}"
        )
    variables: dict[str, Variable] = {
        f"{gas}_ppm": (
            ("time_s", "x_m", "y_m"),
            np.stack([one.mixing_ratio_ppm(i) for i in range(len(one.tick))]),
            {
                "units": "ppm",
                "long_name": f"mixing ratio of {gas}",
                "comment": f"recorded in 256 levels: within 1.4 %, and 0 below {one.min_ppm:g} ppm",
            },
        )
        for gas, one in slices.items()
    }
    # All gases of a run are recorded on one grid at the same ticks.
    layer = next(iter(slices.values()))
    coordinates = {
        "time_s": build_coordinate("time_s", layer.time_s, "s", "simulated time"),
        **{
            f"{axis}_m": build_coordinate(
                f"{axis}_m",
                layer.origin_m[i] + (np.arange(layer.shape[i]) + 0.5) * layer.cell_m,
                "m",
                f"centre of the cell, world frame, {axis}",
            )
            for i, axis in enumerate(AXES[:2])
        },
        "height_m": ((), np.float64(layer.height_m), {"units": "m", "long_name": "height of the layer"}),
    }
    return build_dataset(variables, coordinates, {"title": run.run_id, "seed": run.scenario.seed})
