"""The open-path laser."""

import pytest
from built_messages import build_sample
from surroundings import make_sensor


@pytest.mark.parametrize(("beam_m", "value", "is_saturated"), [(4.0, 10.0, False), (0.0, 0.0, True), (None, 0.0, True)])
def test_the_reading_is_mean_times_length_and_nothing_without_an_echo(beam_m, value, is_saturated):
    sample = build_sample("a", "s", beam_m=beam_m, methane=2.5, ethanol=100.0)
    reading = make_sensor("tdlas_ideal").read(sample, (0.0, 0.0, 0.0))
    assert (reading.values, reading.unit, reading.is_saturated) == ((value,), "ppm m", is_saturated)
