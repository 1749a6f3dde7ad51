import math

import numpy as np
import pytest
from built_messages import build_briefing

from gslcosim.base.errors import MethodError
from gslcosim.contract.messages import Briefing, SensorDescription
from gslcosim.contract.record import NumericArray
from gslcosim_search.swarms.sniffy_bug import (
    TABLES,
    Bug,
    BugParameters,
    avoidance_direction,
    bracketing_beams,
    find_four_ranges,
    off_line_m,
    remove_blocked_parts,
    searching_waypoint,
    tracking_waypoint,
)

MANUAL = TABLES["manual"]
OPEN = (9.0, 9.0, 9.0, 9.0)
FOUR = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]


def at(*metres: float) -> np.ndarray:
    return np.array(metres, dtype=np.float64)


def table(**changes: float) -> BugParameters:
    return BugParameters(**{**vars(MANUAL), **changes})


def test_a_searching_waypoint_is_the_sum_worked_out_by_hand():
    """x = (1, 2), last = (3, 2), drawn = (1, 12), w' = 0.3, r_r = 0.7: (1, 2) + (0.6, 0) + (0, 7)."""
    waypoint = searching_waypoint(at(1, 2), at(3, 2), at(1, 12), inertia=0.3, draw=0.7)
    assert waypoint == pytest.approx([1.6, 9.0])


def test_a_tracking_waypoint_is_the_sum_worked_out_by_hand():
    """x = (1, 1), last = (3, 1), p = (1, 4), g = (6, 6), doped: (1, 1) + 0.271 (2, 0) - 0.333 (0, 3) + 1.856 (5, 5)."""
    waypoint = tracking_waypoint(at(1, 1), at(3, 1), at(1, 4), at(6, 6), TABLES["evolved_with_doping"])
    assert waypoint == pytest.approx([1 + 0.542 + 9.28, 1 - 0.999 + 9.28])


@pytest.mark.parametrize(
    ("bearing_deg", "yaw_deg", "beams"),
    [(10, 0, (0, 1)), (100, 0, (1, 2)), (-10, 0, (3, 0)), (10, 45, (3, 0)), (0, 0, (0, 1))],
)
def test_a_bearing_lies_between_two_neighbouring_beams(bearing_deg, yaw_deg, beams):
    assert bracketing_beams(math.radians(bearing_deg), math.radians(yaw_deg)) == beams


def test_left_of_the_line_is_positive():
    assert off_line_m(at(2, 1), at(0, 0), at(5, 0)) == pytest.approx(1.0)
    assert off_line_m(at(2, -3), at(0, 0), at(5, 0)) == pytest.approx(-3.0)
    assert off_line_m(at(2, -3), at(1, 1), at(1, 1)) == 0.0


def test_robots_and_walls_push_and_the_waypoint_pulls():
    """Pull (1, 0); a robot 0.3 m to the right pushes by 15 * 0.5 to the left: (1, 7.5), as a unit vector."""
    away = avoidance_direction(at(0, 0), at(1, 0), OPEN, 0.0, [at(0, -0.3)], MANUAL)
    assert away == pytest.approx(at(1, 7.5) / math.hypot(1, 7.5))
    # A wall 1 m ahead pushes back by 5 * 0.5.
    assert avoidance_direction(at(0, 0), at(1, 0), (1.0, 9.0, 9.0, 9.0), 0.0, [], MANUAL) == pytest.approx([-1.0, 0.0])


def test_nothing_is_flown_into_what_is_too_near():
    assert remove_blocked_parts(at(0.6, 0.8), (0.2, 9.0, 9.0, 9.0), 0.0, 0.3) == pytest.approx([0.0, 0.8])
    assert remove_blocked_parts(at(0.6, 0.8), (9.0, 9.0, 0.2, 0.2), 0.0, 0.3) == pytest.approx([0.6, 0.8])


def test_it_flies_along_one_beam_at_a_time_and_keeps_to_the_line():
    bug, place = Bug(MANUAL), at(1, 1)
    bug.aim(place, at(9, 5))
    off, steps = [], []
    while math.dist(place, (9, 5)) > 0.5:
        steps.append(bug.direction(place, OPEN, 0.0, []))
        place = place + 0.05 * steps[-1]
        off.append(abs(off_line_m(place, at(1, 1), at(9, 5))))
        assert len(steps) < 400
    assert {tuple(np.round(step).astype(int)) for step in steps} == {(1, 0), (0, 1)}
    assert max(off) <= MANUAL.line_m + 0.05
    assert len(steps) * 0.05 == pytest.approx(8 + 4, abs=0.8)  # the way along the axes


