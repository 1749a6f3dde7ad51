"""Base blocks of sensors' settings."""

from typing import ClassVar, Self

from pydantic import Field, model_validator

from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import Name, NonNegative, Positive, Spec, broken_rule_error, format_point


class SensorSpec(Spec):
    """Base of all sensors; the block of a model adds what only this model has.

    `has_estimates` says that a second reading tells the mixing ratio that the first one suggests, under the sensor's
    name with `_ppm` behind.
    """

    has_estimates: ClassVar[bool] = False

    model: str = Field(description="which sensor it is")
    name: Name = Field(description="what its readings are called")
    mount_m: Vec3 = Field(default=(0.0, 0.0, 0.0), description="its place in the body frame")
    period_s: Positive | None = Field(default=None, description="time between readings (absent: every tick)")
    delay_s: NonNegative = Field(default=0.0, description="age of what a reading shows")
    warm_up_s: NonNegative = Field(default=0.0, description="time from the start until it measures")


class NoisySensorSpec(SensorSpec):
    """A sensor whose values have white noise, in the unit of its readings."""

    noise_std: NonNegative = Field(
        default=0.0, description="standard deviation of the white noise, in the unit of its readings"
    )


class MeasuringSensorSpec(NoisySensorSpec):
    """A sensor with the usual errors of an instrument, in the unit of its readings."""

    bias: float = Field(default=0.0, description="is added to each value, in the unit of its readings")
    drift_per_s: float = Field(default=0.0, description="is added to the bias each second, in the unit of its readings")
    max_value: Positive | None = Field(
        default=None, description="size of a value at which it saturates, in the unit of its readings (absent: none)"
    )


class OnBoardSensorSpec(SensorSpec):
    """A sensor of the vehicle itself or of what is around it: it looks at bodies and the scene, not at gas and wind."""


class TurnedSensorSpec(SensorSpec):
    """A sensor that looks around: its axes can be turned against the body's."""

    mount_rpy_rad: Vec3 = Field(
        default=(0.0, 0.0, 0.0), description="roll, then pitch, then yaw of its axes about the body's fixed axes"
    )


class ReachingSensorSpec(SensorSpec):
    """A sensor that sees as far as some range."""

    max_range_m: Positive = Field(default=30.0, description="how far it sees")


class BeamSensorSpec(ReachingSensorSpec):
    """A sensor that looks along one beam."""

    beam_body: Vec3 = Field(default=(1.0, 0.0, 0.0), description="direction of the beam in the body frame")

    @model_validator(mode="after")
    def _check_beam(self) -> Self:
        if not any(self.beam_body):
            raise broken_rule_error(
                key="beam_body",
                expected="a direction that is not zero",
                found=format_point(self.beam_body),
                remedy="For example [1, 0, 0], ahead.",
            )
        return self


class RaySensorSpec(NoisySensorSpec, TurnedSensorSpec, ReachingSensorSpec, OnBoardSensorSpec):
    """A range finder or lidar: it measures how far it is to what is around, along rays."""
