"""Units of measure at the ends of names, such as `_m_s`, beside those of other people's files."""

from collections.abc import Mapping
from dataclasses import dataclass

# Ends of names: names of the unit in other people's files, exponents of SI, and factor.
_MEASURES: Mapping[str, tuple[tuple[str, ...], Mapping[str, int], float]] = {
    "_m_s2": (("m/s2", "m/s^2", "m.s-2", "m/(s.s)"), {"m": 1, "s": -2}, 1.0),
    "_m_s": (("m/s", "m.s-1", "m s-1", "m*s^-1"), {"m": 1, "s": -1}, 1.0),
    "_rad_s": (("rad/s", "rad.s-1", "1/s"), {"rad": 1, "s": -1}, 1.0),
    "_kg_s": (("kg/s", "kg.s-1", "kg s-1"), {"kg": 1, "s": -1}, 1.0),
    "_kg_m3": (("kg/m3", "kg/m^3", "kg.m-3"), {"kg": 1, "m": -3}, 1.0),
    "_m3_s": (("m3/s", "m^3/s", "m3.s-1"), {"m": 3, "s": -1}, 1.0),
    "_m2_s": (("m2/s", "m^2/s", "m2.s-1"), {"m": 2, "s": -1}, 1.0),
    "_ppm": (("ppm", "umol/mol"), {}, 1e-6),
    "_share": (("1", "-", ""), {}, 1.0),
    "_frac": (("1", "-", ""), {}, 1.0),
    "_rad": (("rad",), {"rad": 1}, 1.0),
    "_hz": (("Hz", "1/s", "s-1"), {"s": -1}, 1.0),
    "_pa": (("Pa", "N/m2"), {"kg": 1, "m": -1, "s": -2}, 1.0),
    "_kg": (("kg",), {"kg": 1}, 1.0),
    "_m": (("m",), {"m": 1}, 1.0),
    "_s": (("s",), {"s": 1}, 1.0),
    "_k": (("K",), {"K": 1}, 1.0),
    "_w": (("W", "J/s"), {"kg": 1, "m": 2, "s": -3}, 1.0),
    "_j": (("J", "W.s", "N.m"), {"kg": 1, "m": 2, "s": -2}, 1.0),
    "_v": (("V",), {"kg": 1, "m": 2, "s": -3, "A": -1}, 1.0),
    "_a": (("A",), {"A": 1}, 1.0),
}


@dataclass(frozen=True, kw_only=True)
class UnitOfMeasure:
    """A unit of measure of a file: its name, and where the file has them its exponents of SI, factor and offset."""

    name: str
    exponents: Mapping[str, int] | None = None
    factor: float = 1.0
    offset: float = 0.0

    def is_that_of(self, suffix: str) -> bool:
        """Return whether it is the unit at the end of a name.

        Args:
            suffix: From `find_measure_suffix`.
        """
        names, exponents, factor = _MEASURES[suffix]
        if self.name.strip() in names:
            return True
        if self.exponents is None:
            return False
        # Of angles SI has no unit, and many files say none.
        own, other = ({key: n for key, n in each.items() if key != "rad"} for each in (self.exponents, exponents))
        return own == other and self.factor == factor and self.offset == 0.0


def find_measure_suffix(name: str) -> str | None:
    """Return the end of a name that says a unit of measure, None where none does."""
    longest_first = sorted(_MEASURES, key=len, reverse=True)
    return next((suffix for suffix in longest_first if f"_{name}".endswith(suffix)), None)


def name_measure(suffix: str) -> str:
    """Return the usual name of the unit at the end of a name."""
    return _MEASURES[suffix][0][0]
