"""With avoidance, what is not planned keeps clear as well: velocities, wheels, take-off and landing."""

import math

import pytest

from gslcosim.contract.messages import DriveSetpoint

WALL = ("wall", (7.0, 0.0, 0.0), (7.5, 10.0, 3.5))
LAND, TAKE_OFF = {"kind": "land"}, {"kind": "take_off"}
RADII_M = {"iris": 0.38, "crazyflie": 0.07, "holonomic": 0.15, "rover": 0.27}


def beam(low_m, high_m):
    return ("beam", (2.0, 2.0, low_m), (4.0, 4.0, high_m))


def velocity(*velocity_world_m_s):
    return {"kind": "velocity", "velocity_world_m_s": velocity_world_m_s}


# ---------------------------------------------------------------- velocity


@pytest.mark.parametrize(
    ("model", "avoidance"),
    [("iris", "2d"), ("iris", "3d"), ("crazyflie", "3d"), ("holonomic", "3d"), ("rover", "2d")],
)
@pytest.mark.parametrize("is_repeated", [False, True])
def test_a_velocity_ends_before_it_comes_too_near(hovering_pilot, model, avoidance, is_repeated):
    pilot = hovering_pilot({"model": model, "avoidance": avoidance}, obstacles=[WALL])
    for _ in range(80):
        pilot.step(**({"agent_0": velocity(0.8, 0.1, 0.0)} if is_repeated or pilot.tick == 45 else {}))
    body = pilot.body()
    clearance_m = RADII_M[model] + 0.05
    assert "velocity: expected a stop at least" in body.rejected_command
    assert body.phase == "holding"
    assert not pilot.touched()
    # At most a cell and a tick's way further from the wall than it must.
    assert clearance_m - 0.03 < 7.0 - body.position_world_m[0] < clearance_m + 0.25 + 0.15
    assert math.hypot(*body.velocity_world_m_s) < 0.05


def test_a_drive_ends_before_it_comes_too_near(make_pilot):
    pilot = make_pilot({"model": "rover", "avoidance": "2d"}, obstacles=[WALL], mode="lockstep")
    pilot.run(10)
    for _ in range(120):
        pilot.step(agent_0={"kind": "drive", "drive": DriveSetpoint(speed_m_s=0.8, yaw_rate_rad_s=0.0)})
    assert "drive: expected a stop at least 0.32 m from obstacles" in pilot.body().rejected_command
    assert not pilot.touched()
    assert 7.0 - pilot.body().position_world_m[0] > 0.3


def test_along_a_wall_it_goes_on(hovering_pilot):
    pilot = hovering_pilot({"avoidance": "3d", "start_m": (6.25, 2.0, 0.2)}, obstacles=[WALL])
    pilot.step(agent_0=velocity(0.0, 0.8, 0.0))
    body = pilot.run(50)
    assert body.rejected_command is None
    assert body.velocity_world_m_s == pytest.approx((0.0, 0.8, 0.0), abs=0.03)


@pytest.mark.parametrize(("speed_m_s", "is_refused"), [(-0.5, False), (0.5, True)])
def test_who_is_too_near_may_only_leave(hovering_pilot, speed_m_s, is_refused):
    pilot = hovering_pilot({"avoidance": "2d", "start_m": (6.55, 3.0, 0.2)}, obstacles=[WALL])
    pilot.step(agent_0=velocity(speed_m_s, 0.0, 0.0))
    body = pilot.run(30)
    assert (body.rejected_command is not None) == is_refused
    assert (body.position_world_m[0] < 5.6) != is_refused
    assert not pilot.touched()


# ---------------------------------------------------------------- up and down


@pytest.mark.parametrize("model", ["iris", "crazyflie"])
def test_it_takes_off_as_far_as_the_air_is_free(make_pilot, model):
    pilot = make_pilot({"model": model, "avoidance": "3d"}, obstacles=[beam(1.5, 1.75)])
    body = pilot.run_until_asked()
    highest_m = 1.5 - RADII_M[model] - 0.05
    assert body.position_world_m == pytest.approx((3.0, 3.0, highest_m), abs=0.02)
    assert body.rejected_command == (
        f"take_off: expected a free way to a height of 2 m, was free as far as {highest_m:.2f} m; goes there."
    )
    body = pilot.fly({"kind": "waypoint", "position_world_m": (3.0, 3.0, 3.0)})
    assert body.position_world_m == pytest.approx((3.0, 3.0, 3.0), abs=0.02)
    assert body.rejected_command is None
    assert not pilot.touched()


def test_it_stays_where_it_cannot_rise(make_pilot):
    pilot = make_pilot({"avoidance": "2d"}, obstacles=[beam(0.75, 1.0)])
    before_m = pilot.body().position_world_m
    body = pilot.run_until_asked()
    assert body.phase == "on_ground"
    assert body.rejected_command.endswith("was free as far as 0.32 m; the vehicle stays.")
    for command in (TAKE_OFF, {"kind": "waypoint", "position_world_m": (8.0, 8.0, 2.0)}, velocity(0.5, 0.0, 0.0)):
        body = pilot.step(agent_0=command)
        assert body.rejected_command.endswith("the vehicle stays.")
        body = pilot.run_until_asked()
    assert body.position_world_m == pytest.approx(before_m, abs=1e-3)
    assert not pilot.touched()


def test_it_does_not_land_through_what_hangs(asked_pilot):
    lamp = ("lamp", (3.25, 2.75, 1.0), (3.5, 3.25, 1.25))
    pilot = asked_pilot({"avoidance": "3d", "start_m": (3.0, 5.0, 0.2)}, obstacles=[lamp])
    pilot.fly({"kind": "waypoint", "position_world_m": (3.0, 3.0, 2.0)})
    body = pilot.step(agent_0=LAND)
    assert body.rejected_command == (
        "land: expected a free way down from (3.00, 3.00, 2.00) m, was something solid in it."
    )
    assert body.phase == "holding"
