"""Events that cannot be are reported with their place, what is expected, and a remedy."""

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.environment.positions import find_position_problems
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.events import TriggerSpec


def check(scenario, directory):
    return find_position_problems(scenario, scenario_dir=directory)


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        ("{what: source_stops, at_s: 21}",
         "events[0].at_s: expected a time up to the end of the run, 20 s, was 21 s."),
        ("{what: source_stops, at_s: 1.05}", "events[0].at_s: expected a whole number of 100 ms ticks, was 1.05 s."),
        ("{what: source_stops, at_s: 0}", "events[0].at_s: expected a number greater than 0 in seconds, was 0."),
        ("{what: source_stops}", "events[0]: expected exactly one of at_s and when, was none."),
        ("{what: source_stops, at_s: 1, when: {agent: beetle, gas_above_ppm: 1}}",
         "events[0]: expected exactly one of at_s and when, was both."),
        ("{what: source_stops, when: {agent: beetle}}",
         "events[0].when: expected exactly one of gas_above_ppm and within_m, was none."),
        ("{what: source_stops, when: {agent: beetle, within_m: 1}}",
         "events[0].when.of_m: expected a place beside within_m, and none without it, was none."),
        ("{what: source_stops, when: {agent: beetle, gas_above_ppm: 1, delay_s: 0.25}}",
         "events[0].when.delay_s: expected a whole number of 100 ms ticks, was 0.25 s. Nearest: 0.2 or 0.3."),
        ("{what: source_stops, when: {agent: betle, gas_above_ppm: 1}}",
         "events[0].when.agent: expected the name of an agent (beetle), was 'betle'. Did you mean beetle?"),
        ("{what: source_stop, at_s: 1}", "events[0].what: expected one of source_starts, source_stops, "),
        ("{what: source_stops, at_s: 1, source: 1}",
         "events[0].source: expected the place of a source in gas.sources, from 0 to 0, was 1."),
        ("{what: source_moves, at_s: 1, to_m: [7, 1, 1]}",
         "events[0].to_m: expected a point in the room's air, was [7, 1, 1], outside the room"),
        ("{what: sensor_sticks, at_s: 1, agent: beetle, sensor: nos}",
         "events[0].sensor: expected the name of a sensor of beetle (nose, wind), was 'nos'. Did you mean nose?"),
        ("{what: sensor_sticks, at_s: 1, agent: ant, sensor: nose}",
         "events[0].agent: expected the name of an agent (beetle), was 'ant'."),
        ("{what: rotor_weakens, at_s: 1, agent: beetle, rotor: 4, share: 0.5}",
         "events[0].rotor: expected a rotor of iris, from 0 to 3, was 4."),
        ("{what: rotor_weakens, at_s: 1, agent: beetle, rotor: 0, share: 1.5}",
         "events[0].share: expected a number from 0 to 1, was 1.5."),
        ("{what: radio_lost, at_s: 1}",
         "events[0].what: expected no event of radio in a scenario without channels, was radio_lost."),
    ],
)  # fmt: skip
def test_an_event_that_cannot_be_is_refused(event, expected):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"events=[{event}]"], checks=[check])
    assert expected in str(caught.value)


HVAC = "{name: hvac, start: {command: [cat]}, writes: [ventilation, state]}"
FMU = (
    "{name: hvac, start: {fmu: ./hvac.fmu}, writes: [state, ventilation], "
    "outputs: {state: {is_on: on}, ventilation: {share: share}}}"
)


