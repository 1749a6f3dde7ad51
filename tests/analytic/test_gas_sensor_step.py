"""A first-order sensor's answer to a step of gas, against the exponential."""

import math

import pytest
from built_messages import build_sample

from gslcosim.base.rng import stream
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing.models.mox import MOX_PARAMETERS, build_mox_kernel, build_mox_kind, steady_ratio


def ohm_after(parameters, tick_s, phases):
    """Read through phases of (ppm, seconds) after one tick in clean air."""
    spec = make_sensor_spec(model=f"{parameters.model}_ideal", name="nose")
    sensor = build_mox_kind(parameters).build(spec, tick_s, stream(1, "test"))
    ohm = sensor.read(build_sample(ethanol=0.0), (0.0, 0.0, 0.0)).values[0]
    for ppm, duration_s in phases:
        for _ in range(round(duration_s / tick_s)):
            ohm = sensor.read(build_sample(ethanol=ppm), (0.0, 0.0, 0.0)).values[0]
    return ohm


@pytest.mark.parametrize("model", ["tgs2600", "tgs2620"])
@pytest.mark.parametrize("parts", [1, 3, 48])
def test_the_step_response_reaches_63_per_cent_at_tau(model, parts):
    p = MOX_PARAMETERS[model]
    air, low = (
        p.r0_ohm * p.air_ratio,
        p.r0_ohm * steady_ratio(build_mox_kernel(p, ("ethanol",), 0.1).parameters, (50.0,)),
    )
    risen = ohm_after(p, p.rise_s / parts, [(50.0, p.rise_s)])
    assert (air - risen) / (air - low) == pytest.approx(1 - math.exp(-1), rel=1e-9)
    settled = [(50.0, 40 * p.decay_s), (0.0, p.decay_s)]
    back = ohm_after(p, p.decay_s / parts, settled)
    assert (back - low) / (air - low) == pytest.approx(1 - math.exp(-1), rel=1e-9)


def test_the_response_does_not_depend_on_the_tick_length():
    p = MOX_PARAMETERS["tgs2600"]
    phases = [(20.0, 3.0), (5.0, 2.0), (0.0, 6.0), (100.0, 1.0)]
    coarse, fine = (ohm_after(p, tick_s, phases) for tick_s in (0.5, 0.02))
    assert coarse == pytest.approx(fine, rel=1e-9)
