"""Rules between distant parts of a scenario."""

import pytest

from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.sensors import SENSORS
from gslcosim_services.sensing import SENSOR_MODELS


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("      - {model: tgs2600, name: nose}", "      - {model: tgs2600, name: nose}\n      - {model: anemometer, "
         "name: nose}",
         "hall.yaml:14: agents[0].sensors[1].name: expected a name that no other of agents[0].sensors has, was "
         "'nose', as agents[0].sensors[0].name. For example nose_2."),
        ("agents:\n", "agents:\n  - {name: beetle, start: {attach: true}, vehicle: {start_m: [1, 1, 0]}, "
         "sensors: [{model: tgs2600, name: nose}]}\n",
         "hall.yaml:10: agents[1].name: expected a name that no other of agents has, was 'beetle', as agents[0].name. "
         "For example beetle_2."),
        ("size_m: [15, 10, 8]", "obstacles: [{name: a, min_m: [1, 1, 0], max_m: [2, 2, 1]}, {name: a, min_m: [3, 1, "
         "0], max_m: [4, 2, 1]}]",
         "hall.yaml:4: environment.layout.obstacles[1].name: expected a name that no other of "
         "environment.layout.obstacles has, was 'a', as environment.layout.obstacles[0].name. For example a_2."),
        ("name: hall", "name: hall\ntick_ms: 50",
         "hall.yaml:3: tick_ms: expected a multiple of the physics step of 4 ms, was 50. Nearest: 48 or 52."),
        ("name: hall", "name: hall\nrecording: {gas_every_s: 0.25}",
         "hall.yaml:3: recording.gas_every_s: expected a whole number of 100 ms ticks, was 0.25 s. Nearest: 0.2 or "
         "0.3."),
        ("name: hall", "name: hall\nreferee: {stop: {time_limit_s: 10.01}}",
         "hall.yaml:3: referee.stop.time_limit_s: expected a whole number of 100 ms ticks, was 10.01 s. "
         "Nearest: 10 or 10.1."),
        ("gas:\n", "gas:\n  step_s: 0.03\n",
         "hall.yaml:6: gas.step_s: expected a whole multiple or a whole fraction of the tick of 0.1 s, was 0.03 s. "
         "Nearest: 0.05."),
        ("gas:\n", "gas:\n  step_s: 0.23\n",
         "hall.yaml:6: gas.step_s: expected a whole multiple or a whole fraction of the tick of 0.1 s, was 0.23 s. "
         "Nearest: 0.2."),
        ("gas:\n", "gas:\n  warm_up_s: 10.05\n",
         "hall.yaml:6: gas.warm_up_s: expected a whole number of gas steps of 0.1 s, was 10.05 s. Nearest: 10 or "
         "10.1."),
    ],
)  # fmt: skip
def test_parts_that_do_not_fit_together_are_one_problem(problem_lines, old, new, line):
    assert problem_lines((old, new)) == [line]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("name: hall", "name: hall\ntick_ms: 20\nrecording: {gas_every_s: 0.02}"),
        ("gas:\n", "gas:\n  step_s: 0.05\n  warm_up_s: 0\n"),
        ("gas:\n", "gas:\n  step_s: 0.2\n  warm_up_s: 10.2\n"),
        ("name: hall", "name: hall\nrecording: {gas_every_s: 0.3}"),
    ],
)
def test_times_that_are_whole_numbers_of_ticks_and_steps_are_accepted(scenario_file, old, new):
    assert load_scenario(scenario_file((old, new))).name == "hall"


def test_a_folder_of_an_environment_must_be_there(problem_lines, tmp_path):
    (line,) = problem_lines(("layout: {kind: warehouse_empty, size_m: [15, 10, 8]}", "path: rooms/hall"))
    assert line == (
        "hall.yaml:4: environment.path: expected the folder of an environment, was 'rooms/hall'. "
        "There is no folder rooms/hall."
    )
    (tmp_path / "rooms").mkdir()
    (tmp_path / "rooms" / "hall").touch()
    (line,) = problem_lines(("layout: {kind: warehouse_empty, size_m: [15, 10, 8]}", "path: rooms/hall"))
    assert line.endswith("There is no folder but a file rooms/hall.")


def test_an_environments_folder_is_relative_to_the_scenario(scenario_file, tmp_path):
    (tmp_path / "rooms").mkdir()
    loaded = load_scenario(scenario_file(("layout: {kind: warehouse_empty, size_m: [15, 10, 8]}", "path: rooms")))
    assert loaded.scenario.environment.path == "rooms"
    assert loaded.directory == tmp_path


