"""The frozen models of layouts: what kinds of rooms can be generated, and what can be said of each.

They hold what Tables 9.1 and 9.2 of the GSL-Bench thesis have for warehouses, and the like for other rooms: `kind` is
env_type, `size_m` env_size, `inlet_size_m` and `outlet_size_m` inlet_size and outlet_size, `filled_least_frac`
emptyfullrackdiv, `walls` white_walls. inlet_vel, the cell of Table 9.3 and the times of Table 9.5 are in the
scenario's `wind`, the source of Table 9.6 in its `gas`; env_amount is `gslcosim generate --count`.
"""

from typing import Annotated, Any, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from gslcosim.quantities import Vec3
from gslcosim.scenario.models.extents import check_box, check_rectangle, check_velocity_of
from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Count, Fraction, Name, NonNegative, Positive, Spec

DEFAULT_KIND = "warehouse_empty"


class BoxSpec(Spec):
    """A solid box in the room, corners in the world frame [m]."""

    name: Name
    min_m: Vec3
    max_m: Vec3

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_box(self.min_m, self.max_m)
        return self


class OpeningSpec(Spec):
    """An inlet or outlet: a rectangle on the room's boundary, given as a flat box [m]."""

    min_m: Vec3
    max_m: Vec3

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_rectangle(self.min_m, self.max_m)
        return self


class FurtherOpeningSpec(OpeningSpec):
    """An opening beside the layout's own inlet and outlet.

    An inlet's wind is `velocity_m_s`, by default that of the scenario's wind; one that leaves the room is a fan that
    draws air out. `open` is a side where the outdoors go on.
    """

    name: Name
    kind: Literal["inlet", "outlet", "open"]
    velocity_m_s: Vec3 | None = None

    @model_validator(mode="after")
    def _check_velocity(self) -> Self:
        check_velocity_of(self.kind, self.velocity_m_s)
        return self


class RoomSpec(Spec):
    """What all layouts have. Sizes [m]; `seed` decides all that is drawn at random.

    `inlet` and `outlet` are rectangles anywhere on the boundary; without them the openings are where the layout has
    them, in warehouses and houses `inlet_size_m` and `outlet_size_m` (along y, and high) in the near and far corner.
    `openings` are further ones. `obstacles` are added to what the layout furnishes. `lights` is how many lamps hang
    along x and y below the ceiling, by default one for about every 6 m.
    """

    kind: str
    size_m: tuple[Positive, Positive, Positive]
    seed: Annotated[int, Field(ge=0)] = 1
    wall_m: Positive = 0.2
    inlet: OpeningSpec | None = None
    outlet: OpeningSpec | None = None
    obstacles: tuple[BoxSpec, ...] = ()
    inlet_size_m: tuple[Positive, Positive] | None = None
    outlet_size_m: tuple[Positive, Positive] | None = None
    walls: Literal["white", "white_yellow"] = "white"
    openings: tuple[FurtherOpeningSpec, ...] = ()
    lights: tuple[Count, Count] | None = None

    @model_validator(mode="after")
    def _check_openings(self) -> Self:
        for key in ("inlet", "outlet"):
            if getattr(self, key) is not None and getattr(self, f"{key}_size_m") is not None:
                raise broken_rule(
                    key=f"{key}_size_m",
                    expected=f"no size beside {key}, which has its own",
                    found="both",
                    remedy=f"Leave out {key}_size_m, or {key} to have it in its usual place.",
                )
        return self


class LayoutSpec(RoomSpec):
    """An empty warehouse, as in environments 1 and 2 of GSL-Bench."""

    kind: Literal["warehouse_empty"] = DEFAULT_KIND  # pyright: ignore[reportIncompatibleVariableOverride]
    size_m: tuple[Positive, Positive, Positive] = (15.0, 15.0, 8.0)


class RacksSpec(RoomSpec):
    """Racks in rows along y; `rack_size_m` is across, along, and high.

    `filled_least_frac` of the racks are filled at least, with one of seven loads; the others are filled or empty by
    lot. `rack_aisle_m` is the least width between rows; `end_aisle_m` between the ends of rows and the wall, by
    default the wider opening and 2 m. Racks stand on each other as high as the room allows.
    """

    size_m: tuple[Positive, Positive, Positive] = (15.0, 15.0, 8.0)
    filled_least_frac: Fraction = 0.2
    rack_size_m: tuple[Positive, Positive, Positive] = (1.0, 4.0, 3.0)
    rack_aisle_m: Positive = 3.0
    end_aisle_m: Positive | None = None


