# pyright: reportAttributeAccessIssue=false
"""Records of each vehicle for the compiled loop, of constants and of state, and its capabilities."""

import math
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.contract.messages import AttitudeSetpoint, DriveSetpoint, RateSetpoint
from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.vehicles import Vehicle
from gslcosim.vehicles.catalogue import MAX_ROTORS, MIN_ROTORS, ControlParameters, RotorParameters, WheelParameters
from gslcosim_services.world.multirotor_control import ATTITUDE, DRIVE, PATH, RATES
from gslcosim_services.world.scene import HULL
from gslcosim_services.world.trajectory import Limits, Trajectory

# Fraction of its greatest tilt that a vehicle may plan with; the rest is for wind and errors.
_PLANNED_ACCELERATION_FRACTION = 0.9
# Air drag may take up to this fraction of that.
_MAX_DRAG_FRACTION = 0.5
# More than rounding.
_REACH_MARGIN_M = 1e-3

Setpoint = AttitudeSetpoint | RateSetpoint | DriveSetpoint
# Constants of one vehicle. World frame z up; body frame x forward, y left, z up.
CONSTANTS = np.dtype(
    [
        ("i_qpos", np.int64),  # where its numbers begin in MuJoCo's positions and velocities
        ("i_qvel", np.int64),
        ("i_touch", np.int64),  # its sensor of touch; -1: any contact counts
        ("i_body", np.int64),  # its body, and the bits of what that collides as, and with
        ("contype", np.int32),
        ("conaffinity", np.int32),
        ("reach_m", np.float64),  # nothing farther from its origin than this touches it, but for what is on wheels
        ("is_plain_body", np.int64),  # see the function of that name
        ("has_rotors", np.int64),  # without rotors or wheels, forces act on the body as commanded and the air does not
        ("has_wheels", np.int64),
        ("mass_kg", np.float64),
        ("gravity_m_s2", np.float64),
        ("inertia_kg_m2", np.float64, (3,)),  # about the body axes
        ("n_rotors", np.int64),  # entries beyond the number of rotors are 0
        ("wrench_from_thrusts", np.float64, (4, MAX_ROTORS)),  # rows thrust, torque xyz; columns rotors
        ("thrusts_from_wrench", np.float64, (MAX_ROTORS, 4)),
        ("thrust_coefficient_n_s2", np.float64),
        ("max_rotor_speed_rad_s", np.float64),
        ("response_up", np.float64),  # fraction of a speed difference that is closed in one sub-step
        ("response_down", np.float64),
        ("rotor_drag_n_s2_m", np.float64, (3,)),
        ("half_density_drag_area_kg_m", np.float64, (3,)),
        ("expected_drag_s", np.float64),  # horizontal rotor drag in hover per mass and speed [1/s]
        ("position_gain_s2", np.float64),
        ("velocity_gain_s", np.float64),
        ("integral_gain_s3", np.float64),
        ("integral_limit_m_s2", np.float64),
        ("max_tilt_tangent", np.float64),
        ("attitude_gain_s2", np.float64, (3,)),
        ("rate_gain_s", np.float64, (3,)),
        ("max_yaw_rate_rad_s", np.float64),
        ("wheel_radius_m", np.float64),
        ("half_track_m", np.float64),
        ("max_speed_m_s", np.float64),
        ("max_acceleration_m_s2", np.float64),
        ("max_wheel_torque_n_m", np.float64),
        ("wheel_gain_n_m_s", np.float64),
        ("wheel_integral_gain_n_m", np.float64),
        ("along_gain_s", np.float64),
        ("across_gain_m2", np.float64),
        ("heading_gain_s", np.float64),
    ]
)
_CONSTANT_NAMES = frozenset(CONSTANTS.names or ())
# State of one vehicle beside MuJoCo's own, and the reference it follows.
STATE = np.dtype(
    [
        ("is_armed", np.int64),
        ("rotor_speed_rad_s", np.float64, (MAX_ROTORS,)),
        ("integral_m_s2", np.float64, (3,)),
        ("start_tick", np.int64),
        ("coefficients", np.float64, (3, 6)),
        ("duration_s", np.float64),
        ("end_world_m", np.float64, (3,)),
        ("end_velocity_world_m_s", np.float64, (3,)),
        ("yaw_rad", np.float64),  # reference of the heading, its rate, and where it goes
        ("yaw_rate_rad_s", np.float64),
        ("wanted_yaw_rad", np.float64),
        ("faces_path", np.int64),
        ("control", np.int64),  # PATH, ATTITUDE, RATES or DRIVE
        ("setpoint", np.float64, (3,)),  # roll, pitch, yaw [rad]; rates [rad/s]; speed [m/s] and turn [rad/s]
        ("thrust_n", np.float64),  # of the setpoint; below 0: as much as keeps the vertical speed
        ("climb_m_s", np.float64),
        ("drive_speed_m_s", np.float64),  # what the wheels are to reach now
        ("drive_turn_rad_s", np.float64),
        ("wheel_integral_n_m", np.float64, (2,)),
    ]
)


