"""Intervals for the error of modelled gas in a further measured set, and their coverage on sets that are held out.

The error of a release is the geometric mean, over its instruments, of modelled over measured values (MG of Chang and
Hanna 2004, inverted). Releases of a set share site, instruments and wind, so sets scatter beside the releases within
them, and each set counts the same. `predict_ratio` is the interval for a release of a set that is not among those
given; `hold_out` tells, set by set, how many of its releases lie in what the others predict.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_bench.statistics.estimates import student_quantile
from gslcosim_validation.agreement import factor_of_two_share
from gslcosim_validation.air_kinds import AIR_KINDS, AirKind
from gslcosim_validation.expected_errors import QUANTITIES, RatioInterval
from gslcosim_validation.release_pairs import Quantity, ReleasePairs

Floats = NDArray[np.float64]

LEVEL = 0.9
"""Of the intervals."""
LEAST_SETS = 3
"""Of a kind of air, for an interval of its own; chosen: from two sets, whose scatter has one degree of freedom, an
interval reaches 6.3 deviations to each side."""
_LEAST_TOGETHER = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class SetErrors:
    """Errors of one quantity in one set.

    Attributes:
        name: Of the set.
        kind_of_air: Its kind of air.
        log_ratios: (n,) natural logarithm of modelled over measured, mean over the instruments of each release.
        fac2: Share of the pairs within a factor of two.
    """

    name: str
    kind_of_air: AirKind
    log_ratios: Floats
    fac2: float


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """A set beside the interval that the other sets predict: how many of its n releases lie within."""

    name: str
    quantity: Quantity
    n_within: int
    n: int
    interval: RatioInterval

    @property
    def share_within(self) -> float:
        """Share of its releases that lie within."""
        return self.n_within / self.n


def collect_set_errors(pairs: Sequence[ReleasePairs], quantity: Quantity) -> list[SetErrors]:
    """Return the errors of a quantity by set, in the order of the sets' names."""
    chosen = [each for each in pairs if each["quantity"] == quantity]
    found: list[SetErrors] = []
    for name in sorted({each.get("measured_set", "") for each in chosen}):
        own = [each for each in chosen if each.get("measured_set", "") == name]
        modelled, measured = ([np.array(each[side]) for each in own] for side in ("modelled", "measured"))
        found.append(
            SetErrors(
                name=name,
                kind_of_air=own[0]["kind_of_air"],
                log_ratios=np.array([np.log(p / o).mean() for p, o in zip(modelled, measured, strict=True)]),
                fac2=float(factor_of_two_share(np.concatenate(modelled), np.concatenate(measured))),
            )
        )
    return found


def predict_log_ratio(sets: Sequence[Floats]) -> tuple[float, float, float]:
    """Return middle and ends of the interval for the log ratio of one release of a further set.

    y_ij = mu + b_i + e_ij,  b_i ~ (0, t^2),  e_ij ~ (0, s^2)
    interval = m -+ t_f sqrt(t^2 + B / k + s^2)

    m is the mean of the means of the k sets, B the variance of these means, s^2 the mean of the variances within sets,
    t^2 = max(0, B - s^2 mean(1 / n_i)). The degrees of freedom f of Student's t are Satterthwaite's.

    Args:
        sets: Log ratios of each set, (n_i,) each; two at least.

    Source:
        Satterthwaite 1946, Biometrics Bulletin 2, 110, for the degrees of freedom of a sum of mean squares; the
        random-effects model of one way as every textbook.
    Held by:
        extensions/validation/tests/unit/test_held_out_errors.py
    """
    k = len(sets)
    means = np.array([each.mean() for each in sets])
    between = float(means.var(ddof=1))
    # Sets of one release say nothing of the scatter within.
    several = [each for each in sets if len(each) > 1]
    inner = [(float(each.var(ddof=1)) / len(several), len(each) - 1) for each in several]
    within = sum(square for square, _ in inner)
    inverse = float(np.mean([1.0 / len(each) for each in sets]))
    is_scattered = between > within * inverse
    terms = [(between * (1.0 + 1.0 / k if is_scattered else 1.0 / k), k - 1)]
    terms += [(square * (1.0 - inverse if is_scattered else 1.0), freedom) for square, freedom in inner]
    variance = sum(square for square, _ in terms)
    middle = float(means.mean())
    if not variance > 0.0:
        return middle, middle, middle
    freedom = variance**2 / sum(square**2 / each for square, each in terms)
    half = student_quantile(0.5 + LEVEL / 2.0, freedom) * math.sqrt(variance)
    return middle, middle - half, middle + half


def predict_ratio(sets: Sequence[SetErrors], kind_of_air: AirKind) -> RatioInterval | None:
    """Return the interval for a release of a further set of a kind of air, that of all kinds where its own has too few.

    None from one set, and from none.
    """
    own = [each for each in sets if each.kind_of_air == kind_of_air]
    used = own if len(own) >= LEAST_SETS else sets
    if len(used) < _LEAST_TOGETHER:
        return None
    middle, low, high = np.exp(predict_log_ratio([each.log_ratios for each in used])).tolist()
    counts = {each.name: len(each.log_ratios) for each in used}
    return RatioInterval(ratio=middle, low=low, high=high, sets=counts, of_all_kinds=used is sets)


def hold_out(pairs: Sequence[ReleasePairs]) -> Iterator[HeldOut]:
    """Yield each set and quantity beside the interval that the other sets predict for it."""
    for quantity in QUANTITIES:
        sets = collect_set_errors(pairs, quantity)
        for own in sets:
            interval = predict_ratio([each for each in sets if each is not own], own.kind_of_air)
            if interval is not None:
                low, high = math.log(interval["low"]), math.log(interval["high"])
                is_within = (own.log_ratios >= low) & (own.log_ratios <= high)
                yield HeldOut(
                    name=own.name,
                    quantity=quantity,
                    n_within=int(is_within.sum()),
                    n=len(is_within),
                    interval=interval,
                )


def compute_expected_errors(pairs: Sequence[ReleasePairs]) -> dict[AirKind, dict[Quantity, RatioInterval]]:
    """Return for each kind of air what a run of it may be wrong by, from all sets; empty from too few."""
    errors: Mapping[Quantity, list[SetErrors]] = {each: collect_set_errors(pairs, each) for each in QUANTITIES}
    found: dict[AirKind, dict[Quantity, RatioInterval]] = {}
    for kind in AIR_KINDS:
        for quantity, sets in errors.items():
            interval = predict_ratio(sets, kind)
            if interval is None:
                continue
            if quantity == "mean":
                interval["fac2"] = float(np.mean([each.fac2 for each in sets if each.name in interval["sets"]]))
            found.setdefault(kind, {})[quantity] = interval
    return found
