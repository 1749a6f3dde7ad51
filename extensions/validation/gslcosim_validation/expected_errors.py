"""Expected error of a run's gas for its kind of air, from results that the package stores.

`make reality` writes `expected_errors.json` from the results of all cases; docs/studies/reality.md shows it.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NotRequired, TypedDict

from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim.validity.findings import Finding
from gslcosim_validation.air_kinds import AIR_KINDS, AirKind, find_air_kind
from gslcosim_validation.release_pairs import Quantity

FILE = "expected_errors.json"
ABOUT = "expected_error"
PAGE = "docs/studies/reality.md#what-a-runs-air-may-be-wrong-by"
QUANTITIES: Mapping[Quantity, str] = {"mean": "mean concentration", "intensity": "intensity of fluctuations"}
"""All quantities, with their words."""


class RatioInterval(TypedDict):
    """Modelled over measured in a release of a new set: the middle and the ends of the interval.

    `sets`: releases of each set behind it. `of_all_kinds`: whether it is that of all kinds of air together, as its own
    kind has too few sets. `fac2`: share of instruments within a factor of two, each set counting the same; of the mean
    alone.
    """

    ratio: float
    low: float
    high: float
    sets: dict[str, int]
    of_all_kinds: bool
    fac2: NotRequired[float]


class ExpectedErrors(TypedDict):
    """Content of the file: the level of its intervals, and an interval for each kind of air and quantity."""

    level: float
    kinds_of_air: Mapping[AirKind, Mapping[Quantity, RatioInterval]]


@cache
def read_expected_errors() -> ExpectedErrors:
    """Return the errors that the package has."""
    return json.loads(Path(__file__).with_name(FILE).read_text(encoding="utf-8"))


def find_expected_error(scenario: Scenario, environments: Sequence[Path]) -> Iterator[Finding]:
    """Yield the finding on what the gas of a run may be wrong by, for its kind of air.

    Args:
        scenario: The run's.
        environments: The folder of its environment, and those that events made of it, which are of the same kind.
    """
    kind = find_air_kind(scenario, next(iter(environments), None))
    errors = read_expected_errors()
    known = errors["kinds_of_air"].get(kind)
    if known is None:
        return
    gas = scenario.gas
    is_without_eddies = isinstance(gas, FilamentsSpec) and gas.eddies is None
    yield Finding(
        about=ABOUT,
        severity="quote",
        text=_describe(kind, known, errors["level"]),
        remedy="Filaments without eddies (gas.turbulence.kind: none) err by more." if is_without_eddies else "",
        figures={"kind_of_air": kind, "level": errors["level"], **known, "page": PAGE},
    )


def _describe(kind: AirKind, known: Mapping[Quantity, RatioInterval], level: float) -> str:
    parts = [
        f"{words} {interval['ratio']:.2g} [{interval['low']:.2g}, {interval['high']:.2g}]"
        for quantity, words in QUANTITIES.items()
        if (interval := known.get(quantity)) is not None
    ]
    mean = known.get("mean", {})
    share = f", means within a factor of two at {mean['fac2']:.0%} of places" if "fac2" in mean else ""
    sets = sorted({name for interval in known.values() for name in interval["sets"]})
    pooled = " of all kinds of air" if any(interval["of_all_kinds"] for interval in known.values()) else ""
    return (
        f"{AIR_KINDS[kind].capitalize()}: {' and '.join(parts)} times the true one ({level:.0%} intervals){share}, "
        f"by {len(sets)} measured sets{pooled}."
    )
