"""What stands in a room, and where its openings are, by the kind of its layout."""

from gslcosim.environment.layouts.buildings import cluttered_rooms_of, home_of, l_shape_from_m, office_of
from gslcosim.environment.layouts.outdoors import plant_of, whole_face, wind_tunnel_of
from gslcosim.environment.layouts.warehouses import items_of, racks_of
from gslcosim.environment.model import Box
from gslcosim.environment.openings import default_inlet, default_outlet
from gslcosim.scenario.models.layouts import (
    ClutteredRoomsSpec,
    ComplexWarehouseSpec,
    HomeSpec,
    Layout,
    OfficeSpec,
    OpeningSpec,
    PlantSpec,
    SimpleWarehouseSpec,
    WindTunnelSpec,
)


def furniture_of(layout: Layout) -> tuple[Box, ...]:
    """Return all solids that a layout puts into its room; what the scenario adds as `obstacles` is not among them."""
    match layout:
        case SimpleWarehouseSpec():
            return racks_of(layout, opening_specs(layout))
        case ComplexWarehouseSpec():
            openings = opening_specs(layout)
            return racks_of(layout, openings) + items_of(layout, openings)
        case OfficeSpec():
            return office_of(layout)
        case HomeSpec():
            return home_of(layout)
        case ClutteredRoomsSpec():
            return cluttered_rooms_of(layout)
        case PlantSpec():
            return plant_of(layout)
        case WindTunnelSpec():
            return wind_tunnel_of(layout)
        case _:
            return ()


def opening_specs(layout: Layout) -> tuple[OpeningSpec, OpeningSpec]:
    """Return the inlet and the outlet that the scenario asks for, or those that are usual for the layout."""
    size_m = layout.size_m
    if isinstance(layout, PlantSpec | WindTunnelSpec):
        inlet, outlet = whole_face(size_m, 0, is_upper=False), whole_face(size_m, 0, is_upper=True)
    else:
        inlet, outlet = default_inlet(size_m, layout.inlet_size_m), default_outlet(size_m, layout.outlet_size_m)
        if isinstance(layout, OfficeSpec) and l_shape_from_m(layout) < size_m[0]:
            # The far corner is not part of the office: the air leaves at the corridor's end.
            outlet = _centred_on_y(outlet, min(outlet.max_m[1] - outlet.min_m[1], layout.corridor_m), size_m[1] / 2)
    return layout.inlet or inlet, layout.outlet or outlet


def _centred_on_y(opening: OpeningSpec, width_m: float, y_m: float) -> OpeningSpec:
    (x0, _, z0), (x1, _, z1) = opening.min_m, opening.max_m
    return OpeningSpec(min_m=(x0, y_m - width_m / 2, z0), max_m=(x1, y_m + width_m / 2, z1))