def test_a_near_robot_makes_it_leave_the_line():
    bug = Bug(MANUAL)
    bug.aim(at(0, 0), at(5, 0))
    assert bug.direction(at(0, 0), OPEN, 0.0, [at(0, 0.5)])[1] < -0.5
    assert bug.direction(at(0, 0), OPEN, 0.0, [at(0, 0.9)]).tolist() == [1.0, 0.0]


ROOM = (0.0, 0.0, 12.0, 10.0)


def ranges_in(place, boxes) -> tuple[float, ...]:
    """Front, left, back, right in the room with rectangular boxes (x0, y0, x1, y1)."""
    found = []
    for beam in range(4):
        axis, ahead = beam % 2, beam < 2
        reach = (ROOM[2 + axis] - place[axis]) if ahead else place[axis] - ROOM[axis]
        for box in boxes:
            if box[1 - axis] <= place[1 - axis] <= box[3 - axis]:
                gap = box[axis] - place[axis] if ahead else place[axis] - box[2 + axis]
                reach = min(reach, gap) if gap >= 0 else reach
        found.append(min(reach, 4.0))
    return tuple(found)


def flown(boxes, start, goal, *, parameters: BugParameters, within_m: float = 0.6, seconds: int = 240):
    """Fly at 0.5 m/s in steps of 0.1 m; return whether it arrived, and the least distance to any box or wall seen."""
    bug, place, least = Bug(parameters, past_m=0.5), at(*start), 9.0
    bug.aim(place, at(*goal))
    for _ in range(seconds * 5):
        ranges = ranges_in(place, boxes)
        least = min(least, *ranges)
        assert not any(b[0] <= place[0] <= b[2] and b[1] <= place[1] <= b[3] for b in boxes), f"in a box at {place}"
        if math.dist(place, goal) < within_m:
            return True, least
        place = place + 0.1 * remove_blocked_parts(bug.direction(place, ranges, 0.0, []), ranges, 0.0, 0.3)
    return False, least


WALLS = {
    "across": [(5.8, 3.0, 6.2, 7.0)],
    "long": [(5.8, 2.0, 6.2, 10.0)],
    "thin": [(6.0, 3.0, 6.01, 7.0)],
    "corner": [(5.8, 3.0, 6.2, 8.0), (3.5, 7.8, 6.2, 8.0)],
    "block": [(4.5, 3.5, 7.5, 6.5)],
}


@pytest.mark.parametrize("boxes", WALLS.values(), ids=WALLS.keys())
@pytest.mark.parametrize("wall_m", [0.8, 1.407])
def test_it_finds_its_way_round_walls_without_touching_them(boxes, wall_m):
    arrived, least = flown(boxes, (2.0, 5.0), (10.0, 5.2), parameters=table(wall_m=wall_m))
    assert arrived
    assert least > 0.25


def test_it_goes_to_the_side_of_a_wall_that_is_nearer_to_the_waypoint():
    for goal_y, sign in ((6.0, 1.0), (4.0, -1.0)):
        bug = Bug(table(line_m=0.05))
        bug.aim(at(4.6, 5.0), at(10.0, goal_y))
        place = at(4.6, 5.0)
        for _ in range(6):
            place = place + 0.1 * bug.direction(place, ranges_in(place, WALLS["across"]), 0.0, [])
        assert sign * (place[1] - 5.0) > 0.3


def test_where_everything_is_near_it_goes_where_there_is_most_room():
    bug = Bug(table(wall_m=1.5))
    bug.aim(at(0, 0), at(5, 1))
    assert bug.direction(at(0, 0), (0.4, 0.5, 0.6, 1.2), 0.0, []) == pytest.approx([0.0, -1.0], abs=1e-12)


def briefing_with(*directions) -> Briefing:
    sensors = tuple(
        SensorDescription(
            name=f"ranges_{i}", model="any", quantity="range", unit="m", mount_body_m=(0.0, 0.0, 0.0),
            directions_body=NumericArray.from_array(np.array(rows, np.float32)),
        )
        for i, rows in enumerate(directions)
    )  # fmt: skip
    return build_briefing(agent="bug", sensors=sensors)


def test_the_four_range_finders_are_found_among_others():
    assert find_four_ranges(briefing_with([[1.0, 0.0, 0.0]], FOUR)).name == "ranges_1"


def test_one_beam_is_not_enough_and_the_remedy_is_reported():
    with pytest.raises(MethodError, match="four_range_finders"):
        find_four_ranges(briefing_with([[1.0, 0.0, 0.0]]))
