"""When events begin: at their times, upon their conditions, each once."""

import pytest

from gslcosim.base.errors import ModelError
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS
from gslcosim.contract.messages import BodyPoses, BodyState, FieldSamples, GasAmount, MountSample
from gslcosim.contract.participant import Episode
from gslcosim.scenario import load_scenario
from gslcosim_services.events.core import EventsCore


def core_of(*events):
    scenario = load_scenario("tiny_room", overrides=[f"events=[{', '.join(events)}]"]).scenario
    core = EventsCore(scenario)
    assert core.reset(Episode(seed=1)) == {}
    return core


def body(x_m, agent="beetle"):
    return BodyState(
        agent=agent,
        position_world_m=(x_m, 2.0, 1.0),
        quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
        velocity_world_m_s=(0.0, 0.0, 0.0),
        angular_velocity_body_rad_s=(0.0, 0.0, 0.0),
        phase="flying",
        awaiting_command=False,
        path_length_m=0.0,
    )


def sample(ppm, agent="beetle", gas="ethanol"):
    gases = (GasAmount(gas=gas, mixing_ratio_ppm=ppm),)
    return MountSample(agent=agent, sensor="nose", gases=gases, wind_world_m_s=(0.0, 0.0, 0.0))


def begun(core, inbox_at, n_ticks=40):
    """Return the ticks in which events take effect, by their places."""
    found = {}
    for tick in range(n_ticks):
        for i in core.step(tick, inbox_at(tick))[EVENTS].beginning:
            assert i not in found, "an event happens once"
            found[i] = tick + 1
    return found


def test_an_event_at_a_time_takes_effect_in_the_tick_that_ends_then():
    core = core_of("{what: source_stops, at_s: 0.1}", "{what: source_starts, at_s: 3}")
    assert core.spec.reads == ()
    assert begun(core, lambda tick: {}) == {0: 1, 1: 30}
    core.reset(Episode(seed=1))
    assert begun(core, lambda tick: {}) == {0: 1, 1: 30}


def test_a_condition_counts_when_it_holds_first_and_takes_effect_a_tick_later():
    near = "{what: source_stops, when: {agent: beetle, within_m: 1, of_m: [1, 2, 1]}}"
    late = "{what: source_starts, when: {agent: beetle, within_m: 1, of_m: [1, 2, 1], delay_s: 0.5}}"
    core = core_of(near, late)
    assert [read.port for read in core.spec.reads] == [keys.BODIES]
    # At 1 m exactly in tick 10, away in tick 12, and back in tick 20.
    place_m = {10: 2.0, 11: 1.5, 20: 1.0}
    inbox_at = lambda tick: {keys.BODIES: BodyPoses(tick=tick, bodies=(body(place_m.get(tick, 4.0)),))}  # noqa: E731
    assert begun(core, inbox_at) == {0: 11, 1: 16}


def test_only_the_agents_own_sensors_and_the_gas_that_is_searched_for_count():
    core = core_of("{what: source_stops, when: {agent: beetle, gas_above_ppm: 1}}")
    assert [read.port for read in core.spec.reads] == [keys.SAMPLES]
    samples = {5: sample(2.0, agent="other"), 6: sample(2.0, gas="methane"), 7: sample(1.0), 8: sample(1.1)}
    inbox_at = lambda tick: {keys.SAMPLES: FieldSamples(tick=tick, samples=(samples.get(tick, sample(0.0)),))}  # noqa: E731
    assert begun(core, inbox_at) == {0: 9}


def test_a_truth_without_the_agent_ends_the_run():
    core = core_of("{what: source_stops, when: {agent: beetle, within_m: 1, of_m: [1, 2, 1]}}")
    with pytest.raises(ModelError, match="expected a pose of vehicle 'beetle' in tick 0, was none"):
        core.step(0, {keys.BODIES: BodyPoses(tick=0, bodies=(body(1.0, agent="other"),))})
