"""How accurately vehicles fly and drive, beside what is promised: `make bench-robots` prints it after the speeds.

Run with `python docs/studies/robot_accuracy.py`. Every figure is measured in the world as runs use it, in a closed room
of 15 x 10 x 6 m, at 250 Hz; those of free bodies against closed forms have rotors off, no drag where none is told, and
a room as high as they need. A gust is a step of the whole wind, every two seconds; legs and ellipses are compared with
their closed forms at every tick, not with what the controller makes of them.
"""

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import GRAVITY_M_S2, PHYSICS_STEP_MS, Vec3
from gslcosim.contract.messages import BodyState, Command, DriveSetpoint, Waypoint
from gslcosim.contract.participant import Episode
from gslcosim.environment.model import Box, Environment, Grid, WindFrames
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.vehicles import get_vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.core import WorldCore
from gslcosim_services.world.scene import build_scene
from gslcosim_services.world.simulation_loop import SceneArrays, run_substeps_inplace
from gslcosim_services.world.trajectory import plan_rest

DT_S = PHYSICS_STEP_MS * 1e-3
TICK_S = 0.1
MIDDLE_M = (7.0, 5.0, 2.0)
WITH_ROTORS = ("iris", "crazyflie", "hexarotor")
FLYING = (*WITH_ROTORS, "holonomic")
WIND_M_S = (-1.0, 0.5, 0.0)


def closed_room(*, wind_m_s: tuple[Vec3, ...] = ((0.0, 0.0, 0.0),), period_s: float = 1.0) -> Environment:
    """Return a closed room of 15 x 10 x 6 m with uniform wind, one velocity a frame."""
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(30, 20, 12))
    floor = Box(name="floor", kind="floor", min_m=(0.0, 0.0, -0.2), max_m=(15.0, 10.0, 0.0))
    velocity_m_s = np.empty((len(wind_m_s), *grid.shape, 3), np.float32)
    velocity_m_s[:] = np.array(wind_m_s, np.float32)[:, None, None, None, :]
    return Environment(
        name="room",
        grid=grid,
        occupancy=np.zeros(grid.shape, np.uint8),
        wind=WindFrames(velocity_m_s=velocity_m_s, period_s=period_s, is_looping=True),
        boxes=(floor,),
        openings=(),
        content_hash="room",
    )


# No sensor wants what an IMU would feel.
NOT_MEASURED = np.empty((1, 0, 9))


class FreeBody:
    """One vehicle in a room with its rotors off, or held at a place, without a mission."""

    def __init__(self, room: Environment, *, model: str = "iris", height_m: float = 5.0) -> None:
        """Put a vehicle into a room.

        Args:
            room: Its first frame of wind blows all the time.
            model: Name of the vehicle model.
            height_m: Where it begins, at rest.
        """
        vehicle = get_vehicle(model)
        self.scene = build_scene(room, [("beetle", vehicle)], DT_S)
        self.data = mujoco.MjData(self.scene.model)
        self.data.qpos[:7] = [7.0, 5.0, height_m, 1.0, 0.0, 0.0, 0.0]
        self.constants = np.zeros(1, vehicle_records.CONSTANTS)
        vehicle_records.set_constants(self.constants[0], vehicle, self.scene.model, "beetle/", DT_S)
        self.states = np.zeros(1, vehicle_records.STATE)
        self.wind = room.wind.velocity_m_s[0]
        self.wind.flags.writeable = False

    def without_drag(self) -> None:
        """Take the air away."""
        self.constants[0]["half_density_drag_area_kg_m"] = 0.0
        self.constants[0]["rotor_drag_n_s2_m"] = 0.0

    def hold_at(self, place_m: Vec3) -> None:
        """Let the controller hold the vehicle at a place, world frame [m]."""
        self.states[0]["is_armed"] = 1
        vehicle_records.set_trajectory(self.states[0], plan_rest(place_m, 0))
        self.states[0]["rotor_speed_rad_s"] = vehicle_records.hover_rotor_speed_rad_s(self.constants[0])

    def run(self, n_substeps: int, *, tick: int = 1) -> None:
        """Fly a number of sub-steps as one tick."""
        done, unsound, _ = run_substeps_inplace(
            0, n_substeps, tick, n_substeps * DT_S, self.constants, self.states, NOT_MEASURED,
            SceneArrays.of(self.scene.model, self.data), self.wind, np.zeros(3), 0.25,
        )  # fmt: skip
        if (done, unsound) != (n_substeps, -1):
            raise RuntimeError(f"expected {n_substeps} sub-steps without contact, was {done}, unsound: {unsound}.")

    def momentum_world(self) -> NDArray[np.float64]:
        """Return the angular momentum about the centre of mass, world frame [kg m^2/s]."""
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, self.data.qpos[3:7])
        return turn.reshape(3, 3) @ (self.constants[0]["inertia_kg_m2"] * self.data.qvel[3:6])

    def spin_energy_j(self) -> float:
        """Return the energy of rotation [J]."""
        return 0.5 * float(np.sum(self.constants[0]["inertia_kg_m2"] * self.data.qvel[3:6] ** 2))


