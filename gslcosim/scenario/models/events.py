"""Events of a scenario: a block for each kind, at a time or upon a condition."""

import re
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, SerializeAsAny, StringConstraints, model_validator

from gslcosim.base.box_rules import format_point
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.contract.participant_messages import build_own_port
from gslcosim.scenario.models.base import Fraction, Name, NonNegative, OneOf, Positive, Spec

# For participants: a word of its `writes`, and the name of a value that it writes there.
VALUE_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,39}\.[a-z][a-z0-9_]{0,39}")


class TriggerSpec(Spec):
    """Condition on the true state of one agent's vehicle, or on a value that a participant writes.

    - `gas_above_ppm`: any sensor of the vehicle is in more than this mixing ratio of the gas to find.
    - `within_m`: the vehicle is at most this far from `of_m`.
    - `value`: an output of the participant, such as `state.is_on`, is above or below a bound, or true where there is no
      bound. A truth value counts as 0 or 1, and a value holds until the next.

    It triggers the event the first time it holds, or with `repeats` each time it begins to hold. The event follows
    `delay_s` later, in the next tick at the earliest.
    """

    agent: Name | None = Field(default=None, description="agent of the vehicle")
    gas_above_ppm: Positive | None = Field(
        default=None, description="threshold of the true mixing ratio at any of its sensors"
    )
    within_m: Positive | None = Field(default=None, description="distance to `of_m` that triggers the event")
    of_m: Vec3 | None = Field(default=None, description="position in the world from which `within_m` is measured")
    participant: Name | None = Field(default=None, description="one of `participants`, in place of `agent`")
    value: Annotated[str, StringConstraints(max_length=81)] | None = Field(
        default=None, description="value that the participant writes: WORD.NAME, with a word of its `writes`"
    )
    above: float | None = Field(default=None, description="bound that the value exceeds, in its unit")
    below: float | None = Field(default=None, description="bound that the value is less than, in its unit")
    delay_s: NonNegative = Field(default=0.0, description="delay from the trigger to the event")
    repeats: bool = Field(
        default=False, description="trigger the event each time that the condition begins to hold, not only the first"
    )

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        subjects = self._list_given("agent", "participant")
        if len(subjects) != 1:
            raise broken_rule_error(
                expected="exactly one of agent and participant",
                found=" and ".join(subjects) or "none",
                remedy="For example when: {agent: beetle, gas_above_ppm: 1}.",
            )
        if self.agent is not None:
            self._check_vehicle()
        else:
            self._check_value()
        return self

    def _list_given(self, *keys: str) -> list[str]:
        return [key for key in keys if getattr(self, key) is not None]

    def _check_vehicle(self) -> None:
        if strange := self._list_given("value", "above", "below"):
            raise broken_rule_error(
                key=strange[0],
                expected=f"no {strange[0]} beside agent",
                found="one",
                remedy=f"{strange[0]} belongs to participant.",
            )
        given = self._list_given("gas_above_ppm", "within_m")
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

    def _check_value(self) -> None:
        if strange := self._list_given("gas_above_ppm", "within_m", "of_m"):
            raise broken_rule_error(
                key=strange[0],
                expected=f"no {strange[0]} beside participant",
                found="one",
                remedy=f"{strange[0]} belongs to agent.",
            )
        if self.value is None or VALUE_PATTERN.fullmatch(self.value) is None:
            raise broken_rule_error(
                key="value",
                expected="WORD.NAME, a word of the participant's writes and the name of a value that it writes there",
                found="none" if self.value is None else f"'{self.value}'",
                remedy="For example when: {participant: hvac, value: state.is_on}.",
            )
        if len(self._list_given("above", "below")) > 1:
            raise broken_rule_error(
                expected="at most one of above and below",
                found="above and below",
                remedy="For example when: {participant: hvac, value: state.level, above: 1}.",
            )

    @property
    def value_port(self) -> str | None:
        """Port of the value; None if the condition is on a vehicle."""
        if self.participant is None or self.value is None:
            return None
        return build_own_port(self.participant, self.value.partition(".")[0])

    @property
    def value_name(self) -> str:
        """The name of the value in the messages of its port."""
        return (self.value or "").partition(".")[2]

    def is_met_by(self, value: float) -> bool:
        """Return whether a value of the participant fulfils the condition."""
        if self.above is not None:
            return value > self.above
        return value < self.below if self.below is not None else bool(value)

    @property
    def text(self) -> str:
        """The condition in words."""
        when = f"{self.delay_s:g} s after" if self.delay_s else "" if self.repeats else "once"
        return " ".join(part for part in (when, "each time that" if self.repeats else "", self._what) if part)

    @property
    def _what(self) -> str:
        if self.participant is not None:
            bound = "true" if self.below is None else f"below {self.below:g}"
            return f"{self.value} of {self.participant} is {bound if self.above is None else f'above {self.above:g}'}"
        if self.gas_above_ppm is not None:
            return f"{self.agent} is in more than {self.gas_above_ppm:g} ppm"
        return f"{self.agent} is within {self.within_m:g} m of {format_point(self.of_m or (0.0, 0.0, 0.0))} m"


class EventSpec(Spec):
    """Something that happens during a run: at a time, or upon a condition; at most once, unless its `when` repeats."""

    what: str = Field(description="kind of event")
    at_s: Positive | None = Field(default=None, description="simulated time of the event")
    when: TriggerSpec | None = Field(default=None, description="condition that triggers the event, in place of `at_s`")

    drives_wind: ClassVar[bool] = False
    # The event in words, with names of fields in braces.
    text_format: ClassVar[str] = ""

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
        """Agent of the event, if it concerns one."""
        return getattr(self, "agent", None)

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return self.text_format.format_map(dict(self))


