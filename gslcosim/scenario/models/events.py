"""Events of a scenario: a block for each thing that may happen, at a time or upon a condition."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, SerializeAsAny, model_validator

from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import Fraction, Name, NonNegative, OneOf, Positive, Spec, format_point


class TriggerSpec(Spec):
    """Condition on the true state of one agent's vehicle; it triggers the event the first time it holds.

    - `gas_above_ppm`: any sensor of the vehicle is in more than this mixing ratio of the gas to find.
    - `within_m`: the vehicle is at most this far from `of_m`.

    The event follows `delay_s` later, in the next tick at the earliest.
    """

    agent: Name = Field(description="agent of the vehicle")
    gas_above_ppm: Positive | None = Field(
        default=None, description="threshold of the true mixing ratio at any of its sensors"
    )
    within_m: Positive | None = Field(default=None, description="distance to `of_m` that triggers the event")
    of_m: Vec3 | None = Field(default=None, description="position in the world from which `within_m` is measured")
    delay_s: NonNegative = Field(default=0.0, description="delay from the trigger to the event")

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        given = [key for key in ("gas_above_ppm", "within_m") if getattr(self, key) is not None]
        if len(given) != 1:
            raise broken_rule_error(
                expected="exactly one of gas_above_ppm and within_m",
                found=" and ".join(given) or "none",
                remedy="For example when: {agent: beetle, gas_above_ppm: 1}.",
            )
        if (self.within_m is None) != (self.of_m is None):
            raise broken_rule_error(
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
            else f"{self.agent} is within {self.within_m:g} m of {format_point(self.of_m or (0.0, 0.0, 0.0))} m"
        )
        return f"{self.delay_s:g} s after {what}" if self.delay_s else f"once {what}"


class EventSpec(Spec):
    """Something that happens during a run: at a time, or once a condition holds; each event happens at most once."""

    what: str = Field(description="kind of event")
    at_s: Positive | None = Field(default=None, description="simulated time of the event")
    when: TriggerSpec | None = Field(default=None, description="condition that triggers the event, in place of `at_s`")

    drives_wind: ClassVar[bool] = False

    @model_validator(mode="after")
    def _check_one_time(self) -> Self:
        if (self.at_s is None) == (self.when is None):
            raise broken_rule_error(
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
        """Description of the event, in words."""
        raise NotImplementedError


class SourceEventSpec(EventSpec):
    """Something that happens to one source of gas; `source` is its place in `gas.sources`, from 0 on."""

    source: Annotated[int, Field(ge=0)] = Field(default=0, description="index of the source in `gas.sources`")

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"source {self.source} {self._deed}"

    @property
    def _deed(self) -> str:
        raise NotImplementedError


class SourceStartsSpec(SourceEventSpec):
    """A source starts to release gas.

    A source whose first `source_starts` or `source_stops` in the list is a start is closed until then, in the warm-up
    too.
    """

    what: Literal["source_starts"] = Field(default="source_starts", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "starts"


class SourceStopsSpec(SourceEventSpec):
    """A source stops to release gas; what is in the air stays there. Its release goes on unseen and may start again."""

    what: Literal["source_stops"] = Field(default="source_stops", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "stops"


class SourceMovesSpec(SourceEventSpec):
    """A source is at another place from then on. The referee, its distances and its criterion follow it."""

    what: Literal["source_moves"] = Field(default="source_moves", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    to_m: Vec3 = Field(description="new position in the world")

    @property
    def _deed(self) -> str:
        return f"moves to {format_point(self.to_m)} m"


class SourceRateSpec(SourceEventSpec):
    """A source releases more or less than before; for releases that are `constant` or `poisson`."""

    what: Literal["source_rate"] = Field(default="source_rate", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    filaments_per_s: Positive = Field(description="mean release rate from then on")

    @property
    def _deed(self) -> str:
        return f"releases {self.filaments_per_s:g} filaments/s"


class WindChangesSpec(EventSpec):
    """The wind is another from then on, everywhere at once: faster or slower, or as another inlet makes it.

    The wind of another inlet is made before the run in the same room, with everything else of `wind` as it is; an event
    with neither key brings the scenario's own wind back. The time that a room takes to follow is left out.
    """

    drives_wind: ClassVar[bool] = True

    what: Literal["wind_changes"] = Field(default="wind_changes", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    share: NonNegative = Field(default=1.0, description="wind speed as a fraction of the given wind")
    inlet_velocity_m_s: Vec3 | None = Field(
        default=None, description="wind through the inlets (absent: that of the scenario)"
    )

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        inlet = self.inlet_velocity_m_s
        of = "the scenario's" if inlet is None else f"that of an inlet of {format_point(inlet)} m/s"
        return f"the wind is {of}" if self.share == 1.0 else f"the wind is {self.share:g} times {of}"


class DoorEventSpec(EventSpec):
    """Something that happens to a door of `environment.doors`: walls, wind, gas and sight are others from then on."""

    drives_wind: ClassVar[bool] = True

    door: Name = Field(description="name of the door")

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"{self.door} {self._deed}"

    @property
    def _deed(self) -> str:
        raise NotImplementedError


class DoorOpensSpec(DoorEventSpec):
    """A door opens: its box is gone. All of the air follows at once, as where the wind changes."""

    what: Literal["door_opens"] = Field(default="door_opens", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "opens"


class DoorClosesSpec(DoorEventSpec):
    """A door closes: its box stands there, and gas that was in its place is gone. It waits for no vehicle."""

    what: Literal["door_closes"] = Field(default="door_closes", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "closes"


class SensorEventSpec(EventSpec):
    """Something that happens to one sensor of an agent; a later event of the same sensor takes its place."""

    agent: Name = Field(description="agent of the sensor")
    sensor: Name = Field(description="name of the sensor")

    @property
    def about_agent(self) -> str | None:
        """The agent that it happens to."""
        return self.agent

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"{self.sensor} {self._deed}"

    @property
    def _deed(self) -> str:
        raise NotImplementedError


class SensorDropsOutSpec(SensorEventSpec):
    """A sensor measures no more: its readings say `is_warming_up`, and their values mean nothing."""

    what: Literal["sensor_drops_out"] = Field(default="sensor_drops_out", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "drops out"


class SensorSticksSpec(SensorEventSpec):
    """A sensor repeats its last reading, and nothing in the reading says so."""

    what: Literal["sensor_sticks"] = Field(default="sensor_sticks", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "sticks"


class SensorDriftsSpec(SensorEventSpec):
    """A sensor with a `drift_per_s` of its own drifts away from then on, beside that one."""

    what: Literal["sensor_drifts"] = Field(default="sensor_drifts", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    drift_per_s: float = Field(description="drift per second, in the unit of its readings")

    @property
    def _deed(self) -> str:
        return f"drifts by {self.drift_per_s:g} a second"


class SensorBiasedSpec(SensorEventSpec):
    """A sensor with a `bias` of its own has another one beside it."""

    what: Literal["sensor_biased"] = Field(default="sensor_biased", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    bias: float = Field(description="offset of each value, in the unit of its readings")

    @property
    def _deed(self) -> str:
        return f"is off by {self.bias:g}"


class SensorRecoversSpec(SensorEventSpec):
    """A sensor measures again as before its first event."""

    what: Literal["sensor_recovers"] = Field(default="sensor_recovers", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def _deed(self) -> str:
        return "recovers"


class RotorWeakensSpec(EventSpec):
    """A rotor of a vehicle gives a share of its thrust and torque; the vehicle's control does not know."""

    what: Literal["rotor_weakens"] = Field(default="rotor_weakens", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    agent: Name = Field(description="agent of the vehicle")
    rotor: Annotated[int, Field(ge=0)] = Field(description="index of the rotor, from 0")
    share: Fraction = Field(description="fraction of the thrust and torque of an intact rotor")

    @property
    def about_agent(self) -> str | None:
        """The agent that it happens to."""
        return self.agent

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"rotor {self.rotor} weakens to {self.share:g} of its thrust"


class RadioEventSpec(EventSpec):
    """Something that happens to radio: to all texts from and to `agent`, to all on `channel`, or to those of both."""

    agent: Name | None = Field(default=None, description="agent of the radio (absent: all agents)")
    channel: Name | None = Field(default=None, description="channel (absent: all)")

    @property
    def about_agent(self) -> str | None:
        """The agent that it happens to, if it is one."""
        return self.agent

    @property
    def _radio(self) -> str:
        return f"radio on {self.channel}" if self.channel else "radio"


class RadioLostSpec(RadioEventSpec):
    """Texts are lost from then on; those on their way arrive."""

    what: Literal["radio_lost"] = Field(default="radio_lost", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"{self._radio} is lost"


class RadioReturnsSpec(RadioEventSpec):
    """Undoes those `radio_lost` that name the same agent and channel."""

    what: Literal["radio_returns"] = Field(default="radio_returns", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"{self._radio} returns"


_OWN = {
    str(block.model_fields["what"].default): block
    for block in (
        SourceStartsSpec,
        SourceStopsSpec,
        SourceMovesSpec,
        SourceRateSpec,
        WindChangesSpec,
        DoorOpensSpec,
        DoorClosesSpec,
        SensorDropsOutSpec,
        SensorSticksSpec,
        SensorDriftsSpec,
        SensorBiasedSpec,
        SensorRecoversSpec,
        RotorWeakensSpec,
        RadioLostSpec,
        RadioReturnsSpec,
    )
}

# Chosen by `what`.
Event = Annotated[SerializeAsAny[EventSpec], OneOf(tag_key="what", base=EventSpec, own=_OWN, offers=None)]
