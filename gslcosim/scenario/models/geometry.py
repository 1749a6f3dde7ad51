"""Geometry of an environment: layouts that can be generated.

Layouts cover Tables 9.1 and 9.2 of the GSL-Bench thesis for warehouses, and the like for other rooms: `kind` is
env_type, `size_m` env_size, `inlet_size_m` and `outlet_size_m` inlet_size and outlet_size, `filled_least_frac`
emptyfullrackdiv, `walls` white_walls. inlet_vel, the cell of Table 9.3 and the times of Table 9.5 are in the scenario's
`wind`, the source of Table 9.6 in its `gas`; env_amount is `gslcosim environment generate --count`.
"""

from typing import Annotated, Any, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from gslcosim.base.box_rules import check_box, check_rectangle, check_velocity_of
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import Count, Fraction, Name, NonNegative, Positive, RoomEdge, Spec

DEFAULT_KIND = "warehouse_empty"


class BoxSpec(Spec):
    """A solid box in the room, corners in the world frame [m]."""

    name: Name = Field(description="name of the box")
    min_m: Vec3 = Field(description="lower corner")
    max_m: Vec3 = Field(description="upper corner")

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_box(self.min_m, self.max_m)
        return self


class DoorSpec(BoxSpec):
    """A box that events remove and restore: solid while closed, absent while open."""

    is_open: bool = Field(default=False, description="open at the start")


class OpeningSpec(Spec):
    """An inlet or outlet: a rectangle on the boundary of the room, as a flat box [m]."""

    min_m: Vec3 = Field(description="lower corner")
    max_m: Vec3 = Field(description="upper corner, equal to the lower one along one axis")

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_rectangle(self.min_m, self.max_m)
        return self


class FurtherOpeningSpec(OpeningSpec):
    """An opening in addition to the inlet and outlet of the layout.

    `velocity_m_s` is the wind of an inlet; a vector that points outwards makes a fan that draws air out. `open` is an
    open boundary to the outdoors.
    """

    name: Name = Field(description="name of the opening")
    kind: Literal["inlet", "outlet", "open"] = Field(
        description="role of the opening: inlet, outlet, or open boundary to the outdoors"
    )
    velocity_m_s: Vec3 | None = Field(default=None, description="wind of an inlet (absent: wind of the scenario)")

    @model_validator(mode="after")
    def _check_velocity(self) -> Self:
        check_velocity_of(self.kind, self.velocity_m_s)
        return self


class RoomSpec(Spec):
    """Base of all layouts. Sizes [m]; `seed` determines all random parts.

    `inlet` and `outlet` are rectangles anywhere on the boundary; without them the openings are those of the layout, in
    warehouses and houses `inlet_size_m` and `outlet_size_m` (along y, and high) in the near and far corner. `openings`
    are further ones. `obstacles` are added to the layout's furniture. `lights` is the number of lamps along x and y
    below the ceiling, by default one for about every 6 m.
    """

    kind: str = Field(description="layout")
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = Field(description="inner size along x, y and z")
    seed: Annotated[int, Field(ge=0)] = Field(default=1, description="seed of all random parts of the room")
    wall_m: Positive = Field(default=0.2, description="thickness of the outer walls")
    inlet: OpeningSpec | None = Field(default=None, description="inlet (absent: inlet of the layout)")
    outlet: OpeningSpec | None = Field(default=None, description="outlet (absent: outlet of the layout)")
    obstacles: tuple[BoxSpec, ...] = Field(default=(), description="additional boxes")
    inlet_size_m: tuple[Positive, Positive] | None = Field(
        default=None, description="width and height of the inlet of the layout"
    )
    outlet_size_m: tuple[Positive, Positive] | None = Field(
        default=None, description="width and height of the outlet of the layout"
    )
    walls: Literal["white", "white_yellow"] = Field(default="white", description="colours of the walls")
    openings: tuple[FurtherOpeningSpec, ...] = Field(default=(), description="additional openings")
    lights: tuple[Count, Count] | None = Field(
        default=None, description="number of lamps along x and y (absent: about one per 6 m)"
    )

    @model_validator(mode="after")
    def _check_openings(self) -> Self:
        for key in ("inlet", "outlet"):
            if getattr(self, key) is not None and getattr(self, f"{key}_size_m") is not None:
                raise broken_rule_error(
                    key=f"{key}_size_m",
                    expected=f"no size beside {key}, which has its own",
                    found="both",
                    remedy=f"Leave out {key}_size_m, or {key} to have it in its usual place.",
                )
        return self


