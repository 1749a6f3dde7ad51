"""The catalogue: every vehicle by name, gslcosim's own and those of installed packages."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from gslcosim.errors import VehicleError
from gslcosim.vehicles.facts import Vehicle
from gslcosim.vehicles.vehicle_folder import PARAMETERS_FILE, read_vehicle

# Third parties add theirs under this name; each entry point is a folder's path, or a module in the folder.
VEHICLE_ENTRY_POINTS = "gslcosim.vehicles"
VEHICLES_DIR = Path(__file__).parent


@cache
def vehicle_names() -> tuple[str, ...]:
    """Return the names of all vehicles: gslcosim's, which are the folders beside this file, then those of packages."""
    own = _own_names()
    return (*own, *sorted(entry_points(group=VEHICLE_ENTRY_POINTS).names - set(own)))


def is_vehicle(name: str) -> bool:
    """Return whether there is a vehicle of a name."""
    return name in _own_names() or name in vehicle_names()


def vehicle_of(name: str) -> Vehicle:
    """Return the facts of a vehicle.

    A package offers a vehicle by an entry point of the group `gslcosim.vehicles`; it is imported here, when somebody
    asks for the vehicle, and not before. gslcosim's own vehicles cannot be replaced.

    Raises:
        VehicleError: there is none, or its folder is not what it should be.
    """
    if name in _own_names():
        return read_vehicle(name, VEHICLES_DIR / name)
    return _offered(name)


@cache
def _own_names() -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in VEHICLES_DIR.glob(f"*/{PARAMETERS_FILE}")))


@cache
def _offered(name: str) -> Vehicle:
    points = list(entry_points(group=VEHICLE_ENTRY_POINTS, name=name))
    if not points:
        raise VehicleError(f"vehicle: expected one of {', '.join(vehicle_names())}, was {name!r}.")
    offers = sorted({point.value for point in points})
    if len(offers) > 1:
        raise VehicleError(f"vehicle {name}: expected one package that offers it, was {' and '.join(offers)}.")
    return read_vehicle(name, _folder_of(name, points[0]))


def _folder_of(name: str, point: EntryPoint) -> Path:
    try:
        offered = point.load()
    # A package of somebody else may raise anything when it is imported.
    except Exception as error:
        raise VehicleError(f"vehicle {name}: expected {point.value} to be imported, was {error!r}.") from error
    folder = _path_of(offered)
    if folder is None or not folder.is_dir():
        raise VehicleError(
            f"vehicle {name}: expected {point.value} to be a folder's path, or a module in the folder, was {offered!r}."
        )
    return folder.resolve()


def _path_of(offered: Any) -> Path | None:
    if isinstance(offered, ModuleType):
        # A package without __init__.py has no file, but a place.
        file = getattr(offered, "__file__", None)
        places = [str(Path(file).parent)] if file else list(getattr(offered, "__path__", ()))
        return Path(places[0]) if places else None
    return Path(offered) if isinstance(offered, str | Path) else None
