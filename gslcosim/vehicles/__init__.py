"""Vehicles: a folder each with an MJCF body and parameters with their origins, and the catalogue of them."""

from gslcosim.vehicles.catalogue import VEHICLE_ENTRY_POINTS as VEHICLE_ENTRY_POINTS
from gslcosim.vehicles.catalogue import Vehicle as Vehicle
from gslcosim.vehicles.catalogue import get_vehicle as get_vehicle
from gslcosim.vehicles.catalogue import is_vehicle as is_vehicle
from gslcosim.vehicles.catalogue import list_vehicle_names as list_vehicle_names
