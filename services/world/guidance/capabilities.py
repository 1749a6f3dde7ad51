"""Capabilities of a vehicle: limits of speed and acceleration, thrust and turn rate, derived from its parameters."""

import math
from dataclasses import dataclass
from typing import Any

from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.vehicles import Vehicle
from gslcosim_services.world.paths.trajectory import Limits

# What of its greatest tilt a vehicle may plan with; the rest is for wind and errors.
_PLANNED_ACCELERATION_FRACTION = 0.9
# Air drag may take up to this share of that.
_MAX_DRAG_FRACTION = 0.5


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
        spec: What the scenario says of it.
        model: Its parameters.
        constants: Its record of `records.CONSTANTS`.
        half_height_m: Its centre above what it stands on [m].
    """
    speed_rad_s = float(constants["max_rotor_speed_rad_s"])
    return VehicleCapabilities(
        name=model.name,
        limits=_feasible_limits(spec, model, constants),
        has_rotors=model.rotors is not None,
        has_wheels=model.drives,
        max_thrust_n=int(constants["n_rotors"]) * float(constants["thrust_coefficient_n_s2"]) * speed_rad_s**2,
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
