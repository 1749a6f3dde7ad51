"""Rotors over gas: which vehicles blow, how strongly, and where they are."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import BodyPoses
from gslcosim.quantities import GRAVITY_M_S2
from gslcosim.scenario import Scenario
from gslcosim.vehicles import Vehicle

AIR_KG_M3 = 1.204


def outflow_m_s(vehicle: Vehicle) -> float:
    """Return the speed of the air at a rotor's disc in hover [m/s]; 0 for a vehicle without rotors.

    Uj = sqrt(m g / n / (2 rho pi R^2))
    [m/s] = sqrt([kg] [m/s2] / ([kg/m3] [m2]))

    Source: momentum theory of one of n rotors, each of which carries its share of the weight.
    Deviation: gaden_core multiplies the weight by four instead.
    Held by: tests/unit/fields/filament/test_downwash.py
    """
    rotors = vehicle.rotors
    if rotors is None:
        return 0.0
    disc_m2 = math.pi * rotors.rotor_radius_m**2
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
        """Whether there is a vehicle that blows."""
        return bool(self._blowing)

    def jets_of(self, bodies: BodyPoses) -> Jets:
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
