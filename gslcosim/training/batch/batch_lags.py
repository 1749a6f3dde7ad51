"""How far the force of a rotorcraft lags what its control wants, from its parameters."""

import math
from typing import Any

from gslcosim.vehicles import Vehicle
from gslcosim.world.core import POINT_ROBOT_STEP_MS
from gslcosim.world.physics.records import hover_rotor_speed_rad_s


def lags_s(vehicle: Vehicle) -> tuple[float, float]:
    """Return how long a rotorcraft takes to give a force sideways and upwards [s].

    Its attitude obeys e'' + k_omega e' + k_R e = 0, which for a slow e is a lag of k_omega/k_R; its rotors have one of
    their own, faster up than down, which both forces wait for.
    """
    control, rotors = vehicle.control, vehicle.rotors
    assert control is not None, "a rotorcraft has control"
    assert rotors is not None, "a rotorcraft has rotors"
    rotors_s = (rotors.time_constant_up_s + rotors.time_constant_down_s) / 2
    return control.rate_gain_s[0] / control.attitude_gain_s2[0] + rotors_s, rotors_s


def fill_lags(case: Any, vehicle: Vehicle, constants: Any, tick_ms: int) -> None:
    """Write into a case how a rotorcraft flies in it; see `lagging_kernels`.

    Args:
        case: Record of `CASE`.
        vehicle: The rotorcraft.
        constants: Its record of `records.CONSTANTS`.
        tick_ms: Length of a tick [ms].
    """
    # As long as point robots' steps, or whole ticks where those are no whole number of them.
    n_substeps = max(1, round(tick_ms / POINT_ROBOT_STEP_MS))
    step_s = tick_ms * 1e-3 / n_substeps
    tilt_s, lift_s = lags_s(vehicle)
    case["is_lagged"], case["n_substeps"], case["physics_step_s"] = 1, n_substeps, step_s
    case["tilt_share"], case["lift_share"] = -math.expm1(-step_s / tilt_s), -math.expm1(-step_s / lift_s)
    case["rotor_speeds_rad_s"] = int(constants["n_rotors"]) * hover_rotor_speed_rad_s(constants)
