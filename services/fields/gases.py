"""Gases that can be released, by name and by GADEN's number."""

from dataclasses import dataclass

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.models import gas as gas_models
from gslcosim.scenario.models.gas import GasDefinition

# GADEN's 82.057338 cm3 atm/(mol K), so that amounts compare to the last digit (the exact constant is 3e-7 larger).
GAS_CONSTANT_J_MOL_K = 82.057338e-6 * 101325.0
REFERENCE_TEMPERATURE_K = 298.0
REFERENCE_PRESSURE_PA = 101325.0


@dataclass(frozen=True, kw_only=True)
class Gas:
    """A gas as GADEN numbers it; `specific_gravity` is the density relative to air at equal temperature [1].

    The figures are those of GADEN's player. Some are of mixtures: pure ethanol vapour is about 1.59. Gases that a
    scenario defines have no number.
    """

    name: str
    gaden_code: int | None
    specific_gravity: float


GASES = {
    name: Gas(name=name, gaden_code=code, specific_gravity=specific_gravity)
    for code, (name, specific_gravity) in enumerate(gas_models.GASES.items())
}


def list_gases(definitions: tuple[GasDefinition, ...]) -> dict[str, Gas]:
    """Return all gases by name: those of the table, and those that a scenario defines."""
    defined = {
        gas.name: Gas(name=gas.name, gaden_code=None, specific_gravity=gas.specific_gravity) for gas in definitions
    }
    return {**GASES, **defined}


def find_gas(name: str, *, place: str = "gas.gas", definitions: tuple[GasDefinition, ...] = ()) -> Gas:
    """Return the gas of that name.

    Args:
        name: Of the table, or of one that the scenario defines.
        place: Where in the scenario the name stands, for the error.
        definitions: The gases that the scenario defines.

    Raises:
        ScenarioError: there is no such gas.
    """
    known = list_gases(definitions)
    if name not in known:
        raise ScenarioError(f"{place}: expected one of {', '.join(known)}, was {name!r}.")
    return known[name]


def air_density_mol_m3(
    temperature_k: float = REFERENCE_TEMPERATURE_K, pressure_pa: float = REFERENCE_PRESSURE_PA
) -> float:
    """Return how many moles of gas a cubic metre of air holds.

    n = p / (R T)
    [mol/m3] = [Pa] / ([J/(mol K)] [K])

    Held by:
        tests/unit/services/fields/test_gases.py (40.894 mol/m3 at 298 K and 1 atm)
    """
    return pressure_pa / (GAS_CONSTANT_J_MOL_K * temperature_k)