class SourceEventSpec(EventSpec):
    """Something that happens to one source of gas; `source` is its place in `gas.sources`, from 0 on."""

    source: Annotated[int, Field(ge=0)] = Field(default=0, description="index of the source in `gas.sources`")


class SourceStartsSpec(SourceEventSpec):
    """A source starts to release gas.

    If the first `source_starts` or `source_stops` of a source in the list is a start, the source is closed until then,
    also during the warm-up.
    """

    text_format: ClassVar[str] = "source {source} starts"

    what: Literal["source_starts"] = Field(default="source_starts", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class SourceStopsSpec(SourceEventSpec):
    """A source stops releasing gas; gas in the air stays. Its release continues unseen and may start again."""

    text_format: ClassVar[str] = "source {source} stops"

    what: Literal["source_stops"] = Field(default="source_stops", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class SourceMovesSpec(SourceEventSpec):
    """A source is at another place from then on. The referee, its distances and its criterion follow it."""

    what: Literal["source_moves"] = Field(default="source_moves", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    to_m: Vec3 = Field(description="new position in the world")

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return f"source {self.source} moves to {format_point(self.to_m)} m"


class SourceRateSpec(SourceEventSpec):
    """A source releases more or less than before; for releases that are `constant` or `poisson`."""

    text_format: ClassVar[str] = "source {source} releases {filaments_per_s:g} filaments/s"

    what: Literal["source_rate"] = Field(default="source_rate", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    filaments_per_s: Positive = Field(description="mean release rate from then on")


class WindChangesSpec(EventSpec):
    """The wind changes from then on, everywhere at once: to another speed, or to the wind of another inlet.

    The wind of another inlet is solved before the run in the same room, with everything else of `wind` as it is; an
    event with neither key restores the scenario's own wind. The time that a room takes to follow is left out.
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


class DoorOpensSpec(DoorEventSpec):
    """A door opens: its box is gone. All of the air follows at once, as where the wind changes."""

    text_format: ClassVar[str] = "{door} opens"

    what: Literal["door_opens"] = Field(default="door_opens", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class DoorClosesSpec(DoorEventSpec):
    """A door closes: its box stands there, and gas that was in its place is gone. It waits for no vehicle."""

    text_format: ClassVar[str] = "{door} closes"

    what: Literal["door_closes"] = Field(default="door_closes", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class SensorEventSpec(EventSpec):
    """Something that happens to one sensor of an agent; a later event of the same sensor takes its place."""

    agent: Name = Field(description="agent of the sensor")
    sensor: Name = Field(description="name of the sensor")


class SensorDropsOutSpec(SensorEventSpec):
    """A sensor stops measuring: its readings have `is_warming_up`, and their values mean nothing."""

    text_format: ClassVar[str] = "{sensor} drops out"

    what: Literal["sensor_drops_out"] = Field(default="sensor_drops_out", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class SensorSticksSpec(SensorEventSpec):
    """A sensor repeats its last reading, without any sign of it in the reading."""

    text_format: ClassVar[str] = "{sensor} sticks"

    what: Literal["sensor_sticks"] = Field(default="sensor_sticks", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class SensorDriftsSpec(SensorEventSpec):
    """A sensor drifts from then on, in addition to its own `drift_per_s`."""

    text_format: ClassVar[str] = "{sensor} drifts by {drift_per_s:g} a second"

    what: Literal["sensor_drifts"] = Field(default="sensor_drifts", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    drift_per_s: float = Field(description="drift per second, in the unit of its readings")


class SensorBiasedSpec(SensorEventSpec):
    """A sensor has another bias, in addition to its own `bias`."""

    text_format: ClassVar[str] = "{sensor} is off by {bias:g}"

    what: Literal["sensor_biased"] = Field(default="sensor_biased", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    bias: float = Field(description="offset of each value, in the unit of its readings")


class SensorRecoversSpec(SensorEventSpec):
    """A sensor measures again as before its first event."""

    text_format: ClassVar[str] = "{sensor} recovers"

    what: Literal["sensor_recovers"] = Field(default="sensor_recovers", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class RotorWeakensSpec(EventSpec):
    """A rotor gives a fraction of its thrust and torque; the vehicle's control does not detect it."""

    text_format: ClassVar[str] = "rotor {rotor} weakens to {share:g} of its thrust"

    what: Literal["rotor_weakens"] = Field(default="rotor_weakens", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]
    agent: Name = Field(description="agent of the vehicle")
    rotor: Annotated[int, Field(ge=0)] = Field(description="index of the rotor, from 0")
    share: Fraction = Field(description="fraction of the thrust and torque of an intact rotor")


class RadioEventSpec(EventSpec):
    """Something that happens to radio: to all texts from and to `agent`, to all on `channel`, or to those of both."""

    agent: Name | None = Field(default=None, description="agent of the radio (absent: all agents)")
    channel: Name | None = Field(default=None, description="channel (absent: all)")

    @property
    def text(self) -> str:
        """Description of the event, in words."""
        return self.text_format.format(radio=f"radio on {self.channel}" if self.channel else "radio")


class RadioLostSpec(RadioEventSpec):
    """Texts are lost from then on; those on their way arrive."""

    text_format: ClassVar[str] = "{radio} is lost"

    what: Literal["radio_lost"] = Field(default="radio_lost", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


class RadioReturnsSpec(RadioEventSpec):
    """Undoes each `radio_lost` with the same agent and channel."""

    text_format: ClassVar[str] = "{radio} returns"

    what: Literal["radio_returns"] = Field(default="radio_returns", description="kind of event")  # pyright: ignore[reportIncompatibleVariableOverride]


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
