"""Validity in the report: which criteria need no olfaction, and what many runs warn of."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from gslcosim_bench.report.analysis import Analysis, ReportView
from gslcosim_bench.report.leaderboard import compare_within
from gslcosim_bench.report.null_differences import find_nulls
from gslcosim_bench.statistics.estimates import Estimate

# What is blind finds the source in at least so many runs where that tells something of the criterion; chosen.
MIN_BLIND_SUCCESS = 0.5
# Kinds of warnings that are listed; the rows have all of them.
_MAX_LISTED = 4


def describe_validity(analysis: Analysis) -> list[str]:
    """Return sentences on what the figures of a report are worth, none where nothing speaks against them."""
    names = [entry.name for entry in analysis.material.entries]
    # A null may read a nose that its method does without: it says nothing of the need for one.
    nulls = find_nulls(analysis.material)
    blind = [i for i, entry in enumerate(analysis.material.entries) if entry.is_blind and i not in nulls]
    anchors = {i for i, entry in enumerate(analysis.material.entries) if entry.anchor == "lower"} | {*nulls}
    found: list[str] = []
    for view in [view for view in analysis.views if len(view.scenarios) == 1] or [analysis.everything]:
        rates = {row.entry: row.success for row in view.standings}
        seeing = [entry for entry in rates if entry not in anchors and entry not in blind]
        rivals = [entry for entry in blind if entry in rates and rates[entry].value >= MIN_BLIND_SUCCESS]
        if not seeing or not rivals:
            continue
        best, rival = (max(some, key=lambda entry: rates[entry].value) for some in (seeing, rivals))
        gain = _gain(analysis, view, best, rival)
        if gain is None or not gain.high < analysis.material.smallest_difference:
            continue
        found.append(
            f"No olfaction is needed in {view.label}: {names[rival]}, which is blind, finds the source in "
            f"{_percent(rates[rival])} of the runs, and {names[best]}, the best of the others, in "
            f"{_percent(rates[best])}: at least as often, to the smallest difference that matters. Take "
            "a smaller success radius, a shorter time limit or a larger room, or let methods declare the source."
        )
    return [*found, *_describe_warnings(analysis)]


# Of the best over the blind one, of these two alone: views of many entries have no pairs.
def _gain(analysis: Analysis, view: ReportView, best: int, blind: int) -> Estimate | None:
    rows = analysis.material.rows
    within = np.isin(rows["scenario"], view.scenarios)
    for pair in compare_within(rows, within, [best, blind]).pairs:
        return pair.differences["success"]
    return None


def _percent(rate: Estimate) -> str:
    return f"{100 * rate.value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]"


# A run that found no gas where none was has nothing to be warned of.
def _describe_warnings(analysis: Analysis) -> list[str]:
    rows = analysis.material.rows
    flown = np.flatnonzero(~rows.is_control)
    warned = [text for text in rows["warnings"][flown].tolist() if text]
    if not warned:
        return []
    kinds = Counter(line.partition(":")[0] for text in warned for line in text.splitlines())
    listed = ", ".join(f"{kind} in {n}" for kind, n in kinds.most_common(_MAX_LISTED))
    return [
        f"{len(warned)} of {len(flown)} runs with gas are valid with warnings ({listed}); column warnings has them. "
        f"The first: {_first_line(warned)}"
    ]


def _first_line(texts: Sequence[str]) -> str:
    about, _, text = texts[0].splitlines()[0].partition(": ")
    return f"{about}: {text}"