class LayoutSpec(RoomSpec):
    """An empty warehouse, as in environments 1 and 2 of GSL-Bench."""

    kind: Literal["warehouse_empty"] = DEFAULT_KIND  # pyright: ignore[reportIncompatibleVariableOverride]
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (15.0, 15.0, 8.0)


class RacksSpec(RoomSpec):
    """Racks in rows along y; `rack_size_m` is across, along, and high.

    `filled_least_frac` of the racks are filled at least, with one of seven loads; the others are filled or empty by
    lot. `rack_aisle_m` is the least width between rows; `end_aisle_m` between the ends of rows and the wall, by
    default the wider opening and 2 m. Racks stand on each other as high as the room allows.
    """

    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (15.0, 15.0, 8.0)
    filled_least_frac: Fraction = Field(default=0.2, description="minimum fill fraction of a rack")
    rack_size_m: tuple[Positive, Positive, Positive] = Field(
        default=(1.0, 4.0, 3.0), description="width, length and height of a rack"
    )
    rack_aisle_m: Positive = Field(default=3.0, description="minimum width of an aisle")
    end_aisle_m: Positive | None = Field(
        default=None, description="width between the ends of rows and the wall (absent: the wider opening plus 2 m)"
    )


class SimpleWarehouseSpec(RacksSpec):
    """A warehouse with rows of racks, as in environments 3 and 4 of GSL-Bench."""

    kind: Literal["warehouse_simple"] = "warehouse_simple"  # pyright: ignore


class ComplexWarehouseSpec(RacksSpec):
    """A warehouse whose inner rows are turned, with items in its end aisles, as in environments 5 and 6 of GSL-Bench.

    `side_aisle_m` is the least width between the turned rows' ends and the rows at the walls. Forklifts, piles of goods
    and pallets stand turned by any angle; those for which there is no place are left out.
    """

    kind: Literal["warehouse_complex"] = "warehouse_complex"  # pyright: ignore
    side_aisle_m: Positive = Field(
        default=1.6, description="minimum width between the ends of turned rows and the rows at the walls"
    )
    n_forklifts: Count = Field(default=1, description="number of forklifts, fewer if they do not fit")
    n_piles: Count = Field(default=5, description="number of piles of goods, fewer if they do not fit")
    n_pallets: Count = Field(default=3, description="number of pallets, fewer if they do not fit")


class OfficeSpec(RoomSpec):
    """Rooms on both sides of a corridor along x, with doors and desks.

    `rooms_per_side` rooms lie on each side; `outline: l_shape` takes away the rooms of the upper right.
    """

    kind: Literal["office"] = "office"  # pyright: ignore
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (16.0, 12.0, 3.0)
    rooms_per_side: Annotated[int, Field(ge=1, le=20)] = Field(
        default=4, description="number of rooms on each side of the corridor"
    )
    corridor_m: Positive = Field(default=2.0, description="width of the corridor")
    door_m: tuple[Positive, Positive] = Field(default=(1.0, 2.0), description="width and height of doors")
    partition_m: Positive = Field(default=0.2, description="thickness of inner walls")
    outline: Literal["rectangle", "l_shape"] = Field(
        default="rectangle", description="shape of the floor plan; l_shape removes the upper right rooms"
    )
    has_furniture: bool = Field(default=True, description="add desks")


