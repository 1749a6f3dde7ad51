"""Sensors that drop out, stick, drift, are off and recover."""

import pytest

from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import Reading
from gslcosim.scenario import load_scenario
from gslcosim_services.sensing.core import SensorFaults

ABOUT_NOSE = "agent: beetle, sensor: nose"


@pytest.fixture
def faults_of():
    def build(*events, model="pid"):
        events_text = ", ".join(f"{{at_s: {i + 1}, {ABOUT_NOSE}, {event}}}" for i, event in enumerate(events))
        sensors = f"agents[0].sensors=[{{model: {model}, name: nose}}, {{model: tgs2600, name: wind}}]"
        changes = [sensors, f"events=[{events_text}]"]
        return SensorFaults(load_scenario("tiny_room", overrides=changes).scenario)

    return build


def reading(*values, sensor="nose"):
    return Reading(sensor=sensor, quantity="gas", unit="ppm", values=values)


def begin(faults, tick, *places):
    faults.obey(tick, {EVENTS: EventsBeginning(tick=tick - 1, beginning=places)})


def test_other_sensors_and_agents_see_nothing_of_it(faults_of):
    faults = faults_of("what: sensor_biased, bias: 2")
    begin(faults, 10, 0)
    other = reading(3.0, sensor="wind")
    assert faults.shown("beetle", other, None, 10) is other
    assert faults.shown("ant", reading(3.0), None, 10) == reading(3.0)


def test_a_bias_and_a_drift_are_added_from_their_event_on(faults_of):
    faults = faults_of("what: sensor_biased, bias: 2", "what: sensor_drifts, drift_per_s: -0.5")
    assert faults.shown("beetle", reading(3.0), None, 9).values == (3.0,)
    begin(faults, 10, 0)
    assert faults.shown("beetle", reading(3.0), None, 10).values == (5.0,)
    # A later event takes the place of the one before.
    begin(faults, 20, 1)
    assert faults.shown("beetle", reading(3.0), None, 20).values == (3.0,)
    assert faults.shown("beetle", reading(3.0), None, 40).values == (2.0,)


def test_values_never_fall_below_what_the_kind_of_sensor_can_show(faults_of):
    faults = faults_of("what: sensor_biased, bias: -1e9", model="tgs2600")
    begin(faults, 10, 0)
    (shown,) = faults.shown("beetle", reading(30000.0), None, 10).values
    assert 0 < shown < 30000.0


def test_a_stuck_sensor_repeats_itself_and_a_lost_one_says_so(faults_of):
    faults = faults_of("what: sensor_sticks", "what: sensor_drops_out", "what: sensor_recovers")
    begin(faults, 10, 0)
    before = reading(1.0)
    assert faults.shown("beetle", reading(3.0), before, 10) is before
    begin(faults, 11, 1)
    lost = faults.shown("beetle", reading(4.0), before, 11)
    assert (lost.values, lost.is_warming_up) == ((1.0,), True)
    begin(faults, 12, 2)
    assert faults.shown("beetle", reading(4.0), lost, 12) == reading(4.0)


def test_a_new_run_begins_with_sound_sensors(faults_of):
    faults = faults_of("what: sensor_biased, bias: 2")
    begin(faults, 10, 0)
    faults.reset()
    assert faults.shown("beetle", reading(3.0), None, 10).values == (3.0,)