@dataclass(frozen=True, kw_only=True)
class VehicleCapabilities:
    """Capabilities of a vehicle: its kind of motion and its limits.

    `max_thrust_n` is that of all rotors, 0 without; `standing_height_m` is its centre above what it stands on.
    """

    name: str
    limits: Limits
    has_rotors: bool
    has_wheels: bool
    max_thrust_n: float
    max_yaw_rate_rad_s: float
    standing_height_m: float


def derive_capabilities(spec: VehicleSpec, model: Vehicle, constants: Any, half_height_m: float) -> VehicleCapabilities:
    """Derive the capabilities of a vehicle from its parameters and the scenario.

    Args:
        spec: Its block in the scenario.
        constants: Its record of `records.CONSTANTS`.
        half_height_m: Its centre above what it stands on [m].
    """
    speed_rad_s = float(constants["max_rotor_speed_rad_s"])
    return VehicleCapabilities(
        name=model.name,
        limits=_feasible_limits(spec, model, constants),
        has_rotors=model.rotors is not None,
        has_wheels=model.drives,
        max_thrust_n=int(constants["n_rotors"])
        * float(constants["thrust_coefficient_n_s2"])
        * (speed_rad_s * speed_rad_s),
        max_yaw_rate_rad_s=model.body.max_yaw_rate_rad_s,
        standing_height_m=half_height_m,
    )


# The scenario's limits, or those of the vehicle where they are tighter: wheels have their own, and in the air tilt
# gives a + k_drag v <= 0.9 g tan(tilt_max) and lift |a| <= 0.9 * 0.7 g.
def _feasible_limits(spec: VehicleSpec, model: Vehicle, constants: Any) -> Limits:
    speed_m_s, acceleration_m_s2 = spec.max_speed_m_s, spec.max_acceleration_m_s2
    if model.wheels is not None:
        speed_m_s = min(speed_m_s, model.wheels.max_speed_m_s)
        acceleration_m_s2 = min(acceleration_m_s2, model.wheels.max_acceleration_m_s2)
        return Limits(max_speed_m_s=speed_m_s, max_acceleration_m_s2=acceleration_m_s2)
    lift_m_s2 = 0.7 * float(constants["gravity_m_s2"])
    reach_m_s2 = _PLANNED_ACCELERATION_FRACTION * min(
        float(constants["gravity_m_s2"] * constants["max_tilt_tangent"]), lift_m_s2
    )
    drag_s = float(constants["expected_drag_s"])
    speed_m_s = min(speed_m_s, _MAX_DRAG_FRACTION * reach_m_s2 / drag_s if drag_s > 0 else math.inf)
    acceleration_m_s2 = min(acceleration_m_s2, reach_m_s2 - drag_s * speed_m_s)
    return Limits(max_speed_m_s=speed_m_s, max_acceleration_m_s2=acceleration_m_s2)


