"""Where to explore: the place at which a reading would tell the most of the source, for the way there.

Held by:
    extensions/search/tests/unit/motion/test_exploration.py
"""

import itertools
from collections.abc import Sequence

import numpy as np

from gslcosim_search.elementary import distance
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.posterior.source_posterior import SourcePosterior

# Places are this far apart [m], and not nearer or farther than this.
_SPACING_M, _NEAREST_M, _FARTHEST_M = 2.0, 0.7, 8.0
# What a reading costs beside the way, as a way [m], and the longest leg [m], after which it is asked again.
_COST_M, _STEP_M = 2.0, 2.0


def exploration_leg_end_m(
    posterior: SourcePosterior, time_s: float, here_m: Sequence[float], room: LegSpace
) -> tuple[float, float] | None:
    """Return the end of the next leg towards the place of the greatest information for its way, world frame [m].

    argmax of I(x) / (|x - here| + d)        over places x of the search height, d the cost of a reading as a way

    It is absent while the wind is not known, and where no place would tell anything.

    Args:
        here_m: Where the vehicle is, three coordinates, world frame [m].
        room: Where legs may end.

    Source:
        Information over cost is ours; it is the greedy rule of informative path planning for a budget.
    """
    if not posterior.air.is_known:
        return None
    columns_m, rows_m = (_middles(low, high) for low, high in list(zip(room.min_m, room.max_m))[:2])
    places_m = [
        (x_m, y_m, here_m[2])
        for x_m, y_m in itertools.product(columns_m, rows_m)
        if _NEAREST_M < distance((x_m, y_m), here_m[:2]) < _FARTHEST_M
    ]
    if not places_m:
        return None
    ways_m = [distance(place_m[:2], here_m[:2]) for place_m in places_m]
    gains = posterior.information_nats(time_s, places_m) / (np.array(ways_m) + _COST_M)
    best = int(gains.argmax())
    if not gains[best] > 0.0:
        return None
    share = min(1.0, _STEP_M / ways_m[best])
    x_m, y_m = (here + share * (there - here) for here, there in zip(here_m[:2], places_m[best][:2]))
    return x_m, y_m


def _middles(low_m: float, high_m: float) -> list[float]:
    n = max(1, round((high_m - low_m) / _SPACING_M))
    return [low_m + (i + 0.5) * (high_m - low_m) / n for i in range(n)]
