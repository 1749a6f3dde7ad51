"""What all parts of a scenario are made of: the frozen base and the kinds of numbers and names."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from gslcosim.quantities import Vec3

Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Positive = Annotated[float, Field(gt=0)]
RoomEdge = Annotated[float, Field(gt=0, le=10_000)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=1000)]


class Spec(BaseModel):
    """Base of all parts of a scenario: frozen, unknown keys are errors, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def shown(numbers: Vec3) -> str:
    """Return three numbers as a scenario file has them."""
    return f"[{', '.join(f'{number:g}' for number in numbers)}]"
