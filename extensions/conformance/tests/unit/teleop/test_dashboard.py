"""What a person sees of what the agent got."""

import math

import pytest
from observations import briefing, observation, reading

from gslcosim.contract.messages import RadioReception
from gslcosim_conformance.teleop import BAR_WIDTH, Dashboard, KeyControls


def shown(*observations, columns=100, rows=40, **fields):
    dashboard, controls = Dashboard(briefing()), KeyControls(briefing(), **fields)
    for each in observations:
        dashboard.see(each)
        controls.see(each)
    return dashboard.lines(controls, columns=columns, rows=rows)


def line_of(lines, text):
    (line,) = [line for line in lines if text in line]
    return line


def test_pose_time_and_status_are_there():
    lines = shown(observation(12, status="taking_off", velocity_world_m_s=(0.3, 0.4, 0.0)))
    assert "1.2 s of 20 s   taking off" in lines[1]
    assert "at (3.00, 2.00, 1.00) m   0.50 m/s   heading →" in lines[2]


def test_a_bar_and_a_curve_go_from_the_least_to_the_greatest_so_far():
    lines = shown(*(observation(i, readings=(reading(value),)) for i, value in enumerate((0.0, 8.0, 4.0))))
    line = line_of(lines, "nose")
    assert "4 ppm" in line
    assert line.count("█") - 1 == line.count("░") == BAR_WIDTH // 2
    assert line.endswith("▁█▅")


def test_a_direction_is_an_arrow():
    wind = reading((0.5, math.pi / 2), sensor="wind", quantity="apparent_wind", unit="m/s, rad")
    assert line_of(shown(observation(1, readings=(wind,))), "wind 2").endswith("from ↑")


def test_what_does_not_measure_and_what_is_full_is_said():
    lines = shown(
        observation(1, readings=(reading(1, is_warming_up=True), reading(9, sensor="pid", is_saturated=True)))
    )
    assert "does not measure now" in line_of(lines, "nose")
    assert "(full)" in line_of(lines, "pid")


def test_refusals_and_radio_are_reported():
    reception = RadioReception(sender="moth", channel="air", text="here", sent_tick=1)
    lines = shown(observation(3, notice="The waypoint is outside the room.", incoming=(reception,)))
    assert "! The waypoint is outside the room." in lines
    assert "radio  moth: here" in lines


def test_the_map_has_the_way_with_most_gas_marked_most():
    steps = [(1.0, 0.0), (2.0, 5.0), (3.0, 1.0), (4.0, 0.0)]
    lines = shown(
        *(observation(i, position_world_m=(x, 2.0, 1.0), readings=(reading(ppm),)) for i, (x, ppm) in enumerate(steps))
    )
    (row,) = [line for line in lines if "→" in line and line.startswith("│")]
    assert [sign for sign in row if sign not in "│ "] == ["·", "@", "∘", "→"]


def test_less_resistance_is_more_gas():
    steps = [(1.0, 50e3), (2.0, 10e3), (4.0, 50e3)]
    lines = shown(
        *(
            observation(i, position_world_m=(x, 2.0, 1.0), readings=(reading(r, quantity="resistance", unit="ohm"),))
            for i, (x, r) in enumerate(steps)
        )
    )
    (row,) = [line for line in lines if "→" in line and line.startswith("│")]
    assert row.replace(" ", "") == "│·@→│"


def test_turn_by_turn_the_question_is_seen():
    assert "YOU ARE ASKED" in shown(observation(1, awaiting_command=True), waits_for_questions=True)[1]
    assert "YOU ARE ASKED" not in shown(observation(1, awaiting_command=True))[1]


@pytest.mark.parametrize(("columns", "rows"), [(72, 22), (100, 24), (200, 60)])
def test_it_fits_the_terminal(columns, rows):
    lines = shown(
        observation(1, readings=tuple(reading(1, sensor=f"s{i}") for i in range(4))), columns=columns, rows=rows
    )
    assert len(lines) <= rows
    assert max(map(len, lines)) <= columns
    assert "give up" in lines[-1]
