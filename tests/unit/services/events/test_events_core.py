"""When events begin: at their times, upon their conditions, each once."""

import pytest
from built_messages import build_body, build_sample

from gslcosim.base.errors import ModelError
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS
from gslcosim.contract.messages import BodyPoses, FieldSamples
from gslcosim.contract.participant import Episode
from gslcosim.contract.participant_messages import ParticipantValues
from gslcosim.scenario import load_scenario
from gslcosim_services.events.core import EventsCore

HVAC = "participants=[{name: hvac, start: {command: [cat]}, writes: [state]}]"


def core_of(*events):
    scenario = load_scenario("tiny_room", overrides=[HVAC, f"events=[{', '.join(events)}]"]).scenario
    core = EventsCore(scenario)
    assert core.reset(Episode(seed=1)) == {}
    return core


def body(x_m, agent="beetle"):
    return build_body(agent, (x_m, 2.0, 1.0))


def sample(ppm, agent="beetle", gas="ethanol"):
    return build_sample(agent, **{gas: ppm})


def beginnings(core, inbox_at, n_ticks=40):
    """Return the ticks in which each event takes effect, by its place."""
    found = {}
    for tick in range(n_ticks):
        for i in core.step(tick, inbox_at(tick))[EVENTS].beginning:
            found.setdefault(i, []).append(tick + 1)
    return found


def begun(core, inbox_at):
    """Return the one tick in which each event takes effect, by its place."""
    found = beginnings(core, inbox_at)
    assert all(len(ticks) == 1 for ticks in found.values()), "an event happens once"
    return {i: ticks[0] for i, ticks in found.items()}


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


def values_at(changes, *, period=1):
    """Return inboxes of a participant that writes every `period` ticks what is last among the changes, by tick."""

    def inbox_at(tick):
        values = changes[max(since for since in changes if since <= tick)]
        return {"participant/hvac/state": ParticipantValues(tick=tick, values=values)} if tick % period == 0 else {}

    return inbox_at


def test_a_value_of_a_participant_triggers_events_each_time_that_it_passes_a_bound():
    opens = "{what: source_starts, when: {participant: hvac, value: state.level, above: 2, repeats: true}}"
    closes = "{what: source_stops, when: {participant: hvac, value: state.level, below: 1, repeats: true}}"
    once = "{what: source_stops, when: {participant: hvac, value: state.level, above: 2}}"
    late = "{what: source_stops, when: {participant: hvac, value: state.level, above: 2, repeats: true, delay_s: 1}}"
    core = core_of(opens, closes, once, late)
    assert [read.port for read in core.spec.reads] == ["participant/hvac/state"]
    changes = {0: 0.0, 3: 1.5, 6: 2.5, 8: 2.0, 12: 2.5, 14: 0.5, 20: 1.0, 22: 0.9}
    found = beginnings(core, values_at({tick: {"level": level} for tick, level in changes.items()}))
    # What holds at the start begins to hold then; equal to a bound is neither above nor below it.
    assert found == {0: [7, 13], 1: [1, 15, 23], 2: [7], 3: [17, 23]}
    core.reset(Episode(seed=1))
    assert beginnings(core, values_at({0: {"level": 2.5}})) == {0: [1], 2: [1], 3: [11]}


def test_a_value_without_a_bound_is_true_or_not_and_holds_between_the_steps_of_its_participant():
    core = core_of("{what: source_starts, when: {participant: hvac, value: state.is_on, repeats: true}}")
    changes = {0: {"is_on": False}, 6: {"is_on": True}, 21: {"is_on": False}, 30: {"is_on": True}}
    assert beginnings(core, values_at(changes, period=5)) == {0: [11, 31]}


def test_a_value_that_a_participant_does_not_write_ends_the_run():
    core = core_of("{what: source_starts, when: {participant: hvac, value: state.is_no}}")
    with pytest.raises(ModelError) as caught:
        core.step(0, values_at({0: {"is_on": True, "level": 1.0}})(0))
    assert str(caught.value) == (
        "events[0].when.value: expected a value that hvac writes on participant/hvac/state (is_on, level), "
        "was 'is_no', at tick 0."
    )


def test_a_truth_without_the_agent_ends_the_run():
    core = core_of("{what: source_stops, when: {agent: beetle, within_m: 1, of_m: [1, 2, 1]}}")
    with pytest.raises(ModelError, match="expected a pose of vehicle 'beetle' in tick 0, was none"):
        core.step(0, {keys.BODIES: BodyPoses(tick=0, bodies=(body(1.0, agent="other"),))})
