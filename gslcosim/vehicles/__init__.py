"""Vehicles: a folder each with an MJCF body and its facts, every number with its origin, and the catalogue of them."""

from gslcosim.vehicles.catalogue import VEHICLE_ENTRY_POINTS as VEHICLE_ENTRY_POINTS
from gslcosim.vehicles.catalogue import is_vehicle as is_vehicle
from gslcosim.vehicles.catalogue import vehicle_names as vehicle_names
from gslcosim.vehicles.catalogue import vehicle_of as vehicle_of
from gslcosim.vehicles.facts import Vehicle as Vehicle
