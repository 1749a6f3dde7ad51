"""Products of rows of numbers with the weights of a network."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary

Floats = NDArray[np.floating[Any]]


def multiply(rows: Floats, weights: Floats) -> Floats:
    """Return (n, k) rows times (k, m) weights as float32, (n, m).

    A single row is that of a vehicle in flight: its sums have a fixed order, so that it acts alike on every processor.
    More rows are those of training, which BLAS multiplies faster.
    """
    return elementary.product(rows, weights).astype(np.float32) if len(rows) == 1 else rows @ weights
