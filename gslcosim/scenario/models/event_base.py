"""What all events of a scenario have: when they happen, at a time or upon a condition."""

from typing import ClassVar, Self

from pydantic import Field, model_validator

from gslcosim.quantities import Vec3
from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Name, NonNegative, Positive, Spec, shown


class TriggerSpec(Spec):
    """A condition on the truth about one agent's vehicle; it counts when it holds for the first time.

    With `gas_above_ppm`, any sensor of the vehicle is in more than that of the gas that is searched for; with
    `within_m`, the vehicle is at most that far from `of_m`. The event follows `delay_s` after it, in the next tick at
    the earliest.
    """

    agent: Name = Field(description="whose vehicle")
    gas_above_ppm: Positive | None = Field(
        default=None, description="true mixing ratio at any of its sensors that has to be exceeded"
    )
    within_m: Positive | None = Field(default=None, description="distance to `of_m` that has to be reached")
    of_m: Vec3 | None = Field(default=None, description="the place in the world that `within_m` is measured from")
    delay_s: NonNegative = Field(default=0.0, description="time from there until the event")

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        given = [key for key in ("gas_above_ppm", "within_m") if getattr(self, key) is not None]
        if len(given) != 1:
            raise broken_rule(
                expected="exactly one of gas_above_ppm and within_m",
                found=" and ".join(given) or "none",
                remedy="For example when: {agent: beetle, gas_above_ppm: 1}.",
            )
        if (self.within_m is None) != (self.of_m is None):
            raise broken_rule(
                key="of_m",
                expected="a place beside within_m, and none without it",
                found="one" if self.of_m else "none",
                remedy="For example when: {agent: beetle, within_m: 1, of_m: [2, 3, 1]}.",
            )
        return self

    @property
    def text(self) -> str:
        """The condition in words."""
        what = (
            f"{self.agent} is in more than {self.gas_above_ppm:g} ppm"
            if self.gas_above_ppm is not None
            else f"{self.agent} is within {self.within_m:g} m of {shown(self.of_m or (0.0, 0.0, 0.0))} m"
        )
        return f"{self.delay_s:g} s after {what}" if self.delay_s else f"once {what}"


class EventSpec(Spec):
    """Something that happens during a run: at a time, or once a condition holds; each event happens at most once."""

    what: str = Field(description="what happens")
    at_s: Positive | None = Field(default=None, description="simulated time at which it happens")
    when: TriggerSpec | None = Field(default=None, description="condition upon which it happens, in place of `at_s`")

    drives_wind: ClassVar[bool] = False

    @model_validator(mode="after")
    def _check_one_time(self) -> Self:
        if (self.at_s is None) == (self.when is None):
            raise broken_rule(
                expected="exactly one of at_s and when",
                found="none" if self.at_s is None else "both",
                remedy="For example at_s: 30.",
            )
        return self

    @property
    def about_agent(self) -> str | None:
        """The agent that it happens to, if it happens to one."""
        return None

    @property
    def text(self) -> str:
        """What happens, in words."""
        raise NotImplementedError
