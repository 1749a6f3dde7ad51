"""Declaration at the time limit: one rule for every method that keeps a belief.

Held by:
    extensions/search/tests/unit/motion/test_deadline.py
"""

from types import SimpleNamespace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Briefing, Observation
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion.declaration import LATE_SHARE, PEAK_FACTOR, Estimate, by_mass
from gslcosim_search.senses.hit_detection import GasHits, GasLevel
from gslcosim_search.senses.instruments import Nose, find_noses

# The least probability that is worth a declaration.
LEAST_PROBABILITY = 0.1


class DeadlineRule:
    """Declares a belief's own estimate when time runs out, or stays silent, by that belief.

    1. nine tenths of the time limit are over
    2. gas was met: a hit whose level was above five thresholds (`GasLevel`); without gas a belief is what is left of
       the room, and no place of a source
    3. the ball of the success radius that holds the most of the belief holds more than a tenth of it

    A method's own rule waits for the second condition, too: `has_met_gas`.

    The estimate is the mean place inside that ball: where a declaration most probably succeeds, if the belief is
    right. Its confidence is the probability of the ball.

    State: the greatest level of gas, the cleanest air, and the rule of the hits.

    Source:
        The place is Bayes' rule for a loss of 0 within the radius and 1 beyond it (Berger 1985, Statistical Decision
        Theory and Bayesian Analysis, section 2.4). Nine tenths and five thresholds are those of the rule for methods
        without a belief (`declaration.MissionDeclarer`); a tenth is ours, one number for all methods.
    """

    def __init__(self, nose: Nose, *, time_limit_s: float, radius_m: float = 1.0) -> None:
        """Begin without gas; `radius_m` is the distance to the source that counts as success [m]."""
        self._nose, self._level, self._hits = nose, GasLevel(nose), GasHits(nose)
        self._late_s, self._radius_m = LATE_SHARE * time_limit_s, radius_m
        self._most = 0.0

    @classmethod
    def for_mission(cls, briefing: Briefing, settings: SimpleNamespace) -> Self | None:
        """Return the rule where `deadline: by_mission` is set and the mission asks for a declaration, else None."""
        task, noses = briefing.task, find_noses(briefing)
        if getattr(settings, "deadline", "never") != "by_mission" or not noses:
            return None
        if task is None or not task.asks_for_declaration:
            return None
        return cls(noses[0], time_limit_s=briefing.time_limit_s, radius_m=task.success_radius_m)

    def add(self, observation: Observation) -> None:
        """Take note of an observation, from `Agent.observe`."""
        if not self._nose.is_ready(observation):
            return
        level, is_hit = self._level.of(self._nose.value(observation)), self._hits.add(observation)
        if is_hit:
            self._most = max(self._most, level)

    @property
    def has_met_gas(self) -> bool:
        """True once there was gas well above what clean air shows."""
        return self._most > PEAK_FACTOR * self._level.threshold

    def estimate(self, time_s: float, p: NDArray[np.float64], grid: CellGrid) -> Estimate | None:
        """Return the estimate of a belief if it is to be declared now.

        Args:
            p: The belief, of the grid's shape, sum 1.
        """
        if time_s < self._late_s or not self.has_met_gas:
            return None
        return by_mass(p, grid, radius_m=self._radius_m, least=LEAST_PROBABILITY)
