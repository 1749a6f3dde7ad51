# pyright: basic
"""Downwash of rotors: the jets below vehicles in the air, and the filaments that they carry down."""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import GRAVITY_M_S2
from gslcosim.contract.messages import BodyPoses
from gslcosim.scenario import Scenario
from gslcosim.vehicles import Vehicle
from gslcosim_services.fields.filament.filament_step import trace_reflections

# Constants of the merged jet, in motor distances.
DECAY = 10.11
ORIGIN = -5.817
WIDENING = 0.07668
FIRST_HALF_WIDTH = 0.1
PROFILE = math.sqrt(2.0) - 1.0
# Beyond these the jet is slower than the room's air.
REACH_BELOW = 20.0
REACH_ASIDE = 4.0
# A filament crosses at most this fraction of a motor distance between two evaluations of the jet.
MAX_MOVE = 0.25

AIR_KG_M3 = 1.204


@numba.njit(cache=True, nogil=True)
def jet_speed_m_s(below, aside, outflow_m_s):
    """Return the downward speed in the jet below a multirotor [m/s], 0 above it and far from it.

    U = Uj 10.11 / (s - s0) / (1 + (sqrt(2) - 1) (r / b)^2)^2, b = 0.07668 (s - s0) + 0.1, s0 = -5.817
    [m/s]; s, r and b in motor distances. At r = b the speed is half that of the centre line.

    Args:
        below: Distance below the rotors s, in motor distances.
        aside: Distance from the axis r, in motor distances.
        outflow_m_s: Speed at one rotor's disc Uj [m/s] (see `gslcosim_services.fields.filament.downwash`).

    Source:
        IEEE document 10804051, as given in gaden_core, include/gaden/AirflowDisturbance.hpp.
    Deviation:
        There the width takes the distance without its unit, and the air flows away from the drone on all sides; here
        the paper's form is taken: all in motor distances, and downward.
    Held by:
        tests/unit/services/fields/filament/test_downwash.py
    """
    if below <= 0.0 or below > REACH_BELOW:
        return 0.0
    half_width = WIDENING * (below - ORIGIN) + FIRST_HALF_WIDTH
    if aside > REACH_ASIDE * half_width:
        return 0.0
    centre_m_s = outflow_m_s * DECAY / (below - ORIGIN)
    spread = 1.0 + PROFILE * (aside / half_width) ** 2
    return centre_m_s / (spread * spread)


@numba.njit(cache=True, nogil=True)
def blow_filaments_inplace(
    position_world_m, n, rotors_world_m, motor_distance_m, outflow_m_s, occupancy, origin_m, cell_m, step_s
):
    """Carry filaments down in the jets of multirotors for one gas step; they slide along walls and the floor.

    dz = -U dt, cut so that none of the parts exceeds a quarter of a motor distance

    Args:
        position_world_m: (>= n, 3) filament centres, world frame [m]; modified.
        n: Number of filaments.
        rotors_world_m: (k, 3) centres of the multirotors, world frame [m].
        motor_distance_m: (k,) their motor distances [m].
        outflow_m_s: (k,) their outflow speeds [m/s].
        occupancy: (nx, ny, nz) uint8, 1 is solid, 2 an outlet.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        step_s: Length of the gas step [s].

    Left out:
        The jet's turn along the floor, the inflow above, its tilt with the vehicle, and its wind at the anemometer.
    Held by:
        tests/unit/services/fields/filament/test_downwash.py
    """
    for k in range(rotors_world_m.shape[0]):
        size_m = motor_distance_m[k]
        for f in range(n):
            left_s = step_s
            while left_s > 0.0:
                x, y, z = position_world_m[f, 0], position_world_m[f, 1], position_world_m[f, 2]
                below = (rotors_world_m[k, 2] - z) / size_m
                if below <= 0.0 or below > REACH_BELOW:
                    break
                dx_m, dy_m = x - rotors_world_m[k, 0], y - rotors_world_m[k, 1]
                aside = math.sqrt(dx_m * dx_m + dy_m * dy_m) / size_m
                speed_m_s = jet_speed_m_s(below, aside, outflow_m_s[k])
                if speed_m_s <= 0.0:
                    break
                part_s = min(left_s, MAX_MOVE * size_m / speed_m_s)
                nx, ny, nz, has_left, _, _, _ = trace_reflections(
                    occupancy, origin_m, cell_m, x, y, z, 0.0, 0.0, -speed_m_s * part_s, reflects=False
                )
                if has_left or nz >= z:
                    break
                position_world_m[f, 0], position_world_m[f, 1], position_world_m[f, 2] = nx, ny, nz
                left_s -= part_s


def outflow_m_s(vehicle: Vehicle) -> float:
    """Return the speed of the air at a rotor's disc in hover [m/s]; 0 for a vehicle without rotors.

    Uj = sqrt(m g / n / (2 rho pi R^2))
    [m/s] = sqrt([kg] [m/s2] / ([kg/m3] [m2]))

    Source: momentum theory of one of n rotors, each of which carries an equal part of the weight.
    Deviation: gaden_core multiplies the weight by four instead.
    Held by: tests/unit/services/fields/filament/test_downwash.py
    """
    rotors = vehicle.rotors
    if rotors is None:
        return 0.0
    disc_m2 = math.pi * rotors.rotor_radius_m * rotors.rotor_radius_m
    return math.sqrt(vehicle.body.mass_kg * GRAVITY_M_S2 / rotors.n_rotors / (2.0 * AIR_KG_M3 * disc_m2))


@dataclass(frozen=True, kw_only=True)
class Jets:
    """The jets of one instant: (k, 3) centres [m], (k,) motor distances [m] and (k,) outflow speeds [m/s]."""

    centre_world_m: NDArray[np.float64]
    motor_distance_m: NDArray[np.float64]
    outflow_m_s: NDArray[np.float64]


class Downwash:
    """The jets of a scenario's vehicles; none with `rotor_downwash: false`, and none on the ground."""

    def __init__(self, scenario: Scenario) -> None:
        is_on = scenario.gas.rotor_downwash
        vehicles = {agent.name: agent.vehicle.facts for agent in scenario.agents if is_on}
        self._blowing = {
            name: (vehicle.rotors.motor_distance_m, outflow_m_s(vehicle))
            for name, vehicle in vehicles.items()
            if vehicle.rotors is not None
        }

    @property
    def is_on(self) -> bool:
        """True if there is a vehicle with a jet."""
        return bool(self._blowing)

    def compute_jets(self, bodies: BodyPoses) -> Jets:
        """Return the jets of the vehicles in the air, by name."""
        blowing = sorted(
            (body.agent, body.position_world_m)
            for body in bodies.bodies
            if body.agent in self._blowing and body.phase not in ("on_ground", "failed")
        )
        jets = [self._blowing[name] for name, _ in blowing]
        return Jets(
            centre_world_m=np.array([place for _, place in blowing], np.float64).reshape(-1, 3),
            motor_distance_m=np.array([distance_m for distance_m, _ in jets], np.float64),
            outflow_m_s=np.array([speed_m_s for _, speed_m_s in jets], np.float64),
        )
