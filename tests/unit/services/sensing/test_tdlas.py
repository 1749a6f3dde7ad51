"""The open-path laser."""

import pytest
from built_messages import build_sample

from gslcosim.base.rng import stream
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS


@pytest.mark.parametrize(("beam_m", "value", "is_saturated"), [(4.0, 10.0, False), (0.0, 0.0, True), (None, 0.0, True)])
def test_the_reading_is_mean_times_length_and_nothing_without_an_echo(beam_m, value, is_saturated):
    sensor = SENSOR_MODELS["tdlas_ideal"].build(
        make_sensor_spec(model="tdlas_ideal", name="laser"), 0.1, stream(1, "laser")
    )
    sample = build_sample("a", "laser", beam_m=beam_m, methane=2.5, ethanol=100.0)
    reading = sensor.read(sample, (0.0, 0.0, 0.0))
    assert (reading.values, reading.unit, reading.is_saturated) == ((value,), "ppm m", is_saturated)
