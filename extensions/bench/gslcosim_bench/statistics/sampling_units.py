"""Sampling units of a suite: whole rooms, whole plumes or single flights, and the spread of means over them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim_bench.statistics.estimates import check_same_length, encode_labels

MIN_FREEDOM = 5
"""Degrees of freedom below which a level is not drawn from: with five units or fewer, no test of signs reaches 5 %."""

Level = Literal["rooms", "plumes", "flights"]


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplingUnits:
    """Independent observations of a suite: rooms, plumes or flights, and what they are drawn within.

    Attributes:
        level: The highest level that has enough units; those above it are taken as they are.
        unit: (n,) index of the unit of each flight.
        stratum: (n,) label of what units are drawn within; None: all units are drawn together.
        case: (n,) index of the case of each flight: cases count the same, however many flights they have.
        n_rooms: Number of rooms.
        n_plumes: Number of plumes of all rooms.
    """

    level: Level
    unit: NDArray[np.int64]
    stratum: NDArray[np.int64] | None
    case: NDArray[np.int64]
    n_rooms: int
    n_plumes: int

    @property
    def clusters(self) -> NDArray[np.int64] | None:
        """Labels for functions that draw clusters; None where each flight is a unit."""
        return None if self.level == "flights" else self.unit

    @property
    def n(self) -> int:
        """Number of units."""
        return int(self.unit.max(initial=-1)) + 1

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the spread: units less strata."""
        return self.n - (1 if self.stratum is None else np.unique(self.stratum).size) if self.n else 0

    @property
    def stratum_of_unit(self) -> NDArray[np.int64]:
        """(n_units,) index of the stratum of each unit."""
        found = np.zeros(self.n, dtype=np.int64)
        if self.stratum is not None:
            found[self.unit] = encode_labels(self.stratum)
        return found

    def select(self, chosen: NDArray[Any]) -> "SamplingUnits":
        """Return the units of some flights, of the same level."""
        unit = encode_labels(self.unit[chosen]) if len(chosen) else self.unit[:0]
        stratum = None if self.stratum is None else self.stratum[chosen]
        case = encode_labels(self.case[chosen]) if len(chosen) else self.case[:0]
        return SamplingUnits(
            level=self.level, unit=unit, stratum=stratum, case=case, n_rooms=self.n_rooms, n_plumes=self.n_plumes
        )


def find_sampling_units(
    rooms: Sequence[Any] | NDArray[Any], plumes: Sequence[Any] | NDArray[Any], cases: Sequence[Any] | NDArray[Any]
) -> SamplingUnits:
    """Return what is drawn: rooms where there are enough of them, else plumes, else flights.

    Flights are nested in plumes and plumes in rooms. Whole rooms are drawn, with all plumes and flights in them: the
    spread of their means holds that of plumes and flights, so drawing these once more would count it twice. Where
    rooms are fewer than six, they are taken as the only ones, and plumes are drawn within rooms; where plumes are too
    few as well, flights are drawn within cases.

    Args:
        rooms: (n,) room of each flight.
        plumes: (n,) gas of each flight; equal labels in two rooms are two plumes.
        cases: (n,) case of each flight.

    Source:
        Rao and Wu 1988, doi:10.1080/01621459.1988.10478591: in the bootstrap of several stages a lower stage counts
        with the fraction of the population that was sampled above it, here 0 (rooms like these) or 1 (these rooms).
    Held by:
        extensions/bench/tests/unit/statistics/test_sampling_units.py
    """
    room, plume, case = (np.asarray(labels) for labels in (rooms, plumes, cases))
    check_same_length(rooms=room, plumes=plume, cases=case)
    if not len(room):
        nothing = np.zeros(0, dtype=np.int64)
        return SamplingUnits(level="flights", unit=nothing, stratum=None, case=nothing, n_rooms=0, n_plumes=0)
    room, case = encode_labels(room), encode_labels(case)
    plume = encode_labels(room * (int(encode_labels(plume).max()) + 1) + encode_labels(plume))
    n_rooms, n_plumes = int(room.max()) + 1, int(plume.max()) + 1
    flights = np.arange(len(room))
    levels: list[tuple[Level, NDArray[np.int64], list[NDArray[np.int64]]]] = [
        ("rooms", room, []),
        ("plumes", plume, [room]),
        ("flights", flights, [case, plume, room]),
    ]
    for level, unit, candidates in levels:
        stratum = next((labels for labels in candidates if _has_two_units(labels, unit)), None)
        units = SamplingUnits(level=level, unit=unit, stratum=stratum, case=case, n_rooms=n_rooms, n_plumes=n_plumes)
        if level == "flights" or units.freedom >= MIN_FREEDOM:
            return units
    raise AssertionError("flights are always found")


