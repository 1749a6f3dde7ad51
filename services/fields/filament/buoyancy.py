"""Buoyancy of filaments: their vertical velocity where the gas is lighter or heavier than air."""

import math
from dataclasses import dataclass

from gslcosim.base.quantities import GRAVITY_M_S2

SPHERE_DRAG = 0.5
RADIUS_SIGMA = 2.0

_GADEN_3_GRAVITY_M_S2 = 9.8
_GADEN_3_AIR_KG_M3 = 1.205
_GADEN_3_VISCOSITY_PA_S = 19e-6


@dataclass(frozen=True, kw_only=True)
class Buoyancy:
    """Vertical velocity of a filament relative to the air, upward: w = coefficient / sigma^power [m/s].

    `coefficient` [m^(1 + power) / s] is negative for heavy gases; sigma is the filament's standard deviation [m].
    """

    coefficient: float = 0.0
    power: int = 1

    def velocity_m_s(self, sigma_m: float) -> float:
        """Return the vertical velocity of a filament of this size [m/s], upward."""
        return self.coefficient / sigma_m**self.power


NEUTRAL = Buoyancy()


def terminal_velocity_buoyancy(specific_gravity: float, gas_volume_m3: float) -> Buoyancy:
    """Return the buoyancy of a filament whose weight in air is balanced by the drag of a sphere around it.

    g |1 - SG| rho V = Cd rho/2 pi r^2 w^2    =>    w = sqrt(2 g |1 - SG| V / (pi Cd)) / r      r = 2 sigma
    [m/s] = sqrt([m/s2] [m3]) / [m]; upward for SG < 1.

    V is the volume that the filament's gas takes when pure; it stays while the filament grows, so w falls as
    1 / sigma. A filament of 10 ppm and 0.1 m sinks at 1.4 mm/s with ethanol and rises at 4.7 mm/s with methane.

    Args:
        specific_gravity: Density of the pure gas relative to air SG, >= 0.
        gas_volume_m3: Volume of the pure gas in a filament V [m3].

    Source:
        Our derivation: balance of forces on a sphere that holds three quarters of the gas, with Cd = 0.5 (spheres at
        Reynolds numbers of some hundred to 1e5).
    Left out:
        Inertia (the balance is reached at once) and entrainment. Each filament moves by its own weight: a dense
        cloud of many filaments would move faster together.
    Held by:
        tests/unit/services/fields/filament/test_buoyancy.py
    """
    magnitude = math.sqrt(2.0 * GRAVITY_M_S2 * abs(1.0 - specific_gravity) * gas_volume_m3 / (math.pi * SPHERE_DRAG))
    return Buoyancy(coefficient=math.copysign(magnitude / RADIUS_SIGMA, 1.0 - specific_gravity), power=1)


def gaden_3_buoyancy(specific_gravity: float, ppm: float, sigma_m: float) -> Buoyancy:
    """Return GADEN 3's buoyancy, for repeating published work.

    w = g (1 - SG) rho X / (18 mu), X the mixing ratio at the filament's centre, ppm (sigma0 / sigma)^3 1e-6

    Its dimension is 1 / (m s): the square of a length is missing. The figures are taken as metres per second.

    Args:
        specific_gravity: Density of the pure gas relative to air SG.
        ppm: Mixing ratio at the centre at birth.
        sigma_m: Size at birth [m].

    Source:
        gaden_core, src/RunningSimulation.cpp, with g 9.8, rho 1.205 and mu 19e-6.
    Held by:
        tests/unit/services/fields/filament/test_buoyancy.py (ethanol -0.0131, methane 0.1541, hydrogen 0.3213 m/s at
        10 ppm)
    """
    at_birth = _GADEN_3_GRAVITY_M_S2 * (1.0 - specific_gravity) * _GADEN_3_AIR_KG_M3 * ppm * 1e-6
    return Buoyancy(coefficient=at_birth / (18.0 * _GADEN_3_VISCOSITY_PA_S) * sigma_m**3, power=3)
