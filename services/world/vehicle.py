"""One simulated vehicle: its autopilot, its control's record, and its state in MuJoCo."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import GRAVITY_M_S2, Vec3
from gslcosim.contract.messages import BodyState, Command
from gslcosim.contract.record import NumericArray, build_unchecked_constructor
from gslcosim_services.world.guidance.autopilot import Autopilot, Reference
from gslcosim_services.world.guidance.separation import Neighbours
from gslcosim_services.world.physics import vehicle_records

_new_body = build_unchecked_constructor(BodyState)


@dataclass(frozen=True, kw_only=True)
class VehicleViews:
    """Views of one vehicle's part of the arrays that the compiled loop reads and writes.

    `constants` and `state` are its records of `records.CONSTANTS` and `records.STATE`; `pose` is its position and
    quaternion (7,), `motion` its velocity in the world and its rates in the body frame (6,), in MuJoCo's arrays;
    `inertial` has a row for each physics step (absent: no IMU).
    """

    constants: Any
    state: Any
    pose: NDArray[np.float64]
    motion: NDArray[np.float64]
    inertial: NDArray[np.float64] | None


@dataclass(frozen=True, kw_only=True)
class StartState:
    """Start of a vehicle at tick 0: its position, world frame [m], and the choice between hovering and standing."""

    position_world_m: Vec3
    is_flying: bool


class SimulatedVehicle:
    """One vehicle of a run, from its agent's commands to the state that is reported of it.

    State: its guide; the path flown; its position at the end of the last tick; what it has touched in this tick; and
    what carried it when it last stood.
    """

    def __init__(self, name: str, new_guide: Callable[[], Autopilot], start: StartState, rows: VehicleViews) -> None:
        self._name = name
        self._build_autopilot = new_guide
        self._start = start
        self._rows = rows
        self._autopilot = new_guide()
        self._reference: Reference = self._autopilot.reference
        self._path_length_m = 0.0
        self._position_m = start.position_world_m
        self._touched: set[str] = set()
        self._supports: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """The agent's name."""
        return self._name

    @property
    def position_m(self) -> Vec3:
        """Position at the end of the last tick, world frame [m]."""
        return self._position_m

    @property
    def yields(self) -> bool:
        """True while the vehicle yields to others where that is needed."""
        return self._autopilot.yields

    @property
    def true_position_m(self) -> Vec3:
        """Position in MuJoCo's scene, world frame [m]."""
        x_m, y_m, z_m = self._rows.pose[:3].tolist()
        return x_m, y_m, z_m

    @property
    def true_velocity_m_s(self) -> Vec3:
        """Velocity in MuJoCo's scene, world frame [m/s]."""
        u, v, w = self._rows.motion[:3].tolist()
        return u, v, w

    def reset(self) -> None:
        """Rest at the start. The scene is reset by its owner, who then calls `place`."""
        self._autopilot = self._build_autopilot()
        self._reference = self._autopilot.reference
        self._path_length_m = 0.0
        self._position_m = self._start.position_world_m
        self._touched.clear()
        self._supports = frozenset()
        rows = self._rows
        rows.state[...] = np.zeros((), vehicle_records.STATE)
        if self._start.is_flying:
            rows.state["rotor_speed_rad_s"] = vehicle_records.hover_rotor_speed_rad_s(rows.constants)
        if rows.inertial is not None:
            # At rest nothing is felt but what carries it.
            rows.inertial[:] = 0.0
            rows.inertial[:, 2] = GRAVITY_M_S2

    def place(self) -> None:
        """Put it upright at its start."""
        self._rows.pose[:] = (*self._start.position_world_m, 1.0, 0.0, 0.0, 0.0)

    def begin_tick(self) -> None:
        """Forget what was touched in the last tick."""
        self._touched.clear()

    def touch(self, thing: str) -> None:
        """Take note of a contact with a thing."""
        self._touched.add(thing)

    def stand(self) -> None:
        """Take note that what is touched now carries it."""
        self._supports = frozenset(self._touched)

    def obey(self, tick: int, command: Command | None) -> None:
        """Take the agent's command at the start of a tick."""
        self._follow(self._autopilot.begin_tick(tick, command))

    def avoid_neighbours(self, tick: int, neighbours: Neighbours) -> None:
        """Avoid other vehicles; see `Autopilot`."""
        self._follow(self._autopilot.avoid_neighbours(tick, neighbours))

    def end_tick(self, tick: int) -> None:
        """Update the autopilot with the state that physics has reached."""
        guide, position_m = self._autopilot, self.true_position_m
        self._path_length_m += math.dist(position_m, self._position_m)
        self._position_m = position_m
        was_landing = guide.phase == "landing"
        w, x, y, z = self._rows.pose[3:].tolist()
        reference = guide.end_tick(
            tick,
            position_m,
            self.true_velocity_m_s,
            yaw_rad=math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)),
            uprightness=1.0 - 2.0 * (x * x + y * y),
        )
        self._follow(reference)
        if was_landing and guide.phase == "on_ground":
            self.stand()

    def body(self, tick: int, tick_ns: int) -> BodyState:
        """Return the vehicle's state at the end of a tick."""
        guide, rows = self._autopilot, self._rows
        # A vehicle that fails before its take-off is over has not collided with what it stood on.
        is_leaving = guide.phase == "failed" and not guide.has_taken_off
        touched = self._touched - self._supports if is_leaving else self._touched
        w, x, y, z = rows.pose[3:].tolist()
        u, v, speed_w, omega_x, omega_y, omega_z = rows.motion.tolist()
        return _new_body(
            agent=self._name,
            position_world_m=self._position_m,
            quaternion_wxyz=(w, x, y, z),
            velocity_world_m_s=(u, v, speed_w),
            angular_velocity_body_rad_s=(omega_x, omega_y, omega_z),
            phase=guide.phase,
            awaiting_command=guide.awaiting_command,
            path_length_m=self._path_length_m,
            waypoint_world_m=guide.waypoint_world_m,
            contacts=tuple(sorted(touched)),
            rejected_command=guide.notice,
            tracking_error_m=self._tracking_error_m(tick, tick_ns),
            planned_path_world_m=guide.planned_path_world_m,
            inertial_body=None if rows.inertial is None else NumericArray.from_array(rows.inertial),
        )

    def _tracking_error_m(self, tick: int, tick_ns: int) -> float | None:
        reference = self._reference
        if reference.setpoint is not None or not reference.is_armed or tick == 0:
            return None
        return math.dist(self._position_m, reference.trajectory.state_at(tick, tick_ns)[0])

    def _follow(self, reference: Reference) -> None:
        if reference is self._reference:
            return
        self._reference = reference
        state = self._rows.state
        state["is_armed"] = reference.is_armed
        if reference.setpoint is None:
            vehicle_records.set_trajectory(state, reference.trajectory)
        else:
            vehicle_records.set_setpoint(state, reference.setpoint)