def test_values_of_a_wrong_kind_are_left_to_the_models(problem_lines):
    lines = problem_lines(
        ("name: hall", "name: hall\ntick_ms: fast\nrecording: {gas_every_s: often}"), ("agents:\n", "agents: 5\nx:\n")
    )
    assert [line.partition(": expected")[0] for line in lines] == [
        "hall.yaml:3: tick_ms", "hall.yaml:4: recording.gas_every_s", "hall.yaml:10: agents", "hall.yaml:11: x"
    ] or lines[0].endswith("problems")  # fmt: skip


def test_the_sensors_are_those_that_the_cores_have():
    """Scenario is the lower layer and may not ask them, so it keeps the names itself."""
    assert tuple(SENSOR_MODELS) == SENSORS


TWO_MORE = """agents:
  - {name: moth, start: {process_of: beetle}, vehicle: {start_m: [3, 1, 0]}, sensors: [{model: pid, name: nose}]}
  - {name: wasp, start: START, vehicle: {start_m: [5, 1, 0]}, sensors: [{model: pid, name: nose}]}
"""


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ("{process_of: moth}", "process_of: expected an agent with a process of its own (beetle), was 'moth'."),
        ("{process_of: wasp}", "process_of: expected an agent with a process of its own (beetle), was 'wasp'."),
        ("{process_of: betle}", "process_of: expected an agent with a process of its own (beetle), was 'betle'. "
         "Did you mean beetle?"),
        ("{process_of: beetle, door: stdio}", "door: expected no door beside process_of: beetle's is taken, was stdio. "
         "Give door, format and observations with beetle."),
    ],
)  # fmt: skip
def test_an_agent_runs_only_in_a_process_of_its_own_kind(problem_lines, start, end):
    assert problem_lines(("agents:\n", TWO_MORE.replace("START", start))) == [f"hall.yaml:10: agents[1].start.{end}"]


def test_agents_are_listed_by_the_process_that_runs_them(scenario_file):
    path = scenario_file(("agents:\n", TWO_MORE.replace("START", "{attach: true}")))
    scenario = load_scenario(path).scenario
    assert scenario.agents_by_process() == {"beetle": ("moth", "beetle"), "wasp": ("wasp",)}


@pytest.mark.parametrize(
    ("channels", "lines"),
    [
        ("[{name: radio}, {name: radio}]", ["channels[1].name: expected a name that no other of channels has, was "
         "'radio', as channels[0].name. For example radio_2."]),
        ("[{name: radio, members: [moth, waps]}]",
         ["channels[0].members: expected at least two agents, was moth. Leave the channel out, or add an agent.",
          "channels[0].members[1]: expected the name of an agent (moth, wasp, beetle), was 'waps'. Did "
          "you mean wasp?"]),
        ("[{name: radio, members: some}]",
         ["channels[0].members: expected all or a list of at least one name, was 'some'."]),
        ("[{name: radio, loss_frac: 1.5, delay_ticks: 0}]",
         ["channels[0].loss_frac: expected a number from 0 to 1, was 1.5.",
          "channels[0].delay_ticks: expected a whole number from 1 to 1000, was 0."]),
    ],
)  # fmt: skip
def test_a_channel_that_cannot_be_is_refused(problem_lines, channels, lines):
    agents = TWO_MORE.replace("START", "{attach: true}")
    found = problem_lines(("agents:\n", agents), ("name: hall", f"name: hall\nchannels: {channels}"))
    assert sorted(line.removeprefix("hall.yaml:3: ") for line in found if "problems" not in line) == sorted(lines)


