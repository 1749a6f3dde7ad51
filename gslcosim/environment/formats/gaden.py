"""GADEN environments: `OccupancyGrid3D.csv` with the wind that lies around it.

Layouts that are known, from MAPIRlab/gaden and AutoGDM+:

    <scenario>/OccupancyGrid3D.csv, wind_simulations/<name>/<name>_i.csv[_U|_V|_W], gas_simulations/<…>/<…>/wind
    <scenario>/environment_configurations/<name>/OccupancyGrid3D.csv, wind/wind_iteration_i, simulations/<…>/<…>/wind

GADEN's grid holds the walls; its outlets are cells of code 2, where filaments end. Inlets are not marked.
"""

from pathlib import Path

from gslcosim.environment.formats.data_files import data_error
from gslcosim.environment.formats.gaden_grid import OCCUPANCY_FILE, read_occupancy
from gslcosim.environment.formats.occupancy_import import geometry_from_grid, load_geometry_with_wind
from gslcosim.environment.geometry_model import EnvironmentGeometry
from gslcosim.environment.model import Environment

# Below the folder of the occupancy: where a wind may be; the first pattern that is there is taken.
_WIND_FOLDERS = ("wind", "wind_simulations", "wind_simulations/*", "gas_simulations/*/*/wind", "simulations/*/*/wind")
_OCCUPANCY_PLACES = ("", "environment_configurations/*/")
# Folders that carry a layout's name and not the scenario's.
_CONFIGURATIONS = "environment_configurations"


def import_gaden(
    path: Path, *, wind: Path | None = None, period_s: float | None = None, is_looping: bool = True
) -> Environment:
    """Return a room of GADEN with its wind.

    Args:
        path: A scenario's folder, one of its configurations, or the `OccupancyGrid3D.csv`.
        wind: The wind, see `load_wind`; by default what lies in the folders that GADEN uses.
        period_s: Seconds from frame to frame; 1 by default.
        is_looping: Whether the first frame comes after the last.

    Raises:
        EnvironmentDataError: there is no occupancy, or more than one; a file is damaged; the wind does not fit.

    Warns:
        NoWindWarning: there is no wind; the air is still.
        WindGapsWarning: see `load_wind`.
    """
    occupancy_path = _occupancy_path(path)
    room = load_gaden_geometry(occupancy_path)
    return load_geometry_with_wind(
        room, wind or _find_wind(occupancy_path.parent), period_s=period_s, is_looping=is_looping
    )


def load_gaden_geometry(path: Path) -> EnvironmentGeometry:
    """Return a room of GADEN without wind; see `import_gaden`."""
    occupancy_path = _occupancy_path(path)
    grid, occupancy = read_occupancy(occupancy_path)
    return geometry_from_grid(_name_of(occupancy_path), grid, occupancy)


def is_gaden(path: Path) -> bool:
    """Return whether a path is an `OccupancyGrid3D.csv` or a folder where one is found."""
    return bool(_occupancies(path))


def _occupancies(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix == ".csv" else []
    found = (sorted(path.glob(f"{place}{OCCUPANCY_FILE}")) for place in _OCCUPANCY_PLACES)
    return next((paths for paths in found if paths), [])


def _occupancy_path(path: Path) -> Path:
    found = _occupancies(path)
    if len(found) != 1:
        names = ", ".join(str(each.relative_to(path)) for each in found) or "none"
        raise data_error(path, f"one {OCCUPANCY_FILE} in the folder or its {_CONFIGURATIONS}", names)
    return found[0]


def _name_of(occupancy_path: Path) -> str:
    folder = occupancy_path.resolve().parent
    return folder.parent.parent.name if folder.parent.name == _CONFIGURATIONS else folder.name


def _find_wind(folder: Path) -> Path | None:
    for pattern in _WIND_FOLDERS:
        found = [path for path in sorted(folder.glob(pattern)) if path.is_dir() and _holds_files(path)]
        if len(found) > 1:
            names = ", ".join(str(path.relative_to(folder)) for path in found)
            raise data_error(folder, "one wind", names, remedy="Name the one to take.")
        if found:
            return found[0]
    return None


def _holds_files(folder: Path) -> bool:
    return any(path.is_file() for path in folder.iterdir())
