"""Units of the variables of an FMU beside those at the ends of names, such as `_m_s`."""

from collections.abc import Mapping
from dataclasses import dataclass

from gslcosim.base.units_of_measure import UNITS, unit_suffix


@dataclass(frozen=True, kw_only=True)
class UnitOfMeasure:
    """A unit of measure as the description of an FMU has it.

    Attributes:
        name: As the description has it.
        exponents: Of the base units of SI; None: the description has none.
        factor: How many of the SI unit it is.
        offset: Its zero, in the SI unit.
    """

    name: str
    exponents: Mapping[str, int] | None = None
    factor: float = 1.0
    offset: float = 0.0

    def is_that_of(self, key: str) -> bool:
        """Return whether it is the unit at the end of a name."""
        unit = UNITS[unit_suffix(key)]
        if self.name.strip() in unit.symbols:
            return True
        if self.exponents is None or unit.exponents is None:
            return False
        # SI has no unit of angles, and many descriptions leave it out.
        own, other = (
            {name: n for name, n in each.items() if name != "rad"} for each in (self.exponents, unit.exponents)
        )
        return own == other and self.factor == unit.factor and self.offset == 0.0


def unit_symbol(key: str) -> str:
    """Return the usual symbol of the unit at the end of a name, such as `m/s`; empty where there is none."""
    suffix = unit_suffix(key)
    return next(iter(UNITS[suffix].symbols), "") if suffix else ""
