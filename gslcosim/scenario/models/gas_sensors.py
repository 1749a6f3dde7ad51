"""Settings of sensors of gas and wind; every field with unit, default and range."""

from typing import ClassVar

from pydantic import Field

from gslcosim.scenario.models.base import NonNegative, Positive
from gslcosim.scenario.models.sensor_base import BeamSensorSpec, MeasuringSensorSpec


class MoxSensorSpec(MeasuringSensorSpec):
    """A metal-oxide sensor; its figures are those of its model."""

    has_estimates: ClassVar[bool] = True


class PidSensorSpec(MeasuringSensorSpec):
    """A photo-ionisation detector."""


class ThresholdSensorSpec(MeasuringSensorSpec):
    """A sensor that compares the mixing ratio with a threshold: `threshold` and `binary`."""

    threshold_ppm: NonNegative = Field(default=0.1, description="mixing ratio above which there is gas")


class HitCounterSpec(MeasuringSensorSpec):
    """A counter of hits of gas."""

    hits_per_s_per_ppm: Positive = Field(default=1.0, description="mean number of hits per second and ppm")


class AveragingSensorSpec(MeasuringSensorSpec):
    """A sensor that shows a mean over time."""

    averaging_s: Positive = Field(default=1.0, description="time over which it takes the mean")


class SecondOrderSensorSpec(MeasuringSensorSpec):
    """A slow sensor: two lags in series, one pair of time constants up and one down."""

    response_s: tuple[Positive, Positive] = Field(default=(1.0, 2.0), description="two time constants for more gas")
    recovery_s: tuple[Positive, Positive] = Field(default=(2.0, 10.0), description="two time constants for less gas")


class TdlasSensorSpec(MeasuringSensorSpec, BeamSensorSpec):
    """An open-path laser along a beam."""


class Anemometer3dSpec(MeasuringSensorSpec):
    """An anemometer of three axes."""

    speed_noise_std_m_s: NonNegative = Field(default=0.01, description="noise of the speed, or of each component")


class AnemometerSpec(Anemometer3dSpec):
    """An anemometer of two axes, which tells speed and direction."""

    direction_noise_std_rad: NonNegative = Field(default=0.1, description="noise of the direction")
