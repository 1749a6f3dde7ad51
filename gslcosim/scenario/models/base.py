"""Base of all parts of a scenario: frozen, kinds of numbers and names, and rules between fields."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints
from pydantic_core import PydanticCustomError

from gslcosim.base.quantities import Vec3

RULE = "scenario_rule"


def broken_rule_error(*, expected: str, found: str, remedy: str = "", key: str = "") -> PydanticCustomError:
    """Return what a model's own validator raises: a rule between the fields of a block that does not hold.

    `key` names the field inside the block that is to be changed; empty for the block as a whole.
    """
    return PydanticCustomError(
        RULE,
        "expected {expected}, was {found}. {remedy}",
        {"expected": expected, "found": found, "remedy": remedy, "key": key},
    )


Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Positive = Annotated[float, Field(gt=0)]
RoomEdge = Annotated[float, Field(gt=0, le=10_000)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=1000)]


class Spec(BaseModel):
    """Base of all parts of a scenario: frozen, unknown keys are errors, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def format_point(numbers: Vec3) -> str:
    """Return three numbers as a scenario file has them."""
    return f"[{', '.join(f'{number:g}' for number in numbers)}]"
