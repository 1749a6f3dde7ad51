"""Pairs of modelled and measured values at the instruments of a release, as cases store them."""

from collections.abc import Iterator
from typing import Literal, NotRequired, TypedDict

import numpy as np
from numpy.typing import NDArray

from gslcosim_validation.air_kinds import AirKind

Floats = NDArray[np.float64]
Quantity = Literal["mean", "intensity"]

LEAST_ROWS = 10
"""Readings of an instrument in a release, below which it has neither mean nor intensity: ten minutes in most logs."""
_DIGITS = 5


class ReleasePairs(TypedDict):
    """One release: a quantity at k instruments, modelled and measured, both above 0.

    `quantity`: `mean`, the mean concentration above background over the release, in the set's unit; or `intensity`,
    the standard deviation of concentration over its mean. `measured_set` is the name of the set, which `Case.run` adds.
    """

    kind_of_air: AirKind
    release: str
    quantity: Quantity
    modelled: list[float]
    measured: list[float]
    measured_set: NotRequired[str]


def build_pairs(
    kind_of_air: AirKind, release: str, quantity: Quantity, modelled: Floats, measured: Floats
) -> Iterator[ReleasePairs]:
    """Yield the pairs of a release, or nothing where no instrument has both values.

    Args:
        kind_of_air: Of the set.
        release: Its name in the set.
        quantity: What the values are.
        modelled: (k,) at the instruments.
        measured: (k,) at the same; pairs with nan or without a value above 0 on either side are left out.
    """
    with np.errstate(invalid="ignore"):
        is_kept = np.isfinite(modelled) & np.isfinite(measured) & (modelled > 0.0) & (measured > 0.0)
    if is_kept.any():
        ours, theirs = ([float(f"{x:.{_DIGITS}g}") for x in values[is_kept]] for values in (modelled, measured))
        yield ReleasePairs(kind_of_air=kind_of_air, release=release, quantity=quantity, modelled=ours, measured=theirs)


def pair_series(
    kind_of_air: AirKind, modelled: Floats, measured: Floats, release: NDArray, *, floor: float
) -> Iterator[ReleasePairs]:
    """Yield means and intensities of series above background, for each release.

    Both sides of a mean are raised to the floor, and pairs of which neither side exceeds it are left out, as for FAC2
    (Chang and Hanna 2004); intensities are those of instruments whose means exceed it on both sides.

    Args:
        kind_of_air: Of the set.
        modelled: (n, k) at k instruments.
        measured: (n, k) above background, nan where an instrument has no reading.
        release: (n,) labels of the releases.
        floor: Least concentration that counts, in the unit of the series.
    """
    for label in dict.fromkeys(release.tolist()):
        rows = release == label
        is_known = np.isfinite(measured[rows]) & np.isfinite(modelled[rows])
        ours, theirs = (np.where(is_known, values[rows], np.nan) for values in (modelled, measured))
        enough = is_known.sum(axis=0) >= LEAST_ROWS
        ours, theirs = (values[:, enough] for values in (ours, theirs))
        p, o = (np.nanmean(values, axis=0) for values in (ours, theirs))
        is_seen, is_clear = np.maximum(p, o) > floor, np.minimum(p, o) > floor
        raised = (np.maximum(values[is_seen], floor) for values in (p, o))
        yield from build_pairs(kind_of_air, str(label), "mean", *raised)
        shares = (np.nanstd(values[:, is_clear], axis=0) / mean[is_clear] for values, mean in ((ours, p), (theirs, o)))
        yield from build_pairs(kind_of_air, str(label), "intensity", *shares)
