"""Rules between the fields of one block."""

import pytest

from gslcosim.scenario.models.scenario import OpeningSpec, WindSpec

A_LAYOUT = "environment:\n  layout: {kind: warehouse_empty, size_m: [15, 10, 8]}"
AN_OBSTACLE = "size_m: [15, 10, 8], obstacles: [{name: crate, min_m: [1, 1, 0], max_m: [2, 1, 1]}]"
AN_INLET = "size_m: [15, 10, 8], inlet: {min_m: [0, 0, 0], max_m: [1, 1, 1]}"


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (A_LAYOUT, "environment: {}",
         "hall.yaml:3: environment: expected exactly one of layout, path, gsl_bench, gaden and geometry, was none. "
         "layout generates a room, path takes the folder of one made before."),
        (A_LAYOUT, f"{A_LAYOUT}\n  path: .",
         "hall.yaml:3: environment: expected exactly one of layout, path, gsl_bench, gaden and geometry, was layout "
         "and path. layout generates a room, path takes the folder of one made before."),
        ("{python: dung_beetle}", "{}",
         "hall.yaml:10: agents[0].start: expected exactly one of python, command, ros2, attach: true and process_of, "
         "was none. For example start: {python: dung_beetle}."),
        ("{python: dung_beetle}", "{python: dung_beetle, command: [sh]}",
         "hall.yaml:10: agents[0].start: expected exactly one of python, command, ros2, attach: true and process_of, "
         "was python and command. For example start: {python: dung_beetle}."),
        ("{python: dung_beetle}", "{python: dung_beetle, door: tcp}",
         "hall.yaml:10: agents[0].start.door: expected zenoh or stdio for a Python agent, was tcp. "
         "Leave it out, or start a program that speaks the gateway's frames with command."),
        ("{python: dung_beetle}", "{python: dung_beetle, door: stdio, format: json}",
         "hall.yaml:10: agents[0].start.format: expected msgpack for a Python agent, was json. "
         "Leave it out, or start a program that speaks the gateway's frames with command."),
        ("{python: dung_beetle}", "{attach: true, door: stdio}",
         "hall.yaml:10: agents[0].start.door: expected zenoh, tcp or unix for an agent that attaches itself, "
         "was stdio. Standard input and output belong to a program that is started here, with command."),
        ("{python: dung_beetle}", "{command: [sh], format: json}",
         "hall.yaml:10: agents[0].start.format: expected msgpack with door: zenoh, was json. "
         "Add door: stdio, tcp or unix to speak through the gateway."),
        ("{python: dung_beetle}", "{command: [sh], observations: asked}",
         "hall.yaml:10: agents[0].start.observations: expected all with door: zenoh, was asked. "
         "Add door: stdio, tcp or unix to speak through the gateway."),
        ("{python: dung_beetle}", "{command: [sh], door: studio}",
         "hall.yaml:10: agents[0].start.door: expected one of zenoh, stdio, tcp or unix, was 'studio'. "
         "Did you mean stdio?"),
        ("name: hall", "name: hall\nwind: {average_from_s: 5}",
         "hall.yaml:3: wind.average_from_s: expected an end_time_s beside it, was 5 alone. Without end_time_s the wind "
         "is the mean of the part that has settled."),
        ("name: hall", "name: hall\nwind: {end_time_s: 5, save_every_s: 2, save_from_s: 4}",
         "hall.yaml:3: wind.end_time_s: expected at least save_from_s and save_every_s together, 6, was 5. "
         "Give the time at which the solve ends."),
        ("name: hall", "name: hall\nwind: {end_time_s: 5, save_every_s: 2, average_from_s: 1}",
         "hall.yaml:3: wind.save_every_s: expected no average_from_s beside it, was both. "
         "Frames show the wind as it changes; a mean does not change."),
        ("name: hall", "name: hall\nwind: {solver: {}}",
         "hall.yaml:3: wind.solver: expected auto, built_in, openfoam, uniform, stored or {file: PATH}, was an empty "
         "block. For example solver: {file: wind.csv}."),
        ("name: hall", "name: hall\nwind: {inlet_schedule: {times_s: [0, 2, 1], shares: [0, 1, 2]}}",
         "hall.yaml:3: wind.inlet_schedule.times_s: expected times from 0 on, each later than the one before, "
         "was [0.0, 2.0, 1.0]. For example times_s: [0, 10, 20]."),
        ("name: hall", "name: hall\nwind: {inlet_schedule: {times_s: [0, 2], shares: [0, 1, 2]}}",
         "hall.yaml:3: wind.inlet_schedule.shares: expected as many shares as times, 2, was 3. "
         "Each time has its share of inlet_velocity_m_s."),
        ("name: hall", "name: hall\nwind: {end_time_s: 5, average_from_s: 5}",
         "hall.yaml:3: wind.average_from_s: expected less than end_time_s, 5, was 5. "
         "For example 2.5, or leave it out for the wind at the end of the solve."),
        ("warehouse_empty, size_m", "warehouse_simpel, size_m",
         "hall.yaml:4: environment.layout.kind: expected one of warehouse_empty, warehouse_simple, warehouse_complex, "
         "office, home, cluttered_rooms, plant or wind_tunnel, was 'warehouse_simpel'. Did you mean warehouse_simple?"),
        ("warehouse_empty, size_m", "warehouse_complex, filled_least_frac: 2, size_m",
         "hall.yaml:4: environment.layout.filled_least_frac: expected a number from 0 to 1, was 2."),
        ("size_m: [15, 10, 8]", f"{AN_INLET.replace('[1, 1, 1]', '[0, 1, 1]')}, inlet_size_m: [1, 2]",
         "hall.yaml:4: environment.layout.inlet_size_m: expected no size beside inlet, which has its own, was both. "
         "Leave out inlet_size_m, or inlet to have it in its usual place."),
        ("{python: dung_beetle}", "{ros2: {endpoint: 'tcp/localhost:99999'}}",
         "hall.yaml:10: agents[0].start.ros2.endpoint: expected an address of this machine with a port from 1 to "
         "65535, was 'tcp/localhost:99999'. For example tcp/localhost:7447."),
        ("size_m: [15, 10, 8]", AN_OBSTACLE,
         "hall.yaml:4: environment.layout.obstacles[0].max_m: expected each number greater than that of min_m, [1, 1, "
         "0], was [2, 1, 1]. min_m and max_m are opposite corners."),
        ("size_m: [15, 10, 8]", AN_INLET,
         "hall.yaml:4: environment.layout.inlet.max_m: expected one number equal to that of min_m, [0, 0, 0], and two "
         "greater, was [1, 1, 1]. An opening is a rectangle on one side of the room."),
    ],
)  # fmt: skip
def test_fields_that_do_not_fit_together_are_one_problem(problem_lines, old, new, line):
    assert problem_lines((old, new)) == [line]


def test_the_wind_at_the_end_of_a_short_solve_needs_no_average():
    assert WindSpec(end_time_s=5.0, average_from_s=None).average_from_s is None


def test_an_opening_may_lie_on_any_side():
    for flat in range(3):
        far = tuple(0.0 if axis == flat else 1.0 for axis in range(3))
        assert OpeningSpec(min_m=(0.0, 0.0, 0.0), max_m=far).max_m == far
