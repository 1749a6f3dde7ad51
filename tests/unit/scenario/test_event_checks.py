"""Events that cannot be are told with their place, what is expected, and a remedy."""

import pytest

from gslcosim.environment.of_scenario.places import problems_of_places
from gslcosim.errors import ScenarioError
from gslcosim.scenario import load_scenario


def check(scenario, directory):
    return problems_of_places(scenario, scenario_dir=directory)


@pytest.mark.parametrize(
    ("event", "told"),
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
def test_an_event_that_cannot_be_is_refused(event, told):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"events=[{event}]"], checks=[check])
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("event", "change", "told"),
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
def test_an_event_that_does_not_fit_the_rest_is_refused(event, change, told):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"events=[{event}]", change])
    assert told in str(caught.value)


def test_a_channel_that_is_not_there_is_refused():
    with pytest.raises(ScenarioError) as caught:
        load_scenario("swarm_tiny", overrides=["events=[{what: radio_lost, at_s: 1, channel: radi}]"])
    assert "events[0].channel: expected the name of a channel (radio), was 'radi'. Did you mean radio?" in str(
        caught.value
    )