# A stratum of one unit shows no spread: then a coarser one is taken.
def _has_two_units(stratum: NDArray[np.int64], unit: NDArray[np.int64]) -> bool:
    pairs = np.unique(np.stack([stratum, unit], axis=1), axis=0)
    of_unit = np.bincount(pairs[:, 1])
    return int(np.bincount(pairs[:, 0]).min()) > 1 and int(of_unit.max()) == 1


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearisedMeans:
    """Weighted means of columns, and what each unit adds to their error.

    Attributes:
        value: (m,) means.
        total: (n_units, m) weighted sum of a unit's values; they add up to the mean.
        share: (n_units, m) weight of a unit; they add up to 1.
        residual: (n_units, m) the same less what is expected of its stratum; the root of the sum of squares is the
            standard error.
        n: (m,) flights with a value.
    """

    value: NDArray[np.float64]
    total: NDArray[np.float64]
    share: NDArray[np.float64]
    residual: NDArray[np.float64]
    n: NDArray[np.int64]

    @property
    def standard_error(self) -> NDArray[np.float64]:
        """(m,) standard errors, at least what one flight with another result would make: 1 / n."""
        spread = np.sqrt((self.residual**2).sum(axis=0))
        return np.maximum(spread, self.least_error)

    @property
    def least_error(self) -> NDArray[np.float64]:
        """(m,) what one flight with another result would make."""
        return 1.0 / np.maximum(self.n, 1)


def compute_means(
    values: NDArray[np.float64], units: SamplingUnits, cases: NDArray[np.int64] | None
) -> LinearisedMeans:
    """Return the mean of each column over cases of the mean of a case, and the spread of units.

    theta = sum w y        w = 1 / (cases x flights of the case)
    e_u = sqrt(k / (k - 1)) sum over flights of u of w (y - theta_h)        k units in stratum h, theta_h its mean
    variance of theta = sum e_u^2

    Args:
        values: (n, m) a row per flight; nan where there is none.
        cases: (n,) case of each flight, 0 on; None: each flight counts the same.

    Source:
        Linearised variance of a ratio of totals: Cochran 1977, Sampling Techniques, sections 5A.15 and 6.13.
    """
    known = ~np.isnan(values)
    filled = np.where(known, values, 0.0)
    case = np.zeros(len(values), dtype=np.int64) if cases is None else np.asarray(cases, dtype=np.int64)
    # One column of weights serves all where nothing is missing.
    mask = known[:, :1] if known.all() else known
    of_case = _sum_by(case, mask.astype(np.float64))
    n_cases = np.maximum((of_case > 0).sum(axis=0), 1)
    weight = mask / (np.maximum(of_case, 1.0)[case] * n_cases)
    total = _sum_by(units.unit, weight * filled, units.n)
    share = np.broadcast_to(_sum_by(units.unit, weight, units.n), total.shape)
    stratum = units.stratum_of_unit
    share_of_stratum = _sum_by(stratum, share)
    mean = _sum_by(stratum, total) / np.where(share_of_stratum > 0.0, share_of_stratum, 1.0)
    k = _sum_by(stratum, (share > 0.0).astype(np.float64))
    scale = np.sqrt(k / np.maximum(k - 1.0, 1.0))
    residual = scale[stratum] * (total - mean[stratum] * share)
    n = known.sum(axis=0)
    value = np.where(n > 0, total.sum(axis=0), np.nan)
    return LinearisedMeans(value=value, total=total, share=share, residual=residual, n=n)


def _sum_by(code: NDArray[np.int64], values: NDArray[np.float64], n_codes: int | None = None) -> NDArray[np.float64]:
    n = n_codes if n_codes is not None else int(code.max(initial=-1)) + 1
    sums = np.zeros((n, values.shape[1]))
    np.add.at(sums, code, values)
    return sums
