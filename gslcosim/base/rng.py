"""Named random streams: every draw of a run comes from one seed and a name."""

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of one purpose, independent of all others and of their order of use.

    Args:
        seed: The scenario's seed, >= 0.
        name: `participant.purpose`, for example `fields.release`.
    """
    return np.random.default_rng([seed, *name.encode()])
