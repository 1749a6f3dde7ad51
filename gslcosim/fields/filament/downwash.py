"""Rotors over gas: which vehicles blow, how strongly, and where they are."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import BodyPoses
from gslcosim.fields.filament.buoyancy import GRAVITY_M_S2
from gslcosim.scenario import Scenario

AIR_KG_M3 = 1.204


@dataclass(frozen=True, kw_only=True)
class Multirotor:
    """What the jet below a vehicle with four rotors depends on.

    `motor_distance_m` is that along the diagonal. Masses and places of rotors are those of gslcosim/world/vehicles,
    which this layer cannot read; a test holds them equal.
    """

    mass_kg: float
    rotor_radius_m: float
    motor_distance_m: float

    @property
    def outflow_m_s(self) -> float:
        """Return the speed of the air at a rotor's disc in hover [m/s].

        Uj = sqrt(m g / 4 / (2 rho pi R^2))
        [m/s] = sqrt([kg] [m/s2] / ([kg/m3] [m2]))

        Source: momentum theory of one of four rotors, each of which carries a quarter of the weight.
        Deviation: gaden_core multiplies the weight by four instead.
        Held by: tests/unit/fields/filament/test_downwash.py
        """
        disc_m2 = math.pi * self.rotor_radius_m**2
        return math.sqrt(self.mass_kg * GRAVITY_M_S2 / 4.0 / (2.0 * AIR_KG_M3 * disc_m2))


# Rotor radii: PX4's iris, and the 45 mm propellers of the Crazyflie. What has no rotors is missing.
MULTIROTORS = {
    "iris": Multirotor(mass_kg=1.535, rotor_radius_m=0.128, motor_distance_m=math.hypot(0.26, 0.42)),
    "crazyflie": Multirotor(mass_kg=0.027, rotor_radius_m=0.0225, motor_distance_m=math.hypot(0.065, 0.065)),
}


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
        models = {agent.name: MULTIROTORS.get(agent.vehicle.model) for agent in scenario.agents if is_on}
        self._blowing = {name: rotor for name, rotor in models.items() if rotor is not None}

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
        rotors = [self._blowing[name] for name, _ in blowing]
        return Jets(
            centre_world_m=np.array([place for _, place in blowing], np.float64).reshape(-1, 3),
            motor_distance_m=np.array([rotor.motor_distance_m for rotor in rotors], np.float64),
            outflow_m_s=np.array([rotor.outflow_m_s for rotor in rotors], np.float64),
        )
