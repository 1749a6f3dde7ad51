"""Flight against closed forms, and the accuracy that the vehicles promise."""

import math

import mujoco
import numpy as np
import pytest

from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.world import WorldCore, records
from gslcosim.world.flight_kernels import fly_substeps_inplace
from gslcosim.world.mujoco_kernels import step_address
from gslcosim.world.scene import GRAVITY_M_S2, build_scene
from gslcosim.world.trajectory import stay_at
from gslcosim.world.vehicle import load_vehicle

DT_S = 0.004
MODELS = ("iris", "crazyflie", "holonomic")


class FreeBody:
    """One vehicle in a room with its rotors off, or held at a place, without a mission."""

    def __init__(self, room, *, model="iris", height_m=5.0):
        self.scene = build_scene(room, [("beetle", load_vehicle(model))], DT_S)
        self.data = mujoco.MjData(self.scene.model)
        self.data.qpos[:] = [7.0, 5.0, height_m, 1.0, 0.0, 0.0, 0.0]
        self.constants = np.zeros(1, records.CONSTANTS)
        records.set_constants(self.constants[0], load_vehicle(model), self.scene.model, "beetle/", DT_S)
        self.states = np.zeros(1, records.STATE)
        self.wind = room.wind.velocity_m_s[0]
        self.wind.flags.writeable = False

    def hold_at(self, place_m):
        self.states[0]["is_armed"] = 1
        records.set_trajectory(self.states[0], stay_at(place_m, 0))
        self.states[0]["rotor_speed_rad_s"] = records.hover_rotor_speed_rad_s(self.constants[0])

    def run(self, n_substeps, *, tick=1):
        data = self.data
        done, unsound = fly_substeps_inplace(
            0, n_substeps, tick, n_substeps * DT_S, self.constants, self.states, data.qpos, data.qvel,
            data.qfrc_applied, data.qfrc_constraint, data.sensordata, self.wind, np.zeros(3), 0.25, step_address(),
            self.scene.model._address, data._address,
        )  # fmt: skip
        assert (done, unsound) == (n_substeps, -1)


def without_drag(body):
    body.constants[0]["half_density_drag_area_kg_m"] = 0.0
    body.constants[0]["rotor_drag_n_s2_m"] = 0.0


def test_free_fall(make_room):
    """Symplectic Euler falls z = -g t (t + dt)/2, the closed form but for half a step."""
    body = FreeBody(make_room())
    without_drag(body)
    body.run(200)
    assert 5.0 - body.data.qpos[2] == pytest.approx(GRAVITY_M_S2 * 0.8 * (0.8 + DT_S) / 2, rel=1e-12)
    assert body.data.qvel[2] == pytest.approx(-GRAVITY_M_S2 * 0.8, rel=1e-12)


def test_terminal_speed(make_room):
    """With rotors off the hull falls at sqrt(2 m g/(rho A)); the room is as high as it must be."""
    body = FreeBody(make_room(), height_m=5e4)
    body.run(5000)
    terminal_m_s = math.sqrt(2 * 1.535 * GRAVITY_M_S2 / (1.204 * 0.04))
    assert -body.data.qvel[2] == pytest.approx(terminal_m_s, rel=1e-6)


def test_speed_while_falling_with_drag(make_room):
    """v = v_t tanh(g t/v_t)."""
    body = FreeBody(make_room(), height_m=5e4)
    body.run(375)
    terminal_m_s = math.sqrt(2 * 1.535 * GRAVITY_M_S2 / (1.204 * 0.04))
    assert -body.data.qvel[2] == pytest.approx(terminal_m_s * math.tanh(GRAVITY_M_S2 * 1.5 / terminal_m_s), rel=2e-3)


def test_a_body_without_thrust_takes_the_speed_of_the_air(make_room):
    """Drag is relative to the moving air: v = U - U/(1 + U t q/m), q = rho A/2."""
    body = FreeBody(make_room(wind_m_s=((6.0, 0.0, 0.0),)))
    body.scene.model.opt.gravity[:] = 0.0
    body.run(250)
    rate_s = 6.0 * 0.5 * 1.204 * 0.015 / 1.535
    assert body.data.qvel[0] == pytest.approx(6.0 - 6.0 / (1.0 + rate_s * 1.0), rel=2e-3)


