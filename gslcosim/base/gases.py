"""Gases and the figures that models need of each, with their sources; one entry adds a gas."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

# GADEN's 82.057338 cm3 atm/(mol K), so that amounts compare to the last digit (the exact constant is 3e-7 larger).
GAS_CONSTANT_J_MOL_K = 82.057338e-6 * 101325.0
REFERENCE_TEMPERATURE_K = 298.0
REFERENCE_PRESSURE_PA = 101325.0

PID_LAMPS_EV = (10.6, 11.7)
"""Lamps on the market: krypton, and argon behind a lithium fluoride window."""

_GADEN = "GADEN's player, which takes some from mixtures: pure ethanol vapour is about 1.59"
_FIGARO = "figures of Figaro's data sheets in GADEN, simulated_gas_sensor/src/fake_gas_sensor.cpp"
_AS_METHANE = "methane's, which GADEN marks as still to review"
# Not verified: uncertain by a quarter, and different by maker (others print 8.7 to 10 for ethanol at 10.6 eV).
_TN_106 = "RAE Systems, Technical Note TN-106, revision of 08/2010"
_METHANE_MOX = {
    "tgs2600": (1.018, -0.07284), "tgs2610": (63.91, -0.5372), "tgs2611": (38.46, -0.4289),
    "tgs2612": (146.2, -0.5916), "tgs2620": (120.6, -0.4877),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Gas:
    """Figures of a gas; NaN or absent where no model needs one.

    Attributes:
        specific_gravity: Density relative to air at equal temperature [1].
        gaden_code: Number in GADEN's files; None for gases that GADEN does not have.
        density_kg_m3: Density of the pure gas near 293 K [kg/m3].
        diffusivity_m2_s: Molecular diffusivity in air [m2/s].
        molar_mass_kg_mol: Molar mass [kg/mol].
        ionisation_ev: Ionisation energy [eV].
        pid: Correction factor of a photo-ionisation detector by the energy of its lamp [eV]: the true mixing ratio over
            the reading of an instrument calibrated with isobutylene. Without a factor, the lamp does not detect it.
        mox: (A, B) of Rs/R0 = A c^B, c in ppm, by model of MOX sensor; other models do not respond.
        sources: Origin of each figure, by the name of its attribute.
    """

    specific_gravity: float
    gaden_code: int | None = None
    density_kg_m3: float = math.nan
    diffusivity_m2_s: float = math.nan
    molar_mass_kg_mol: float = math.nan
    ionisation_ev: float = math.nan
    pid: Mapping[float, float] = field(default_factory=dict)
    mox: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)


# Above 11.7 eV, which no lamp reaches: hydrogen 15.43, fluorine 15.7, methane 12.61, carbon dioxide 13.77, carbon
# monoxide 14.01, helium 24.6, neon 21.6. Smoke is no one gas.
GASES = {
    "ethanol": Gas(
        specific_gravity=1.0378,
        gaden_code=0,
        ionisation_ev=10.47,
        pid={10.6: 7.9, 11.7: 3.1},
        mox={
            "tgs2600": (0.6796, -0.3196), "tgs2602": (0.77, -0.43), "tgs2610": (106.1, -0.5008),
            "tgs2611": (51.11, -0.3658), "tgs2612": (31.35, -0.09115), "tgs2620": (62.32, -0.7155),
        },
        sources={
            "specific_gravity": _GADEN, "ionisation_ev": _TN_106, "pid": _TN_106,
            # About 0.75 at 1 ppm, 0.3 at 10 ppm and 0.17 at 30 ppm.
            "mox": f"{_FIGARO}; TGS2602: curve of Figaro's sheet from 1 to 30 ppm, within a factor of two",
        },
    ),
    "methane": Gas(
        specific_gravity=0.5537,
        gaden_code=1,
        density_kg_m3=0.668,
        molar_mass_kg_mol=0.0160425,
        mox=_METHANE_MOX,
        sources={
            "specific_gravity": _GADEN, "density_kg_m3": "ideal gas at 293 K and 1 atm",
            "molar_mass_kg_mol": "NIST webbook", "mox": _FIGARO,
        },
    ),
    "hydrogen": Gas(
        specific_gravity=0.0696,
        gaden_code=2,
        density_kg_m3=0.084,
        mox={
            "tgs2600": (0.6821, -0.3532), "tgs2610": (66.78, -0.4888), "tgs2611": (41.3, -0.3614),
            "tgs2612": (19.5, 0.0), "tgs2620": (24.45, -0.5546),
        },
        sources={"specific_gravity": _GADEN, "density_kg_m3": "ideal gas at 293 K and 1 atm", "mox": _FIGARO},
    ),
    # 2-propanol; 1-propanol has the factors 5 and 1.7.
    "propanol": Gas(
        specific_gravity=1.23,
        gaden_code=3,
        ionisation_ev=10.12,
        pid={10.6: 6.0, 11.7: 2.7},
        mox=_METHANE_MOX,
        sources={"specific_gravity": _GADEN, "ionisation_ev": _TN_106, "pid": _TN_106, "mox": _AS_METHANE},
    ),
    "chlorine": Gas(
        specific_gravity=2.48,
        gaden_code=4,
        ionisation_ev=11.48,
        pid={11.7: 1.0},
        mox=_METHANE_MOX,
        sources={"specific_gravity": _GADEN, "ionisation_ev": _TN_106, "pid": _TN_106, "mox": _AS_METHANE},
    ),
    "fluorine": Gas(
        specific_gravity=1.31,
        gaden_code=5,
        mox=_METHANE_MOX,
        sources={"specific_gravity": _GADEN, "mox": _AS_METHANE},
    ),
    "acetone": Gas(
        specific_gravity=1.4529,
        gaden_code=6,
        ionisation_ev=9.71,
        pid={10.6: 1.1, 11.7: 1.4},
        mox=_METHANE_MOX,
        sources={"specific_gravity": _GADEN, "ionisation_ev": _TN_106, "pid": _TN_106, "mox": _AS_METHANE},
    ),
    "neon": Gas(specific_gravity=0.7, gaden_code=7, sources={"specific_gravity": _GADEN}),
    "helium": Gas(
        specific_gravity=0.138,
        gaden_code=8,
        density_kg_m3=0.166,
        diffusivity_m2_s=7.0e-5,
        sources={
            "specific_gravity": _GADEN, "density_kg_m3": "ideal gas at 293 K and 1 atm",
            "diffusivity_m2_s": "at 294 K: Fuller, Schettler and Giddings 1966, doi:10.1021/ie50677a007",
        },
    ),
    "biogas": Gas(specific_gravity=0.8, gaden_code=9, sources={"specific_gravity": _GADEN}),
    # n-butane; isobutane, barely below 10.6 eV, has the factors 100 and 1.2.
    "butane": Gas(
        specific_gravity=2.0061,
        gaden_code=10,
        ionisation_ev=10.53,
        pid={10.6: 67.0, 11.7: 1.2},
        sources={"specific_gravity": _GADEN, "ionisation_ev": _TN_106, "pid": _TN_106},
    ),
    "carbon_dioxide": Gas(specific_gravity=1.52, gaden_code=11, sources={"specific_gravity": _GADEN}),
    "carbon_monoxide": Gas(specific_gravity=0.967, gaden_code=12, sources={"specific_gravity": _GADEN}),
    "smoke": Gas(specific_gravity=0.89, gaden_code=13, sources={"specific_gravity": _GADEN}),
}  # fmt: skip


def air_density_mol_m3(
    temperature_k: float = REFERENCE_TEMPERATURE_K, pressure_pa: float = REFERENCE_PRESSURE_PA
) -> float:
    """Return the amount of gas in a cubic metre of air [mol/m3].

    n = p / (R T)
    [mol/m3] = [Pa] / ([J/(mol K)] [K])

    Held by:
        tests/unit/base/test_gases.py (40.894 mol/m3 at 298 K and 1 atm)
    """
    return pressure_pa / (GAS_CONSTANT_J_MOL_K * temperature_k)