class SimpleWarehouseSpec(RacksSpec):
    """A warehouse with rows of racks, as in environments 3 and 4 of GSL-Bench."""

    kind: Literal["warehouse_simple"] = "warehouse_simple"  # pyright: ignore


class ComplexWarehouseSpec(RacksSpec):
    """A warehouse whose inner rows are turned, with items in its end aisles, as in environments 5 and 6 of GSL-Bench.

    `side_aisle_m` is the least width between the turned rows' ends and the rows at the walls. Forklifts, piles of goods
    and pallets stand turned by any angle; those for which there is no place are left out.
    """

    kind: Literal["warehouse_complex"] = "warehouse_complex"  # pyright: ignore
    side_aisle_m: Positive = 1.6
    n_forklifts: Count = 1
    n_piles: Count = 5
    n_pallets: Count = 3


class OfficeSpec(RoomSpec):
    """Rooms on both sides of a corridor along x, with doors and desks.

    `rooms_per_side` rooms lie on each side; `outline: l_shape` takes away the rooms of the upper right.
    """

    kind: Literal["office"] = "office"  # pyright: ignore
    size_m: tuple[Positive, Positive, Positive] = (16.0, 12.0, 3.0)
    rooms_per_side: Annotated[int, Field(ge=1, le=20)] = 4
    corridor_m: Positive = 2.0
    door_m: tuple[Positive, Positive] = (1.0, 2.0)
    partition_m: Positive = 0.2
    outline: Literal["rectangle", "l_shape"] = "rectangle"
    has_furniture: bool = True


class HomeSpec(RoomSpec):
    """A flat: a box divided into `n_rooms` rooms that are at least `least_room_m` wide, with doors and furniture.

    Where there is no place for another room there are fewer.
    """

    kind: Literal["home"] = "home"  # pyright: ignore
    size_m: tuple[Positive, Positive, Positive] = (10.0, 8.0, 2.6)
    n_rooms: Annotated[int, Field(ge=1, le=30)] = 5
    least_room_m: Positive = 2.4
    door_m: tuple[Positive, Positive] = (1.0, 2.0)
    partition_m: Positive = 0.2
    has_furniture: bool = True


class ClutteredRoomsSpec(RoomSpec):
    """Random walls with passages, in the manner of the first AutoGDM, and clutter.

    The box is divided into `n_rooms` along x and y; passages as high as the room join all rooms, and
    `extra_passage_frac` of the other walls have one too. `n_clutter` boxes stand about.
    """

    kind: Literal["cluttered_rooms"] = "cluttered_rooms"  # pyright: ignore
    size_m: tuple[Positive, Positive, Positive] = (10.0, 10.0, 3.0)
    n_rooms: tuple[Annotated[int, Field(ge=1, le=20)], Annotated[int, Field(ge=1, le=20)]] = (3, 3)
    passage_m: Positive = 1.4
    partition_m: Positive = 0.2
    extra_passage_frac: Fraction = 0.3
    n_clutter: Count = 6


class PlantSpec(RoomSpec):
    """Tanks and buildings outdoors; the wind comes in through x = 0 and goes out through the other sides and the top.

    The inlet's wind grows with the logarithm of the height over `roughness_m` and is `wind.inlet_velocity_m_s` at
    `reference_height_m`.
    """

    kind: Literal["plant"] = "plant"  # pyright: ignore
    size_m: tuple[Positive, Positive, Positive] = (24.0, 18.0, 8.0)
    n_tanks: Count = 4
    n_buildings: Count = 2
    roughness_m: Positive = 0.03
    reference_height_m: Positive = 10.0


class WindTunnelSpec(RoomSpec):
    """A channel open at both ends, with `n_blocks` blocks in a row across its floor's middle line."""

    kind: Literal["wind_tunnel"] = "wind_tunnel"  # pyright: ignore
    size_m: tuple[Positive, Positive, Positive] = (8.0, 2.0, 2.0)
    n_blocks: Count = 0
    block_m: Positive = 0.4
    gap_m: NonNegative = 1.2


def _kind_of(value: Any) -> str | None:
    if isinstance(value, RoomSpec):
        return value.kind
    kind = cast("dict[str, Any]", value).get("kind", DEFAULT_KIND) if isinstance(value, dict) else None
    return kind if isinstance(kind, str) else None


# Chosen by `kind`; a layout that does not say it is an empty warehouse.
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
