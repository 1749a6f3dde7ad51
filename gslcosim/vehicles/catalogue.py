"""The catalogue: every vehicle by name, gslcosim's own and those of installed packages."""

from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from gslcosim.errors import VehicleError
from gslcosim.offers import OfferError, Offers
from gslcosim.vehicles.facts import Vehicle
from gslcosim.vehicles.vehicle_folder import PARAMETERS_FILE, read_vehicle

# Third parties add theirs under this name; each entry point is a folder's path, or a module in the folder.
VEHICLE_ENTRY_POINTS = "gslcosim.vehicles"
_OFFERS = Offers(group=VEHICLE_ENTRY_POINTS, what="vehicle")
VEHICLES_DIR = Path(__file__).parent


@cache
def vehicle_names() -> tuple[str, ...]:
    """Return the names of all vehicles: gslcosim's, which are the folders beside this file, then those of packages."""
    own = _own_names()
    return (*own, *sorted({*_OFFERS.names()} - set(own)))


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
    if name not in _OFFERS.names():
        raise VehicleError(f"vehicle: expected one of {', '.join(vehicle_names())}, was {name!r}.")
    try:
        folder = _OFFERS.loaded(name, _folder_of, "a folder's path, or a module in the folder")
    except OfferError as error:
        raise VehicleError(f"vehicle {name}: {error}") from error
    return read_vehicle(name, folder)


def _folder_of(offered: object) -> Path | None:
    folder = _path_of(offered)
    return folder.resolve() if folder is not None and folder.is_dir() else None


def _path_of(offered: Any) -> Path | None:
    if isinstance(offered, ModuleType):
        # A package without __init__.py has no file, but a place.
        file = getattr(offered, "__file__", None)
        places = [str(Path(file).parent)] if file else list(getattr(offered, "__path__", ()))
        return Path(places[0]) if places else None
    return Path(offered) if isinstance(offered, str | Path) else None