def set_constants(record: Any, vehicle: Vehicle, model: mujoco.MjModel, prefix: str, dt_s: float) -> None:
    """Fill a record of `CONSTANTS` from a vehicle's parameters and its compiled body.

    Args:
        prefix: Prefix of the names of the vehicle's parts in the scene.
        dt_s: Length of a sub-step [s].
    """
    body = model.body(f"{prefix}body").id
    free = model.joint(f"{prefix}free")
    record["i_qpos"], record["i_qvel"], record["i_touch"] = free.qposadr[0], free.dofadr[0], -1
    record["i_body"], record["contype"], record["conaffinity"] = (
        body,
        model.body_contype[body],
        model.body_conaffinity[body],
    )
    record["reach_m"] = _find_reach_m(model, body)
    record["is_plain_body"] = is_plain_body(model, body)
    record["mass_kg"] = model.body_subtreemass[body]
    record["gravity_m_s2"] = -model.opt.gravity[2]
    record["inertia_kg_m2"] = model.body_inertia[body]
    record["max_yaw_rate_rad_s"] = vehicle.body.max_yaw_rate_rad_s
    if vehicle.control is not None:
        _set_parameters(record, vehicle.control)
        record["max_tilt_tangent"] = elementary.tan(vehicle.control.max_tilt_rad)
    if vehicle.rotors is not None:
        record["has_rotors"] = 1
        _set_rotors(record, vehicle.name, vehicle.rotors, dt_s)
    if vehicle.wheels is not None:
        record["has_wheels"] = 1
        _set_parameters(record, vehicle.wheels)
        record["i_touch"] = model.sensor(f"{prefix}{HULL}").adr[0]


def is_plain_body(model: mujoco.MjModel, body: int) -> bool:
    """Return whether a body is a free one that `simulation_loop.advance_free_body_inplace` can advance as MuJoCo would.

    Its centre of mass is its origin, its axes are those of its inertia, and nothing damps or loads its joint.
    """
    is_single = np.count_nonzero(model.body_rootid == body) == 1 and model.body_dofnum[body] == 6
    is_centred = not model.body_ipos[body].any() and np.array_equal(model.body_iquat[body], (1.0, 0.0, 0.0, 0.0))
    is_in_vacuum = model.opt.density == 0.0 and model.opt.viscosity == 0.0
    axes = slice(model.body_dofadr[body], model.body_dofadr[body] + 6)
    is_damped = model.dof_damping[axes].any() or model.dof_armature[axes].any() or model.body_gravcomp[body] != 0.0
    is_of_euler = model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    return bool(is_single and is_centred and is_in_vacuum and is_of_euler and not is_damped)


# From the body's origin to the farthest point of its geoms, those of wheels in any position, and their margins.
def _find_reach_m(model: mujoco.MjModel, body: int) -> float:
    geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == body)
    arms_m = np.linalg.norm(model.geom_pos[geoms], axis=1) + model.geom_rbound[geoms]
    is_part = model.geom_bodyid[geoms] != body
    arms_m += is_part * np.linalg.norm(model.body_pos[model.geom_bodyid[geoms]], axis=1)
    return float(arms_m.max() + 2.0 * model.geom_margin.max()) + _REACH_MARGIN_M


# The parameters that a record has by the same name.
def _set_parameters(record: Any, parameters: ControlParameters | RotorParameters | WheelParameters) -> None:
    for parameter in fields(parameters):
        if parameter.name in _CONSTANT_NAMES:
            record[parameter.name] = getattr(parameters, parameter.name)