@pytest.mark.parametrize(
    ("when", "expected", "participant"),
    [
        ("{value: state.is_on}", "events[0].when: expected exactly one of agent and participant, was none.", HVAC),
        ("{agent: beetle, participant: hvac, value: state.is_on}",
         "events[0].when: expected exactly one of agent and participant, was agent and participant.", HVAC),
        ("{agent: beetle, gas_above_ppm: 1, above: 2}",
         "events[0].when.above: expected no above beside agent, was one. above belongs to participant.", HVAC),
        ("{participant: hvac, value: state.is_on, gas_above_ppm: 2}",
         "events[0].when.gas_above_ppm: expected no gas_above_ppm beside participant, was one.", HVAC),
        ("{participant: hvac, above: 2}",
         "events[0].when.value: expected WORD.NAME, a word of the participant's writes and the name of a value that it "
         "writes there, was none. For example when: {participant: hvac, value: state.is_on}.", HVAC),
        ("{participant: hvac, value: is_on}", "events[0].when.value: expected WORD.NAME, a word of ", HVAC),
        ("{participant: hvac, value: state.is_on, above: 1, below: 2}",
         "events[0].when: expected at most one of above and below, was above and below.", HVAC),
        ("{participant: hvca, value: state.is_on}",
         "events[0].when.participant: expected the name of a participant (hvac), was 'hvca'. Did you mean hvac?", HVAC),
        ("{participant: hvac, value: stat.is_on}",
         "events[0].when.value: expected a value on a port of hvac's own (state.NAME), was 'stat.is_on'. "
         "Did you mean state?", HVAC),
        ("{participant: hvac, value: ventilation.share}",
         "events[0].when.value: expected a value on a port of hvac's own (state.NAME), was 'ventilation.share'.", HVAC),
        ("{participant: hvac, value: state.on}",
         "events[0].when.value: expected a value on a port of hvac's own (state.is_on), was 'state.on'.", FMU),
    ],
)  # fmt: skip
def test_a_condition_about_a_value_that_cannot_be_is_refused(when, expected, participant):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(
            "tiny_room", overrides=[f"events=[{{what: source_stops, when: {when}}}]", f"participants=[{participant}]"]
        )
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("event", "change", "expected"),
    [
        ("{what: source_stops, at_s: 1}", "gas.tape=true",
         "events[0].what: expected no event of a source with gas that cannot follow it, was gas.tape: true."),
        ("{what: source_stops, at_s: 1}", "gas.model=gaussian_plume",
         "events[0].what: expected no event of a source with gas that cannot follow it, was gas.model: gaussian_plume"),
        ("{what: wind_changes, at_s: 1, share: 2}", "gas.tape=true",
         "events[0].what: expected no event of the wind with gas that cannot follow it, was gas.tape: true."),
        ("{what: wind_changes, at_s: 1, inlet_velocity_m_s: [0, 1, 0]}", "wind={solver: {file: ./wind.csv}}",
         "events[0].inlet_velocity_m_s: expected none where the wind is stored, and not made of an inlet, was one."),
        ("{what: wind_changes, at_s: 1, share: -1}", "seed=2",
         "events[0].share: expected a number of at least 0, was -1."),
        ("{what: source_rate, at_s: 1, filaments_per_s: 3}", "gas.sources[0].release={kind: variable}",
         "events[0].source: expected a source whose release is constant or poisson, was 0, whose release is variable."),
        ("{what: rotor_weakens, at_s: 1, agent: beetle, rotor: 0, share: 0.5}",
         "agents[0].vehicle={model: rover, start_m: [4.5, 2.5, 0.2]}",
         "events[0].agent: expected an agent whose vehicle has rotors, was 'beetle', which has a rover."),
        ("{what: sensor_biased, at_s: 1, agent: beetle, sensor: wind, bias: 1}",
         "agents[0].sensors=[{model: tgs2600, name: nose}, {model: lidar_2d, name: wind}]",
         "events[0].sensor: expected a sensor that has bias as a setting, was 'wind', a lidar_2d."),
    ],
)  # fmt: skip
def test_an_event_that_does_not_fit_the_rest_is_refused(event, change, expected):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"events=[{event}]", change])
    assert expected in str(caught.value)


