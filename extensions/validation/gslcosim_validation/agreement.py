"""Measures of agreement between predicted and measured concentrations, with bootstrap intervals over blocks."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import Estimate, bootstrap

Floats = NDArray[np.float64]


def factor_of_two_share(predicted: Floats, measured: Floats, *, floor: float = 0.0) -> Floats:
    """Return FAC2, the share of pairs with 0.5 <= P / O <= 2, along the last axis.

    Args:
        predicted: (..., n) P, at least 0.
        measured: (..., n) O in the same unit; a value below the floor counts as the floor.
        floor: Detection limit; both sides are raised to it, so that two values below it agree.

    Source:
        Chang and Hanna 2004, Air quality model performance evaluation, Meteorol. Atmos. Phys. 87.
    """
    p, o = np.maximum(predicted, floor), np.maximum(measured, floor)
    return ((p >= 0.5 * o) & (p <= 2.0 * o)).mean(axis=-1)


def fractional_bias(predicted: Floats, measured: Floats) -> Floats:
    """Return FB = 2 (<O> - <P>) / (<O> + <P>) along the last axis; above 0 the model predicts too little.

    Source:
        Chang and Hanna 2004.
    """
    p, o = predicted.mean(axis=-1), measured.mean(axis=-1)
    return 2.0 * (o - p) / (o + p)


def normalised_mean_square_error(predicted: Floats, measured: Floats) -> Floats:
    """Return NMSE = <(O - P)^2> / (<O> <P>) along the last axis.

    Source:
        Chang and Hanna 2004.
    """
    return ((measured - predicted) ** 2).mean(axis=-1) / (measured.mean(axis=-1) * predicted.mean(axis=-1))


def agreement_estimate(
    measure: Callable[[Floats, Floats], Floats], predicted: Floats, measured: Floats, blocks: NDArray
) -> Estimate:
    """Return a measure of agreement with its bootstrap interval.

    Args:
        measure: From (d, n) predicted and measured values to the (d,) measure.
        predicted: (n,) P.
        measured: (n,) O.
        blocks: (n,) labels; pairs of a block (a quarter of an hour, a release) are drawn together, as they share
            their weather.
    """
    if not (predicted.shape == measured.shape == blocks.shape and predicted.ndim == 1):
        raise ShapeError(f"expected three rows of one length, had {predicted.shape}, {measured.shape}, {blocks.shape}.")
    if not (np.isfinite(predicted).all() and np.isfinite(measured).all()):
        raise ShapeError("expected finite numbers, some are not. Leave these pairs out.")
    is_several = len(np.unique(blocks)) > 1
    return bootstrap(
        len(predicted),
        lambda rows: np.asarray(measure(predicted[rows], measured[rows])),
        clusters=blocks if is_several else None,
    )