@pytest.mark.parametrize(
    ("start", "name", "end"),
    [
        ("{command: [sh], door: stdio, observations: asked}", "wasp",
         "expected agents that get all observations, for messages come with any of them, was 'wasp', with "
         "start.observations: asked. Set observations: all for wasp."),
        ("{attach: true}", "all",
         "expected agents with other names than 'all', which addresses all of them, was 'all'. Rename the agent."),
    ],
)  # fmt: skip
def test_an_agent_that_no_message_can_reach_is_no_member(problem_lines, start, name, end):
    agents = TWO_MORE.replace("START", start).replace("wasp", name)
    found = problem_lines(("agents:\n", agents), ("name: hall", "name: hall\nchannels: [{name: radio}]"))
    assert found == [f"hall.yaml:3: channels[0].members: {end}"]


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("name: nose}", "name: nose, period_s: 0.25}",
         "hall.yaml:13: agents[0].sensors[0].period_s: expected a whole number of 100 ms ticks, was 0.25 s. Nearest: "
         "0.2 or 0.3."),
        ("tgs2600, name: nose}", "averaging, name: nose, averaging_s: 0.25}",
         "hall.yaml:13: agents[0].sensors[0].averaging_s: expected a whole number of 100 ms ticks, was 0.25 s. "
         "Nearest: 0.2 or 0.3."),
        ("name: nose}", "name: nose}\n      - {model: pid, name: nose_ppm}",
         "hall.yaml:14: agents[0].sensors[1].name: expected a name that no estimate of a MOX sensor has, was "
         "'nose_ppm'. For example true_gas."),
        ("gas:", "gas:\n  define: [{name: ethanol, specific_gravity: 2}]",
         "hall.yaml:6: gas.define[0].name: expected a name that no other gas has, was 'ethanol'. For example "
         "my_ethanol."),
        ("gas:", "gas:\n  define: [{name: steam, specific_gravity: 0.6, mox: [{sensor: pid, a: 1, b: -1}]}]",
         "hall.yaml:6: gas.define[0].mox[0].sensor: expected one of tgs2600, tgs2602, tgs2610, tgs2611, tgs2612 or "
         "tgs2620, was 'pid'. A pid is no MOX sensor."),
        ("gas:", "gas:\n  gas: freon\n  define: [{name: freom, specific_gravity: 3}]",
         "hall.yaml:6: gas.gas: expected one of ethanol, methane, hydrogen, propanol, chlorine, fluorine, acetone, "
         "neon, helium, biogas, butane, carbon_dioxide, carbon_monoxide, smoke or freom, was 'freon'. Did you mean "
         "freom?"),
        ("gas:", "gas:\n  model: playback",
         "hall.yaml:5: gas.playback: expected a folder of frames with model: playback, was none. For "
         "example model: playback, playback: {folder: my_frames}."),
        ("gas:", "gas:\n  tape: true\n  model: gaussian_plume",
         "hall.yaml:6: gas.tape: expected false, unless the gas is made of filaments that no vehicle moves, was true "
         "with model: gaussian_plume. Leave tape out."),
        ("gas:", "gas:\n  tape: true\n  rotor_downwash: true",
         "hall.yaml:6: gas.tape: expected false, unless the gas is made of filaments that no vehicle moves, was true "
         "with rotor_downwash. Leave tape out."),
        ("gas:", "gas:\n  model: meandering_plume\n  rotor_downwash: true",
         "hall.yaml:7: gas.rotor_downwash: expected false with a model without filaments of its own, was true with "
         "model: meandering_plume. Leave it out, or take model: filament."),
        ("model: tgs2600, name: nose}", "model: tdlas, name: nose, beam_body: [0, 0, 0]}",
         "hall.yaml:13: agents[0].sensors[0].beam_body: expected a direction that is not zero, was [0, 0, 0]. For "
         "example [1, 0, 0], ahead."),
    ],
)  # fmt: skip
def test_instruments_and_gases_that_cannot_be_are_refused(problem_lines, old, new, line):
    assert problem_lines((old, new)) == [line]


def test_missing_gas_frames_are_one_problem(problem_lines, tmp_path):
    (line,) = problem_lines(("gas:", "gas:\n  model: playback\n  playback: {folder: frames}"))
    assert line.startswith(
        "hall.yaml:7: gas.playback.folder: expected a folder of gas frames, or a movie, was 'frames'"
    )


def test_stored_gas_is_named_absolutely(scenario_file, tmp_path):
    (tmp_path / "frames").mkdir()
    loaded = load_scenario(scenario_file(("gas:", "gas:\n  model: playback\n  playback: {folder: frames}")))
    assert loaded.scenario.gas.playback.folder == str(tmp_path / "frames")


def test_a_defined_gas_can_be_released(scenario_file):
    gas = "gas:\n  gas: freon\n  define: [{name: freon, specific_gravity: 3, mox: [{sensor: tgs2600, a: 1, b: -1}]}]"
    assert load_scenario(scenario_file(("gas:", gas))).scenario.gas.gas == "freon"
