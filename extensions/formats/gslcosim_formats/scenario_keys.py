"""Keys that this package adds to `environment` in scenarios, and the places that name its files and folders."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from gslcosim.base.box_rules import build_corner_error, check_box, check_velocity_of, format_point, measure_sides_m
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import ENVIRONMENT, InputPath, ScenarioKey
from gslcosim.base.spec import Name, Positive, Spec
from gslcosim_formats.heat.keys import AIR, HEAT

GSL_BENCH, GADEN = (
    ScenarioKey[str | None](
        place=ENVIRONMENT,
        name=name,
        annotation=str | None,
        description=description,
        after=after,
        inputs=(InputPath(place=f"{ENVIRONMENT}.{name}", expected="the folder of an environment", kind="folder"),),
    )
    for name, after, description in (
        ("gsl_bench", "path", "folder of a GSL-Bench or AutoGDM+ environment"),
        ("gaden", "gsl_bench", "folder of a GADEN environment, with its OccupancyGrid3D.csv"),
    )
)


def _check_box_or_rectangle(min_m: Vec3, max_m: Vec3) -> None:
    """Raise what a validator raises for corners of no box; it may be flat along one axis."""
    sides_m = measure_sides_m(min_m, max_m)
    if min(sides_m) < 0 or sides_m.count(0) > 1:
        raise build_corner_error(
            max_m,
            f"two numbers greater than those of min_m, {format_point(min_m)}, and none smaller",
            "min_m and max_m are opposite corners of a box or rectangle.",
        )


class ExtentSpec(Spec):
    """A box by two opposite corners, world frame [m]; a box around a surface may be flat along one axis."""

    min_m: Vec3 = Field(description="lower corner")
    max_m: Vec3 = Field(description="upper corner")

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        _check_box_or_rectangle(self.min_m, self.max_m)
        return self


class BoundsSpec(Spec):
    """Box of air to keep, world frame [m]; its sides are walls except at openings."""

    min_m: Vec3 = Field(description="lower corner")
    max_m: Vec3 = Field(description="upper corner")

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        check_box(self.min_m, self.max_m)
        return self


class GeometryOpeningSpec(Spec):
    """An opening of a geometry: a `box` around it, or the name of a `surface` in the files.

    A surface is a mesh, group, material, node, solid or geom. `kind: open` is an open boundary to the outdoors.
    """

    name: Name = Field(description="name of the opening")
    kind: Literal["inlet", "outlet", "open"] = Field(
        description="role of the opening: inlet, outlet, or open boundary to the outdoors"
    )
    box: ExtentSpec | None = Field(default=None, description="box around the opening")
    surface: str | None = Field(default=None, description="name of the object in the files")
    velocity_m_s: Vec3 | None = Field(
        default=None, description="wind of an inlet (absent: `wind.inlet_velocity_m_s`, straight inwards)"
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
    """A room from geometry files: STL, OBJ, glTF (.gltf or .glb) or MJCF (.xml), relative to the scenario's folder.

    - Surfaces whose names begin with inlet or outlet are openings, even if `openings` does not list them.
    - `scale` is 0.001 for files in millimetres. gslcosim scales first, then rotates by `up`, then adds `translate_m`.
    - Without `free_point_m`, gslcosim looks for air beside the first inlet, then the other openings, then the middle.
    - Without `bounds_m`, the geometry must enclose the air, except at openings.
    """

    files: Annotated[tuple[str, ...], Field(min_length=1)] = Field(
        description="STL, OBJ, glTF or MJCF, relative to the scenario's folder"
    )
    scale: Positive = Field(default=1.0, description="factor from the unit of the files to metres")
    up: Literal["y", "z"] | None = Field(
        default=None, description="axis that points up in the files (absent: y in glTF, z in the others)"
    )
    translate_m: Vec3 = Field(default=(0.0, 0.0, 0.0), description="offset of the scaled and rotated geometry")
    free_point_m: Vec3 | None = Field(default=None, description="a point in the air (absent: found automatically)")
    bounds_m: BoundsSpec | None = Field(
        default=None, description="region of air to keep (absent: the air that the geometry encloses)"
    )
    openings: tuple[GeometryOpeningSpec, ...] = Field(default=(), description="openings of the room")

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


GEOMETRY = ScenarioKey[GeometrySpec | None](
    place=ENVIRONMENT,
    name="geometry",
    annotation=GeometrySpec | None,
    description="room from geometry files",
    block=GeometrySpec,
    after="gaden",
    inputs=(InputPath(place="environment.geometry.files[]", expected="a file of geometry", kind="file"),),
)
KEYS: tuple[ScenarioKey[Any] | InputPath, ...] = (
    GSL_BENCH,
    GADEN,
    GEOMETRY,
    HEAT,
    AIR,
    # A series of files is named by its common beginning.
    InputPath(place="wind.solver.file", expected="a file or folder with wind", kind="series"),
    InputPath(place="gas.playback.folder", expected="a folder of gas frames, or a movie", kind="file or folder"),
)