class Flight:
    """One vehicle in the world as runs use it, stepped tick by tick."""

    def __init__(self, room: Environment, *, mode: str = "on_request", **vehicle: Any) -> None:
        """Put a vehicle into a room; `vehicle` is that of a scenario."""
        agent = {
            "name": "beetle",
            "start": {"python": "dung_beetle"},
            "mode": mode,
            "vehicle": {"start_m": (7.0, 5.0, 0.1), "hold_s": 0.5, **vehicle},
            "sensors": [{"model": "tgs2600", "name": "nose"}],
        }
        gas = {"sources": [{"position_m": (5.0, 1.0, 2.0)}]}
        fields = {"schema": "gslcosim/scenario/1", "name": "flight", "environment": {"layout": {}}, "gas": gas}
        self.core = WorldCore(Scenario.model_validate({**fields, "agents": [agent]}), room)
        self.core.reset(Episode(seed=0))
        self.tick = -1
        self.step()

    def step(self, **command: Any) -> BodyState:
        """Fly a tick, after a command where one is given, and return the vehicle's state."""
        self.tick += 1
        inbox = {"command/beetle": Command(tick=max(0, self.tick - 1), **command)} if command else {}
        message: Any = self.core.step(self.tick, inbox)["truth/bodies"]
        self.body: BodyState = message.bodies[0]
        return self.body

    def run_until_asked(self, *, at_most: int = 1000) -> Iterator[BodyState]:
        """Yield states until the agent is asked."""
        for _ in range(at_most):
            yield self.step()
            if self.body.awaiting_command:
                return
        raise RuntimeError(f"expected a question within {at_most} ticks, was {self.body}")


# ---------------------------------------------------------------- free bodies


def free_fall_error() -> float:
    """Return how far a body that falls for 0.8 s is from z = -g t (t + dt)/2, relative to the way."""
    body = FreeBody(closed_room())
    body.without_drag()
    body.run(200)
    way_m = GRAVITY_M_S2 * 0.8 * (0.8 + DT_S) / 2
    return abs(5.0 - float(body.data.qpos[2]) - way_m) / way_m


def terminal_speed_error() -> float:
    """Return how far an Iris that falls for 20 s is from sqrt(2 m g/(rho A)), relative to it."""
    body = FreeBody(closed_room(), height_m=5e4)
    body.run(5000)
    vehicle = body.constants[0]
    weight_n = float(vehicle["mass_kg"] * vehicle["gravity_m_s2"])
    terminal_m_s = math.sqrt(weight_n / float(vehicle["half_density_drag_area_kg_m"][2]))
    return abs(-float(body.data.qvel[2]) - terminal_m_s) / terminal_m_s


def tumbling_drifts() -> tuple[float, float]:
    """Return how much angular momentum and energy of a body that tumbles freely for a second change, relatively."""
    body = FreeBody(closed_room())
    body.without_drag()
    body.constants[0]["gravity_m_s2"] = 0.0
    body.data.qvel[3:6] = [1.0, 0.5, 2.0]
    momentum, energy_j = body.momentum_world(), body.spin_energy_j()
    body.run(250)
    change = np.linalg.norm(body.momentum_world() - momentum) / np.linalg.norm(momentum)
    return float(change), abs(body.spin_energy_j() / energy_j - 1.0)


# ---------------------------------------------------------------- flight


def hover_error_m(model: str) -> float:
    """Return the worst distance from the place in 5.8 s of still air, 6 s after a start 0.3 m aside [m]."""
    body = FreeBody(closed_room(), model=model, height_m=2.0)
    body.data.qpos[0] += 0.3
    body.hold_at(MIDDLE_M)
    body.run(1500)
    worst_m = 0.0
    for tick in range(2, 60):
        body.run(25, tick=tick)
        worst_m = max(worst_m, math.dist(body.data.qpos[:3], MIDDLE_M))
    return worst_m


def gust_error_m(model: str, gust_m_s: Vec3) -> float:
    """Return the worst distance from the place in 32 s with still air and a gust in turn, each 2 s long [m]."""
    flight = Flight(closed_room(wind_m_s=((0.0, 0.0, 0.0), gust_m_s), period_s=2.0), model=model)
    states = [flight.step() for _ in range(400)]
    return max(math.dist(body.position_world_m, MIDDLE_M) for body in states[80:])


