import math

import pytest
from built_messages import build_sample

from gslcosim.base.rng import stream
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models.mox import (
    MIN_RATIO,
    MOX_PARAMETERS,
    build_mox_kernel,
    build_mox_kind,
    estimate_ppm,
    steady_ratio,
)

STILL = (0.0, 0.0, 0.0)


def build_nose(tick_s):
    return SENSOR_MODELS["tgs2600_ideal"].build(
        make_sensor_spec(model="tgs2600_ideal", name="nose"), tick_s, stream(1, "test")
    )


def steady_ohm(model, **ppm):
    parameters = MOX_PARAMETERS[model]
    kernel = build_mox_kernel(parameters, tuple(ppm), 0.1)
    return parameters.r0_ohm * steady_ratio(kernel.parameters, tuple(ppm.values()))


@pytest.mark.parametrize(
    ("model", "air_ohm"),
    [("tgs2620", 63000), ("tgs2600", 50000), ("tgs2611", 32912), ("tgs2610", 38522), ("tgs2612", 87750)],
)
def test_resistance_in_clean_air(model, air_ohm):
    assert steady_ohm(model) == pytest.approx(air_ohm)
    assert steady_ohm(model, ethanol=0.0) == pytest.approx(air_ohm)


@pytest.mark.parametrize(
    ("gas", "floors_ppm"),
    [
        ("ethanol", (4.574, 0.2986, 122.6, 105.3, 182.9)),
        ("methane", (36.02, 1.278, 31.15, 29.9, 30.12)),
        ("hydrogen", (1.316, 0.3385, 72.1, 45.8, math.inf)),
    ],
)
def test_floors_below_which_a_gas_has_no_effect(gas, floors_ppm):
    for model, floor_ppm in zip(("tgs2620", "tgs2600", "tgs2611", "tgs2610", "tgs2612"), floors_ppm, strict=True):
        assert MOX_PARAMETERS[model].floor_ppm(gas) == pytest.approx(floor_ppm, rel=5e-4)
        if math.isfinite(floor_ppm):
            air = steady_ohm(model)
            assert steady_ohm(model, **{gas: 0.99 * floor_ppm}) == air > steady_ohm(model, **{gas: 1.01 * floor_ppm})


@pytest.mark.parametrize(
    ("model", "ohms"), [("tgs2600", (33980, 16278.8, 7798.7)), ("tgs2620", (63000, 35995.5, 6930.2))]
)
def test_steady_resistance_in_ethanol(model, ohms):
    for ppm, ohm in zip((1.0, 10.0, 100.0), ohms, strict=True):
        assert steady_ohm(model, ethanol=ppm) == pytest.approx(ohm, abs=0.05)


def test_a_mixture_lowers_the_resistance_by_the_sum_of_its_gases():
    both = steady_ohm("tgs2620", ethanol=6.0, methane=50.0)
    parts = [steady_ohm("tgs2620", ethanol=6.0), steady_ohm("tgs2620", methane=50.0)]
    assert 63000 - both == pytest.approx(sum(63000 - part for part in parts))
    assert steady_ohm("tgs2600", ethanol=1e3, methane=1e3) == pytest.approx(50000 * MIN_RATIO)


def test_a_gas_without_figures_has_no_effect():
    assert steady_ohm("tgs2600", neon=1e6) == 50000
    assert MOX_PARAMETERS["tgs2600"].floor_ppm("neon") == math.inf


def test_the_first_reading_is_that_of_clean_air():
    sensor = build_nose(0.1)
    reading = sensor.read(build_sample(ethanol=50.0), STILL)
    assert (reading.sensor, reading.quantity, reading.unit, reading.values) == ("nose", "resistance", "ohm", (50000.0,))


def test_decay_is_slower_than_rise():
    sensor = build_nose(0.1)
    sensor.read(build_sample(), STILL)
    fall_ohm = 50000.0 - sensor.read(build_sample(ethanol=10.0), STILL).values[0]
    low_ohm = math.inf
    for _ in range(1000):
        low_ohm = sensor.read(build_sample(ethanol=10.0), STILL).values[0]
    back_ohm = sensor.read(build_sample(), STILL).values[0] - low_ohm
    assert low_ohm == pytest.approx(16278.8, abs=0.1)
    assert back_ohm / fall_ohm == pytest.approx(math.expm1(-0.1 / 18.75) / math.expm1(-0.1 / 4.8))


def test_saturation_is_reported():
    sensor = build_nose(1.0)
    readings = [sensor.read(build_sample(ethanol=1e8), STILL) for _ in range(300)]
    assert not readings[0].is_saturated
    assert readings[-1].is_saturated
    assert readings[-1].values[0] == pytest.approx(500.0)


@pytest.mark.parametrize("model", sorted(MOX_PARAMETERS))
@pytest.mark.parametrize("gas", ["ethanol", "methane", "hydrogen"])
def test_the_estimate_inverts_the_steady_response(model, gas):
    parameters = MOX_PARAMETERS[model]
    floor_ppm = parameters.floor_ppm(gas)
    if math.isinf(floor_ppm):
        estimator = build_mox_kind(parameters).estimator
        assert estimator is not None
        assert estimator(gas) is None
        return
    numbers = build_mox_kernel(parameters, (gas,), 0.1).parameters
    for ppm in (2.0 * floor_ppm, 10.0 * floor_ppm):
        assert estimate_ppm(numbers, (steady_ohm(model, **{gas: ppm}),)) == pytest.approx(ppm, rel=1e-9)
    for clean_ohm in (0.98 * steady_ohm(model), steady_ohm(model), 1.2 * steady_ohm(model)):
        assert estimate_ppm(numbers, (clean_ohm,)) == 0.0


def test_an_impossible_resistance_has_an_estimate_that_is_finite():
    numbers = build_mox_kernel(MOX_PARAMETERS["tgs2612"], ("ethanol",), 0.1).parameters
    for ohm in (0.0, -5.0, 1e-300):
        assert math.isfinite(estimate_ppm(numbers, (ohm,)))


def test_the_tgs2602_falls_as_on_its_sheet():
    """About 0.75, 0.3 and 0.17 of clean air at 1, 10 and 30 ppm of ethanol, read off the sheet by eye."""
    found = [steady_ohm("tgs2602", ethanol=ppm) / steady_ohm("tgs2602") for ppm in (1.0, 10.0, 30.0)]
    assert found == pytest.approx([0.75, 0.3, 0.17], rel=0.06)
    assert steady_ohm("tgs2602", methane=1e4) == steady_ohm("tgs2602")
