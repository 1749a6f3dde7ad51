"""Geometry of one's own: files, their placement, and where the air passes."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import Name, Positive, Spec, broken_rule_error
from gslcosim.scenario.models.extents import check_box, check_box_or_rectangle, check_velocity_of


class ExtentSpec(Spec):
    """A box by two opposite corners, world frame [m]; it may be flat along one axis where it stands for a surface."""

    min_m: Vec3 = Field(description="its lower corner")
    max_m: Vec3 = Field(description="its upper corner")

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_box_or_rectangle(self.min_m, self.max_m)
        return self


class BoundsSpec(Spec):
    """The box of air to keep, world frame [m]; its sides are walls where no opening is."""

    min_m: Vec3 = Field(description="its lower corner")
    max_m: Vec3 = Field(description="its upper corner")

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_box(self.min_m, self.max_m)
        return self


class GeometryOpeningSpec(Spec):
    """Opening of a geometry where air comes in or goes out: a `box` around it, or a `surface` of the files by its name.

    A surface is a mesh, group, material, node, solid or geom. `kind: open` is a side where the outdoors go
    on. `velocity_m_s` is an inlet's; without it the wind of `wind.inlet_velocity_m_s`, straight inwards.
    """

    name: Name = Field(description="what the opening is called")
    kind: Literal["inlet", "outlet", "open"] = Field(
        description="whether air comes in, goes out, or the outdoors go on"
    )
    box: ExtentSpec | None = Field(default=None, description="a box around it")
    surface: str | None = Field(default=None, description="its name in the files")
    velocity_m_s: Vec3 | None = Field(
        default=None, description="wind of an inlet (absent: that of `wind.inlet_velocity_m_s`, straight inwards)"
    )

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        if (self.box is None) == (self.surface is None):
            raise broken_rule_error(
                expected="exactly one of box and surface",
                found="neither" if self.box is None else "both",
                remedy="box gives the place in metres, surface names a part of the files.",
            )
        check_velocity_of(self.kind, self.velocity_m_s)
        return self


class GeometrySpec(Spec):
    """A room from files of geometry: STL, OBJ, glTF (.gltf or .glb) or MJCF (.xml), relative to the scenario's folder.

    `scale` turns their unit into metres: 0.001 for millimetres. `up` is the axis that points up in the files, by
    default y in glTF, as its standard says, and z in the others. `translate_m` is added last. Surfaces whose names
    begin with inlet or outlet are openings without being listed in `openings`.

    `free_point_m` is a point known to be air; by default it is sought beside the first inlet, then beside the other
    openings, then in the middle. Without `bounds_m` the geometry has to close the air in, except at openings.
    """

    files: Annotated[tuple[str, ...], Field(min_length=1)] = Field(
        description="STL, OBJ, glTF or MJCF, relative to the scenario's folder"
    )
    scale: Positive = Field(default=1.0, description="turns the unit of the files into metres")
    up: Literal["y", "z"] | None = Field(
        default=None, description="axis that points up in the files (absent: y in glTF, z in the others)"
    )
    translate_m: Vec3 = Field(default=(0.0, 0.0, 0.0), description="is added to the scaled and turned geometry")
    free_point_m: Vec3 | None = Field(default=None, description="a point known to be air (absent: it is sought)")
    bounds_m: BoundsSpec | None = Field(
        default=None, description="the air to keep (absent: what the geometry closes in)"
    )
    openings: tuple[GeometryOpeningSpec, ...] = Field(default=(), description="where air comes in or goes out")

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        names = [opening.name for opening in self.openings]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise broken_rule_error(
                key="openings",
                expected="openings with different names",
                found=f"{doubled[0]} {names.count(doubled[0])} times",
                remedy="Give each its own name.",
            )
        return self