def test_momentum_and_energy_of_free_rotation_are_kept(make_room):
    """Torque-free tumbling: the world-frame angular momentum stays, to the order of the step."""
    body = FreeBody(make_room())
    without_drag(body)
    body.scene.model.opt.gravity[:] = 0.0
    inertia = body.constants[0]["inertia_kg_m2"]
    body.data.qvel[3:6] = [1.0, 0.5, 2.0]

    def momentum_world():
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, body.data.qpos[3:7])
        return turn.reshape(3, 3) @ (inertia * body.data.qvel[3:6])

    def energy():
        return 0.5 * float(np.sum(inertia * body.data.qvel[3:6] ** 2))

    momentum, at_start = momentum_world(), energy()
    body.run(250)
    assert momentum_world() == pytest.approx(momentum, rel=0.01, abs=1e-3)
    assert energy() == pytest.approx(at_start, rel=0.01)


@pytest.mark.parametrize("model", MODELS)
def test_hover_in_still_air_stays_within_two_centimetres(make_room, model):
    """Measured: below 5 mm, 6 s after a start 0.3 m aside."""
    body = FreeBody(make_room(), model=model, height_m=2.0)
    body.data.qpos[0] += 0.3
    body.hold_at((7.0, 5.0, 2.0))
    body.run(1500)
    worst_m = 0.0
    for tick in range(2, 60):
        body.run(25, tick=tick)
        worst_m = max(worst_m, math.dist(body.data.qpos[:3], (7.0, 5.0, 2.0)))
    assert worst_m < 0.005


@pytest.mark.parametrize("model", ["iris", "crazyflie"])
@pytest.mark.parametrize("gust_m_s", [(2.0, 0.0, 0.0), (0.0, -2.0, 0.0), (1.2, 1.2, 1.0)])
def test_gusts_of_two_metres_a_second_move_it_less_than_fifteen_centimetres(make_room, make_scenario, model, gust_m_s):
    """Still air and gust in turn, every 2 s; the step in the wind is the worst gust of that speed."""
    core = WorldCore(
        make_scenario({"model": model, "start_m": (7.0, 5.0, 0.1)}),
        make_room(wind_m_s=((0.0, 0.0, 0.0), gust_m_s), period_s=2.0),
    )
    core.reset(Episode(seed=0))
    worst_m = 0.0
    for tick in range(400):
        body = core.step(tick, {})["truth/bodies"].bodies[0]
        if tick > 80:
            worst_m = max(worst_m, math.dist(body.position_world_m, (7.0, 5.0, 2.0)))
    assert worst_m < 0.15


def test_a_steady_wind_leaves_no_lasting_error(make_room, make_scenario):
    """The integral term takes over what the wind pushes."""
    core = WorldCore(make_scenario({"start_m": (7.0, 5.0, 0.1)}), make_room(wind_m_s=((3.0, -1.0, 0.5),)))
    core.reset(Episode(seed=0))
    for tick in range(200):
        body = core.step(tick, {})["truth/bodies"].bodies[0]
    assert math.dist(body.position_world_m, (7.0, 5.0, 2.0)) < 0.005


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("wind_m_s", [(0.0, 0.0, 0.0), (-1.0, 0.5, 0.0)])
def test_legs_are_tracked_within_five_centimetres_rms(make_room, make_scenario, model, wind_m_s):
    vehicle = {"model": model, "start_m": (3.0, 3.0, 0.1)}
    core = WorldCore(make_scenario(vehicle, mode="lockstep"), make_room(wind_m_s=(wind_m_s,)))
    core.reset(Episode(seed=0))
    squares, mission = [], core._missions[0]
    goal = Command(tick=0, kind="waypoint", position_world_m=(9.0, 7.0, 4.0))
    for tick in range(300):
        inbox = {"command/agent_0": goal} if tick == 1 else {}
        body = core.step(tick, inbox)["truth/bodies"].bodies[0]
        reference_m = mission.trajectory.state_at(tick, 100_000_000)[0]
        if body.phase == "flying":
            squares.append(math.dist(body.position_world_m, reference_m) ** 2)
    assert len(squares) > 100
    assert math.sqrt(np.mean(squares)) < 0.05
    assert math.dist(body.position_world_m, (9.0, 7.0, 4.0)) < 0.02


def test_it_rights_itself_from_a_steep_tilt(make_room):
    """Thrown at 60 degrees of roll and 3 rad/s it is back in place in 4 s."""
    body = FreeBody(make_room(), height_m=3.0)
    body.data.qpos[3:7] = [math.cos(math.pi / 6), math.sin(math.pi / 6), 0.0, 0.0]
    body.data.qvel[3:6] = [3.0, 0.0, 1.0]
    body.hold_at((7.0, 5.0, 3.0))
    body.run(1000)
    assert math.dist(body.data.qpos[:3], (7.0, 5.0, 3.0)) < 0.1
    assert abs(body.data.qpos[3]) == pytest.approx(1.0, abs=1e-3)
