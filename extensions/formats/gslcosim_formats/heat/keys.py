"""Keys `environment.heat` and `environment.air_c`: warm and cold bodies and surfaces, and the air they are warm in."""

from typing import Annotated, Literal, Optional, Self

from pydantic import Field, model_validator

from gslcosim.base.box_rules import build_corner_error, format_point, measure_sides_m
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.base.scenario_keys import ENVIRONMENT, ScenarioKey
from gslcosim.base.spec import Spec

AIR_C = 20.0
_CELSIUS = Field(ge=-80.0, le=1000.0)
AIR = ScenarioKey[float | None](
    place=ENVIRONMENT,
    name="air_c",
    annotation=Optional[Annotated[float, Field(ge=-80, le=80)]],  # noqa: UP045
    description="with `heat`: temperature of the air at the start and where it enters, in degrees Celsius (absent: 20)",
)


class HeatSpec(Spec):
    """A warm or cold body or surface of a room whose wind the built-in solver makes: it drives the wind.

    - `body`: a person, a lamp or a machine, smaller than a cell, with `position_m` and `power_w`.
    - `pane`, `radiator`: an upright rectangle; `floor`: a level one, the whole floor without corners.
    - `sun`: a patch of sunlight, with `power_w`.
    - `surface`: any rectangle on a wall, the floor, the ceiling or an obstacle.

    `power_w` is what the air takes up, without radiation. A surface with `temperature_c` exchanges heat by natural
    convection, or by the wind along it where that is stronger. Other walls let no heat through.
    """

    kind: Literal["body", "pane", "radiator", "floor", "sun", "surface"] = Field(description="what is warm or cold")
    position_m: Vec3 | None = Field(default=None, description="position of a body in the world")
    min_m: Vec3 | None = Field(default=None, description="lower corner of a surface in the world")
    max_m: Vec3 | None = Field(default=None, description="upper corner, equal to the lower one along one axis")
    power_w: float | None = Field(default=None, description="heat that the air takes up; below 0: that it loses")
    temperature_c: Annotated[float, _CELSIUS] | None = Field(
        default=None, description="temperature of a surface, in degrees Celsius"
    )

    @model_validator(mode="after")
    def _check_strength(self) -> Self:
        found = [key for key in ("power_w", "temperature_c") if getattr(self, key) is not None]
        if len(found) != 1 or self.power_w == 0:
            raise broken_rule_error(
                expected="exactly one of power_w, other than 0, and temperature_c",
                found="power_w: 0" if len(found) == 1 else " and ".join(found) or "neither",
                remedy="For example power_w: 100.",
            )
        if self.kind in ("body", "sun") and self.power_w is None:
            raise broken_rule_error(
                key="temperature_c",
                expected=f"power_w with kind: {self.kind}",
                found="temperature_c",
                remedy="A surface has a temperature: kind: surface.",
            )
        return self

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        given = [key for key in ("position_m", "min_m", "max_m") if getattr(self, key) is not None]
        wanted = ["position_m"] if self.kind == "body" else ["min_m", "max_m"]
        if given != wanted and not (self.kind == "floor" and not given):
            raise broken_rule_error(
                expected=f"{' and '.join(wanted)} with kind: {self.kind}, and no other place",
                found=" and ".join(given) or "none",
                remedy="A body has a position, a surface has two corners.",
            )
        if self.min_m is None or self.max_m is None:
            return self
        sides_m = measure_sides_m(self.min_m, self.max_m)
        if min(sides_m) != 0 or sides_m.count(0) != 1:
            raise build_corner_error(
                self.max_m,
                f"one number equal to that of min_m, {format_point(self.min_m)}, and two greater",
                "A warm surface is a rectangle on a wall, the floor, the ceiling or an obstacle.",
            )
        is_level, wants_level = sides_m[2] == 0, self.kind == "floor"
        if is_level != wants_level and self.kind in ("pane", "radiator", "floor"):
            raise build_corner_error(
                self.max_m,
                f"{'a level' if wants_level else 'an upright'} rectangle with kind: {self.kind}",
                "kind: surface may be either.",
            )
        return self


HEAT = ScenarioKey[tuple[HeatSpec, ...] | None](
    place=ENVIRONMENT,
    name="heat",
    annotation=Optional[Annotated[tuple[HeatSpec, ...], Field(min_length=1)]],  # noqa: UP045
    description="warm and cold bodies and surfaces that drive the wind of the built-in solver (absent: none)",
    block=HeatSpec,
)