def _set_rotors(record: Any, name: str, rotors: RotorParameters, dt_s: float) -> None:
    _set_parameters(record, rotors)
    record["n_rotors"] = n_rotors = rotors.n_rotors
    record["wrench_from_thrusts"][:, :n_rotors] = wrench_from_thrusts = rotors.wrench_from_thrusts()
    record["thrusts_from_wrench"][:n_rotors] = _thrusts_from_wrench(wrench_from_thrusts)
    record["response_up"] = -elementary.expm1(-dt_s / rotors.time_constant_up_s)
    record["response_down"] = -elementary.expm1(-dt_s / rotors.time_constant_down_s)
    record["half_density_drag_area_kg_m"] = 0.5 * rotors.air_density_kg_m3 * np.array(rotors.drag_area_m2)
    hover_speed_rad_s = hover_rotor_speed_rad_s(record)
    if hover_speed_rad_s >= rotors.max_rotor_speed_rad_s:
        raise ModelError(
            f"vehicle {name}: expected rotors that can carry it, was {hover_speed_rad_s:.0f} rad/s in hover "
            f"at a limit of {rotors.max_rotor_speed_rad_s:.0f} rad/s."
        )
    record["expected_drag_s"] = n_rotors * hover_speed_rad_s * rotors.rotor_drag_n_s2_m[0] / record["mass_kg"]


def set_trajectory(record: Any, trajectory: Trajectory) -> None:
    """Write a trajectory into a record of `STATE`, which then follows it."""
    record["control"] = PATH
    record["start_tick"] = trajectory.start_tick
    record["coefficients"] = trajectory.coefficients
    record["duration_s"] = trajectory.duration_s
    record["end_world_m"] = trajectory.end_world_m
    record["end_velocity_world_m_s"] = trajectory.end_velocity_world_m_s
    if trajectory.forgets_integral:
        record["integral_m_s2"] = 0.0
    record["faces_path"] = trajectory.heading.is_along_path
    if trajectory.heading.yaw_rad is not None:
        record["wanted_yaw_rad"] = trajectory.heading.yaw_rad


def set_setpoint(record: Any, setpoint: Setpoint) -> None:
    """Write what an agent sets into a record of `STATE`, which then obeys it instead of a path."""
    match setpoint:
        case AttitudeSetpoint():
            record["control"] = ATTITUDE
            record["setpoint"] = (setpoint.roll_rad, setpoint.pitch_rad, setpoint.yaw_rad)
        case RateSetpoint():
            record["control"] = RATES
            record["setpoint"] = setpoint.rates_body_rad_s
        case DriveSetpoint():
            record["control"] = DRIVE
            record["setpoint"] = (setpoint.speed_m_s, setpoint.yaw_rate_rad_s, 0.0)
            return
    record["thrust_n"] = -1.0 if setpoint.thrust_n is None else setpoint.thrust_n
    record["climb_m_s"] = setpoint.climb_m_s


def hover_rotor_speed_rad_s(record: Any) -> float:
    """Return the rotor speed [rad/s] at which the rotors carry the vehicle of a record of `CONSTANTS`.

    It is 0 for a vehicle without rotors.
    """
    if record["thrust_coefficient_n_s2"] == 0.0:
        return 0.0
    weight_n = record["mass_kg"] * record["gravity_m_s2"]
    return float(np.sqrt(weight_n / (record["n_rotors"] * record["thrust_coefficient_n_s2"])))


# Four rotors give each wrench in one way; of the ways that more can, the pseudo-inverse takes that of the least squares
# of thrusts, in which all carry the same in hover where they stand evenly.
def _thrusts_from_wrench(wrench_from_thrusts: NDArray[np.float64]) -> NDArray[np.float64]:
    if wrench_from_thrusts.shape[1] == MIN_ROTORS:
        return elementary.solve(wrench_from_thrusts, np.eye(MIN_ROTORS))
    transposed = wrench_from_thrusts.T
    return elementary.solve(elementary.product(wrench_from_thrusts, transposed), wrench_from_thrusts).T