def leg_error_m(model: str, wind_m_s: Vec3 = (0.0, 0.0, 0.0)) -> float:
    """Return the rms distance from the minimum-jerk quintic on a leg of 7.5 m at 1 m/s [m]."""
    end = (13.0, 8.0, 4.0)
    flight = Flight(closed_room(wind_m_s=(wind_m_s,)), model=model)
    start = [*flight.run_until_asked()][-1].position_world_m
    # The quintic begins at the reference, which is at rest above the start.
    start = (7.0, 5.0, 2.0) if model != "rover" else start
    flight.step(kind="waypoint", position_world_m=end)
    began = flight.tick - 1
    duration_s = 15.0 / 8.0 * math.dist(start, end)
    squares = []
    for body in flight.run_until_asked():
        s = min((flight.tick - began) * TICK_S / duration_s, 1.0)
        share = 10 * s**3 - 15 * s**4 + 6 * s**5
        reference_m = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
        squares.append(math.dist(body.position_world_m, reference_m) ** 2)
    return math.sqrt(float(np.mean(squares)))


@dataclass(frozen=True, kw_only=True)
class Ellipse:
    """An ellipse in a horizontal plane about a centre, passed at constant speed."""

    centre_m: Vec3
    a_m: float
    b_m: float
    speed_m_s: float

    def state_at(self, t_s: float) -> tuple[Vec3, Vec3, Vec3]:
        """Return position [m], velocity [m/s] and acceleration [m/s^2] a time after the tip on the x axis."""
        a, b, speed = self.a_m, self.b_m, self.speed_m_s
        way_m, angles = self._table()
        q = float(np.interp(speed * t_s % way_m[-1], way_m, angles))
        c, s = math.cos(q), math.sin(q)
        slope_m = math.hypot(a * s, b * c)
        w = speed / slope_m
        w_rate = -speed * w * (a * a - b * b) * s * c / slope_m**3
        x_m, y_m, z_m = self.centre_m
        return (
            (x_m + a * c, y_m + b * s, z_m),
            (-a * s * w, b * c * w, 0.0),
            (-a * c * w * w - a * s * w_rate, -b * s * w * w + b * c * w_rate, 0.0),
        )

    @property
    def lap_s(self) -> float:
        """Return how long a lap takes [s]."""
        return float(self._table()[0][-1]) / self.speed_m_s

    # Way along the ellipse beside the angle, by the trapezoidal rule.
    def _table(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        angles = np.linspace(0.0, 2 * math.pi, 20001)
        slope_m = np.hypot(self.a_m * np.sin(angles), self.b_m * np.cos(angles))
        steps_m = 0.5 * (slope_m[1:] + slope_m[:-1]) * np.diff(angles)
        return np.concatenate([[0.0], np.cumsum(steps_m)]), angles


def ellipse_error_m(model: str, wind_m_s: Vec3 = (0.0, 0.0, 0.0)) -> float:
    """Return the rms distance from an ellipse of 2 x 1 m flown at 1 m/s, as a mission of a waypoint every 0.5 s [m]."""
    ellipse = Ellipse(centre_m=MIDDLE_M, a_m=2.0, b_m=1.0, speed_m_s=1.0)
    limits = {"max_speed_m_s": 1.2, "max_acceleration_m_s2": 2.5}
    flight = Flight(closed_room(wind_m_s=(wind_m_s,)), model=model, start_m=(9.0, 5.0, 0.1), **limits)
    for _ in flight.run_until_asked():
        pass
    n = 2 * math.ceil(2 * ellipse.lap_s)
    flight.step(kind="mission", waypoints=tuple(_passed(ellipse, i, 0.5) for i in range(n)))
    began = flight.tick - 1 + 30
    squares = []
    while flight.tick < began + 5 * (n - 1):
        body = flight.step()
        if flight.tick >= began:
            place_m, _, _ = ellipse.state_at((flight.tick - began) * TICK_S)
            squares.append(math.dist(body.position_world_m, place_m) ** 2)
    return math.sqrt(float(np.mean(squares)))


# The first has three seconds, from rest beside it.
def _passed(ellipse: Ellipse, i: int, every_s: float) -> Waypoint:
    place_m, velocity_m_s, acceleration_m_s2 = ellipse.state_at(i * every_s)
    return Waypoint(
        position_world_m=place_m,
        velocity_world_m_s=velocity_m_s,
        acceleration_world_m_s2=acceleration_m_s2,
        after_s=3.0 if i == 0 else every_s,
    )


# ---------------------------------------------------------------- driving


def rover_radius_error(speed_m_s: float, turn_rad_s: float) -> float:
    """Return how far the radius of a rover's circle is from speed over rate of turn, relative to it."""
    flight = Flight(closed_room(), model="rover")
    for _ in flight.run_until_asked():
        pass
    flight.step(kind="drive", drive=DriveSetpoint(speed_m_s=speed_m_s, yaw_rate_rad_s=turn_rad_s), hold_s=60.0)
    places_m = np.array([flight.step().position_world_m[:2] for _ in range(250)][50:])
    radius_m = abs(speed_m_s / turn_rad_s)
    return abs(_radius_of(places_m) - radius_m) / radius_m


# Of the circle that fits points best, after Kasa 1976.
def _radius_of(points_m: NDArray[np.float64]) -> float:
    columns = np.column_stack([2 * points_m, np.ones(len(points_m))])
    x_m, y_m, rest = np.linalg.lstsq(columns, (points_m**2).sum(axis=1), rcond=None)[0]
    return math.sqrt(rest + x_m**2 + y_m**2)


def rover_leg_error_m() -> float:
    """Return the rms distance from its reference of a rover that turns and drives 4.2 m, its stop included [m]."""
    flight = Flight(closed_room(), model="rover")
    for _ in flight.run_until_asked():
        pass
    flight.step(kind="waypoint", position_world_m=(4.0, 8.0, 0.1))
    errors_m = [body.tracking_error_m or 0.0 for body in flight.run_until_asked()]
    return math.sqrt(float(np.mean(np.square(errors_m))))


# ---------------------------------------------------------------- the report


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One line of the report: what is measured, how large it may be, and how it is measured."""

    name: str
    target: float
    unit: str
    measure: Callable[[], float]


def figures() -> list[Figure]:
    """Return all lines of the report."""
    gust_m_s = (1.2, 1.2, 1.0)
    found = [
        Figure(name="free fall, 0.8 s", target=1e-9, unit="", measure=free_fall_error),
        Figure(name="terminal speed, rotors off", target=1e-3, unit="", measure=terminal_speed_error),
        Figure(name="angular momentum, 1 s of tumbling", target=0.01, unit="", measure=lambda: tumbling_drifts()[0]),
        Figure(name="energy, 1 s of tumbling", target=0.01, unit="", measure=lambda: tumbling_drifts()[1]),
    ]
    found += [Figure(name=f"{m}: hover", target=0.02, unit="m", measure=lambda m=m: hover_error_m(m)) for m in FLYING]
    for m in WITH_ROTORS:
        found += [
            Figure(name=f"{m}: gusts of 2 m/s along x", target=0.15, unit="m",
                   measure=lambda m=m: gust_error_m(m, (2.0, 0.0, 0.0))),
            Figure(name=f"{m}: gusts of 2 m/s aslant", target=0.15, unit="m",
                   measure=lambda m=m: gust_error_m(m, gust_m_s)),
        ]  # fmt: skip
    for m in FLYING:
        found += [
            Figure(name=f"{m}: leg, rms", target=0.05, unit="m", measure=lambda m=m: leg_error_m(m)),
            Figure(name=f"{m}: leg in wind, rms", target=0.05, unit="m", measure=lambda m=m: leg_error_m(m, WIND_M_S)),
            Figure(name=f"{m}: ellipse at 1 m/s, rms", target=0.05, unit="m", measure=lambda m=m: ellipse_error_m(m)),
            Figure(name=f"{m}: ellipse in wind, rms", target=0.05, unit="m",
                   measure=lambda m=m: ellipse_error_m(m, WIND_M_S)),
        ]  # fmt: skip
    return [
        *found,
        Figure(name="rover: leg, rms", target=0.05, unit="m", measure=rover_leg_error_m),
        Figure(name="rover: radius of 1 m", target=0.02, unit="", measure=lambda: rover_radius_error(0.5, 0.5)),
        Figure(name="rover: radius of 2 m", target=0.02, unit="", measure=lambda: rover_radius_error(0.8, -0.4)),
    ]


def main() -> None:
    """Print the report; the exit code is 1 when a figure misses its target."""
    is_missed = False
    sys.stdout.write(f"{'accuracy':<36} {'measured':>10} {'at most':>10}\n")
    for figure in figures():
        measured = figure.measure()
        is_missed |= measured > figure.target
        mark = "  missed" if measured > figure.target else ""
        sys.stdout.write(f"{figure.name:<36} {measured:10.2g} {figure.target:10.2g} {figure.unit}{mark}\n")
    sys.exit(1 if is_missed else 0)


if __name__ == "__main__":
    main()
