"""The frozen models of a scenario's wind: where it comes from, and how it is solved."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gslcosim.scenario.rules import broken_rule
from gslcosim.scenario.spec import NonNegative, Positive, Spec, Vec3


class WindSpec(Spec):
    """The air's motion. `uniform` is `inlet_velocity_m_s` everywhere; `built_in` solves the flow.

    The solve runs from still air to `end_time_s`; with `average_from_s` the time mean from there on is the steady
    wind, otherwise the last instant is.
    """

    solver: Literal["built_in", "uniform"] = "built_in"
    inlet_velocity_m_s: Vec3 = (1.0, 0.0, 0.0)
    cell_m: Positive = 0.2
    turbulence: Literal["k_epsilon", "smagorinsky", "laminar"] = "k_epsilon"
    courant: Annotated[float, Field(gt=0, le=1)] = 0.9
    end_time_s: Positive = 60.0
    average_from_s: NonNegative | None = 30.0

    @property
    def solves(self) -> bool:
        """Whether a flow is computed where the environment brings no wind of its own."""
        return self.solver == "built_in"

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.solves and self.average_from_s is not None and self.average_from_s >= self.end_time_s:
            is_default = "average_from_s" not in self.model_fields_set
            raise broken_rule(
                key="average_from_s",
                expected=f"less than end_time_s, {self.end_time_s:g}",
                found=f"{self.average_from_s:g}{' (the default)' if is_default else ''}",
                remedy=f"For example {self.end_time_s / 2:g}, or null for the wind at the end of the solve.",
            )
        return self