class HomeSpec(RoomSpec):
    """A flat: a box divided into `n_rooms` rooms that are at least `least_room_m` wide, with doors and furniture.

    If there is no place for another room, there are fewer.
    """

    kind: Literal["home"] = "home"  # pyright: ignore
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (10.0, 8.0, 2.6)
    n_rooms: Annotated[int, Field(ge=1, le=30)] = Field(
        default=5, description="number of rooms, fewer if they do not fit"
    )
    least_room_m: Positive = Field(default=2.4, description="minimum width of a room")
    door_m: tuple[Positive, Positive] = Field(default=(1.0, 2.0), description="width and height of doors")
    partition_m: Positive = Field(default=0.2, description="thickness of inner walls")
    has_furniture: bool = Field(default=True, description="add furniture")


class ClutteredRoomsSpec(RoomSpec):
    """Random walls with passages, in the manner of the first AutoGDM, and clutter.

    The box is divided into `n_rooms` along x and y; passages as high as the room join all rooms, and
    `extra_passage_frac` of the other walls have one too. `n_clutter` boxes stand about.
    """

    kind: Literal["cluttered_rooms"] = "cluttered_rooms"  # pyright: ignore
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (10.0, 10.0, 3.0)
    n_rooms: tuple[Annotated[int, Field(ge=1, le=20)], Annotated[int, Field(ge=1, le=20)]] = Field(
        default=(3, 3), description="number of rooms along x and y"
    )
    passage_m: Positive = Field(default=1.4, description="width of passages")
    partition_m: Positive = Field(default=0.2, description="thickness of inner walls")
    extra_passage_frac: Fraction = Field(
        default=0.3, description="fraction of the other walls that also have a passage"
    )
    n_clutter: Count = Field(default=6, description="number of boxes that stand in the rooms")


class PlantSpec(RoomSpec):
    """Tanks and buildings outdoors; the wind comes in through x = 0 and goes out through the other sides and the top.

    The inlet's wind grows with the logarithm of the height over `roughness_m` and is `wind.inlet_velocity_m_s` at
    `reference_height_m`.
    """

    kind: Literal["plant"] = "plant"  # pyright: ignore
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (24.0, 18.0, 8.0)
    n_tanks: Count = Field(default=4, description="number of tanks")
    n_buildings: Count = Field(default=2, description="number of buildings")
    roughness_m: Positive = Field(default=0.03, description="roughness length of the ground")
    reference_height_m: Positive = Field(default=10.0, description="reference height of `wind.inlet_velocity_m_s`")


class WindTunnelSpec(RoomSpec):
    """A channel open at both ends, with `n_blocks` blocks in a row across its floor's middle line."""

    kind: Literal["wind_tunnel"] = "wind_tunnel"  # pyright: ignore
    size_m: tuple[RoomEdge, RoomEdge, RoomEdge] = (8.0, 2.0, 2.0)
    n_blocks: Count = Field(default=0, description="number of blocks in a row across the middle line")
    block_m: Positive = Field(default=0.4, description="edge length of a block")
    gap_m: NonNegative = Field(default=1.2, description="gap between blocks")


def _kind_of(value: Any) -> str | None:
    if isinstance(value, RoomSpec):
        return value.kind
    kind = cast("dict[str, Any]", value).get("kind", DEFAULT_KIND) if isinstance(value, dict) else None
    return kind if isinstance(kind, str) else None


# Selected by `kind`; an empty warehouse by default.
Layout = Annotated[
    Annotated[LayoutSpec, Tag("warehouse_empty")]
    | Annotated[SimpleWarehouseSpec, Tag("warehouse_simple")]
    | Annotated[ComplexWarehouseSpec, Tag("warehouse_complex")]
    | Annotated[OfficeSpec, Tag("office")]
    | Annotated[HomeSpec, Tag("home")]
    | Annotated[ClutteredRoomsSpec, Tag("cluttered_rooms")]
    | Annotated[PlantSpec, Tag("plant")]
    | Annotated[WindTunnelSpec, Tag("wind_tunnel")],
    Discriminator(_kind_of),
]
