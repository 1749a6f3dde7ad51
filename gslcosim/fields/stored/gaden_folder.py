"""What lies around GADEN's gas frames: the walls of the scenario."""

from pathlib import Path

from gslcosim.environment.exchange.gaden_grid import OCCUPANCY_FILE, read_occupancy
from gslcosim.fields.reading.concentration import Walls

# Results lie a few folders below their scenario.
N_FOLDERS_UP = 4


def find_occupancy(folder: Path) -> Path | None:
    """Return the nearest `OccupancyGrid3D.csv` in a folder or the few above it, if there is one."""
    above = folder.resolve()
    for candidate in [above, *above.parents][: N_FOLDERS_UP + 1]:
        if (candidate / OCCUPANCY_FILE).is_file():
            return candidate / OCCUPANCY_FILE
    return None


def read_walls(path: Path) -> Walls:
    """Return the walls that an `OccupancyGrid3D.csv` describes.

    Raises:
        EnvironmentDataError: the file is not of this kind, or its cells do not fit its head.
    """
    grid, occupancy = read_occupancy(path)
    return Walls.of_occupancy(occupancy, grid)
