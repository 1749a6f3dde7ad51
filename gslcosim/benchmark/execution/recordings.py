"""Which flights are worth a recording."""

import math
from collections.abc import Mapping, Sequence

from gslcosim.benchmark.execution.judging import FLOWN, Row
from gslcosim.benchmark.suite.trials import Trial


def kept_trials(trials: Sequence[Trial], rows: Mapping[str, Row], keep: Sequence[str]) -> list[Trial]:
    """Return the trials of each entry that a suite keeps recordings of, in the order of the suite.

    `first_failure` is its first flight without success, `slowest` its slowest success, `median` the one in the middle
    of its successes by time. Controls and flights without result are left out.

    Args:
        trials: All that were flown.
        rows: Their rows by id.
        keep: Words of `record.keep`.
    """
    chosen: set[str] = set()
    for entry in dict.fromkeys(trial.entry for trial in trials):
        flown = [t for t in trials if t.entry == entry and not t.is_control and rows[t.id]["status"] == FLOWN]
        failed = [t for t in flown if not rows[t.id]["success"]]
        found = sorted((t for t in flown if rows[t.id]["success"]), key=lambda t: (rows[t.id]["time_s"], t.index))
        if "first_failure" in keep and failed:
            chosen.add(failed[0].id)
        if "slowest" in keep and found:
            chosen.add(found[-1].id)
        if "median" in keep and found:
            chosen.add(found[math.ceil(len(found) / 2) - 1].id)
    return [trial for trial in trials if trial.id in chosen]
