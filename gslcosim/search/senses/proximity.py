"""Proximity index of a source by the gas of one stop: its mean, and its peaks."""

from collections.abc import Sequence


def local_maxima(samples: Sequence[float]) -> list[float]:
    """Return the peaks of a series: samples above the one before and not below the one after; the ends are none.

    A plateau counts once.
    """
    return [b for a, b, c in zip(samples, samples[1:], samples[2:]) if b > a and b >= c]


def proximity_index(
    samples: Sequence[float], interval_s: float, *, mean_weight: float = 0.5, peak_weight: float = 1.0
) -> float:
    """Return how near a source seems: the more gas on average, and the more and the higher peaks, the nearer.

    PI = K_mu mean(c) + K_p dt sum of local maxima of c        c samples of one stop, dt time between them [s]
    [ppm] = [1] [ppm] + [1/s] [s] [ppm]

    Peaks matter because in still air a plume is a train of bursts that blur with the distance.

    Args:
        samples: Gas of one stop, in any unit that grows with it; without samples the index is 0.
        interval_s: Time between them [s].
        mean_weight: K_mu.
        peak_weight: K_p [1/s].

    Source:
        Ferri, Caselli, Mattoli, Mondini, Mazzolai, Dario 2009, Robotics and Autonomous Systems 57, 393-402; weights
        as read in the MAPIR group's code.
    Held by:
        tests/unit/search/senses/test_proximity.py
    """
    if not samples:
        return 0.0
    mean = sum(samples) / len(samples)
    return mean_weight * mean + peak_weight * interval_s * sum(local_maxima(samples))


class BestProximity:
    """The best index so far, which is halved when nothing comes near to it for too long.

    better: PI > best, which makes it the best; after more than `n_misses` that are not better, best <- best / 2

    Source:
        Ferri et al. 2009; 3 misses as read in the MAPIR group's code.
    Held by:
        tests/unit/search/senses/test_proximity.py
    """

    def __init__(self, *, n_misses: int = 3) -> None:
        """Begin with a best of 0."""
        self.best = 0.0
        self._n_allowed = n_misses
        self._n_misses = 0

    def is_better(self, index: float) -> bool:
        """Take note of the index of a stop; return whether it is better than the best before."""
        if index > self.best:
            self.best, self._n_misses = index, 0
            return True
        self._n_misses += 1
        if self._n_misses > self._n_allowed:
            self.best, self._n_misses = self.best / 2.0, 0
        return False
