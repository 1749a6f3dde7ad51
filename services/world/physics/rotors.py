# pyright: basic
"""Rotors: lag of their speed, thrust and torques, drag of rotors and hull, and rotors that weaken by events."""

# ruff: noqa: ANN001, ANN201, N806 - kernels have no types, and symbols of equations

import math
from typing import Any

import numba

from gslcosim.contract.participant import Inbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import find_due_events
from gslcosim.scenario.models.events import RotorWeakensSpec


@numba.njit(cache=True, nogil=True)
def lagged_rotor_speed(vehicle, speed, command):
    """Return a rotor's speed one sub-step later: first-order lag, slower down than up.

    speed += (1 - exp(-dt/tau)) (command - speed)
    [rad/s]; the share is dimensionless and exact for a command held over dt

    Args:
        vehicle: Record of `records.CONSTANTS`; holds the two shares.
        speed: Rotor speed [rad/s], >= 0.
        command: Commanded speed [rad/s], >= 0.

    Source:
        Furrer, Burri, Achtelik and Siegwart 2016 (RotorS), doi:10.1007/978-3-319-26054-9_23.
    Held by:
        tests/unit/services/world/physics/test_rotors.py
    """
    response = vehicle.response_up if command > speed else vehicle.response_down
    return speed + response * (command - speed)


@numba.njit(cache=True, nogil=True)
def rotor_wrench(vehicle, rotor_speed_rad_s):
    """Return thrust, torques about the body axes, and the sum of the rotors' speeds.

    (T, tau) = M (c speed_i^2)
    [N], [N m] = [1], [m] times [N s^2] [rad/s]^2

    Args:
        vehicle: Record of `records.CONSTANTS`; M is its `wrench_from_thrusts`.
        rotor_speed_rad_s: (n_rotors or more,) rotor speeds [rad/s].

    Returns:
        (thrust [N], torque x, y, z [N m], sum of speeds [rad/s]).

    Source:
        Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, equation 2. Thrust does not depend on air speed; blade
        flapping, gyroscopic torque of the rotors, ground effect and downwash are left out.
    Held by:
        tests/unit/services/world/physics/test_rotors.py
    """
    M = vehicle.wrench_from_thrusts
    thrust = tau_x = tau_y = tau_z = total = 0.0
    for i in range(vehicle.n_rotors):
        speed = rotor_speed_rad_s[i]
        T = vehicle.thrust_coefficient_n_s2 * speed * speed
        thrust += M[0, i] * T
        tau_x += M[1, i] * T
        tau_y += M[2, i] * T
        tau_z += M[3, i] * T
        total += speed
    return thrust, tau_x, tau_y, tau_z, total


@numba.njit(cache=True, nogil=True)
def drag_force(vehicle, total_speed, u, v, w):
    """Return the drag of rotors and hull in a relative wind, body frame.

    F_i = c_i sum(speed) u_i + 1/2 rho A_i |u| u_i          u air velocity minus body velocity
    [N] = [N s^2/m] [rad/s] [m/s] = [kg/m^3] [m^2] [m/s]^2

    Args:
        vehicle: Record of `records.CONSTANTS`.
        total_speed: Sum of the rotors' speeds [rad/s].
        u: Relative wind along body x [m/s].
        v: Relative wind along body y [m/s].
        w: Relative wind along body z [m/s].

    Returns:
        (F_x, F_y, F_z) body frame [N], at the centre of mass.

    Source:
        Rotor drag linear in speed: Furrer et al. 2016 (RotorS), doi:10.1007/978-3-319-26054-9_23; hull drag by the
        drag area per axis.
    Deviation:
        The rotors' drag acts at the centre of mass, not at the hubs, so that it makes no torque.
    Held by:
        tests/unit/services/world/physics/test_rotors.py, tests/analytic/test_world_flight.py (terminal speed)
    """
    speed = math.sqrt(u * u + v * v + w * w)
    c, q = vehicle.rotor_drag_n_s2_m, vehicle.half_density_drag_area_kg_m
    return (
        (c[0] * total_speed + q[0] * speed) * u,
        (c[1] * total_speed + q[1] * speed) * v,
        (c[2] * total_speed + q[2] * speed) * w,
    )


class RotorFaults:
    """Rotor faults: events weaken rotors in the records of `CONSTANTS` of all vehicles, in place.

    A rotor of share s gives s k w^2 at a speed w, and its torques likewise; how thrusts are shared out stays as it was,
    as the control does not know.
    """

    def __init__(self, scenario: Scenario, constants: Any) -> None:
        """Prepare for the events of a scenario.

        Args:
            scenario: Its agents, in the order of the records.
            constants: The records, of sound vehicles.
        """
        self._scenario = scenario
        self._constants = constants
        self._sound = constants["wrench_from_thrusts"].copy()
        self._number = {agent.name: k for k, agent in enumerate(scenario.agents)}

    def reset(self) -> None:
        """Restore all rotors."""
        self._constants["wrench_from_thrusts"] = self._sound

    def obey(self, inbox: Inbox) -> None:
        """Do what takes effect in this tick."""
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, RotorWeakensSpec):
                k, i = self._number[event.agent], event.rotor
                self._constants["wrench_from_thrusts"][k, :, i] = event.share * self._sound[k, :, i]
