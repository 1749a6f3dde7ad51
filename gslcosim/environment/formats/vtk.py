"""VTK image data of an environment, for ParaView and whatever else reads its format."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyevtk.hl import imageToVTK
from pyevtk.vtk import VtkGroup

from gslcosim.environment.model import Environment


def write_vtk(environment: Environment, folder: Path, name: str) -> tuple[Path, ...]:
    """Write `<name>_i.vti` for each frame of wind, and `<name>.pvd`, which has them in time.

    Each file holds, for every cell: `wind` [m/s], `speed` [m/s], and `occupancy` as in `Cell`.

    Args:
        environment: What to write.
        folder: Where; it is there.
        name: What the files' names begin with.

    Returns:
        The files, the series last.
    """
    series = VtkGroup(str(folder / name))
    files: list[Path] = []
    for i, velocity_m_s in enumerate(environment.wind.velocity_m_s):
        files.append(Path(_write_frame(environment, velocity_m_s, folder / f"{name}_{i}")))
        series.addFile(filepath=str(files[-1]), sim_time=i * environment.wind.period_s)
    series.save()
    return (*files, folder / f"{name}.pvd")


def _write_frame(environment: Environment, velocity_m_s: NDArray[np.float32], path: Path) -> str:
    cell_data = {
        "wind": tuple(np.ascontiguousarray(velocity_m_s[..., axis]) for axis in range(3)),
        "speed": np.linalg.norm(velocity_m_s, axis=-1),
        "occupancy": np.ascontiguousarray(environment.occupancy),
    }
    grid = environment.grid
    return imageToVTK(str(path), origin=grid.origin_m, spacing=(grid.cell_m,) * 3, cellData=cell_data)