def test_a_channel_that_is_not_there_is_refused():
    with pytest.raises(ScenarioError) as caught:
        load_scenario("swarm_tiny", overrides=["events=[{what: radio_lost, at_s: 1, channel: radi}]"])
    assert "events[0].channel: expected the name of a channel (radio), was 'radi'. Did you mean radio?" in str(
        caught.value
    )


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (["events=[{what: door_opens, at_s: 1, door: gat}]"],
         "events[0].door: expected the name of a door in environment.doors (gate), was 'gat'. Did you mean gate?"),
        (["events=[{what: door_closes, at_s: 1, door: gate}]"],
         "events[0].what: expected an event of a door that is open then, was door_closes of gate, "
         "which is closed from the start. Leave it out, or write is_open: true at the door."),
        (["events=[{what: door_opens, at_s: 1, door: gate}, {what: door_opens, at_s: 3, door: gate}]"],
         "events[1].what: expected an event of a door that is closed then, was door_opens of gate, "
         "which is open since 1 s."),
        (["gas.tape=true"],
         "events[0].what: expected no event of a door with gas that cannot follow it, was gas.tape: true."),
        (["environment.doors[0].max_m=[3.25, 2.75, 3]"],
         "environment.doors[0]: expected a door inside the room, which reaches from [0, 0, 0] to [6, 4, 2.5] m, "
         "was [3, 1.25, 0] to [3.25, 2.75, 3] m. Move it, or cut it to the room."),
        (["environment.doors[0].min_m=[3, 0, 0]", "environment.doors[0].max_m=[3.25, 1, 2]"],
         "environment.doors[0]: expected a door that closes a gap: at least one cell of air in it, "
         "was [3, 0, 0] to [3.25, 1, 2] m, which is solid without it. Leave a gap in the wall where the door is."),
        (["environment.doors[0].name=lintel", "events=[]"],
         "environment.doors[0].name: expected a name that no other door or box of the room has, was 'lintel'."),
        (["environment.doors[0].is_open=true", "events=[{what: door_closes, at_s: 1, door: gate}]",
          "agents[0].vehicle.start_m=[3.1, 2, 0.2]"],
         "events[0].door: expected a door that closes on no vehicle's start, no source and no probe, was gate, which "
         "closes on agents[0].vehicle.start_m. Move the door, or agents[0].vehicle.start_m."),
        (["environment.doors[0].is_open=true", "events=[{what: door_closes, at_s: 1, door: gate}]",
          "probes=[{name: doorway, position_m: [3.1, 2, 1]}]"],
         "events[0].door: expected a door that closes on no vehicle's start, no source and no probe, was gate, which "
         "closes on probes[0].position_m. Move the door, or probes[0].position_m."),
        (["agents[0].vehicle.start_m=[3.1, 2, 0.2]"],
         "agents[0].vehicle.start_m: expected a point in the room's air, was [3.1, 2, 0.2], inside gate."),
        (["environment.layout.openings=[{name: out, kind: outlet, min_m: [6, 3, 1], max_m: [6, 4, 2]}]",
          "environment.layout.outlet={min_m: [0.5, 0, 1], max_m: [1.5, 0, 2]}"],
         "environment.doors: expected a way for the air from the inlet to the outlet, whichever doors are closed, "
         "was none with gate closed."),
        (["wind={solver: {file: ./wind.csv}}"],
         "environment.doors: expected none where the wind is stored: with a door it would be another, was some."),
    ],
)  # fmt: skip
def test_a_door_that_cannot_be_is_refused(changes, expected):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("event_door", overrides=changes, checks=[check])
    assert expected in str(caught.value)


def test_too_many_rooms_are_refused():
    doors = [f"{{name: door_{i}, is_open: true, min_m: [3, {1.25 + 0.25 * i}, 0], max_m: [3.25, {1.5 + 0.25 * i}, 2]}}"
             for i in range(5)]  # fmt: skip
    events = [f"{{what: door_closes, door: door_{i}, when: {{agent: beetle, gas_above_ppm: 1}}}}" for i in range(5)]
    with pytest.raises(ScenarioError) as caught:
        load_scenario(
            "event_door",
            overrides=[f"environment.doors=[{', '.join(doors)}]", f"events=[{', '.join(events)}]"],
            checks=[check],
        )
    assert "events: expected at most 16 combinations of closed doors and inlets" in str(caught.value)
    assert "was 32. Give the events of doors and wind times (at_s)" in str(caught.value)


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"above": 2.0}, "once state.level of hvac is above 2"),
        ({"repeats": True}, "each time that state.level of hvac is true"),
        ({"below": 1.0, "delay_s": 3.0}, "3 s after state.level of hvac is below 1"),
        ({"repeats": True, "delay_s": 3.0}, "3 s after each time that state.level of hvac is true"),
    ],
)
def test_a_condition_is_told_in_words(more, text):
    assert TriggerSpec(participant="hvac", value="state.level", **more).text == text
