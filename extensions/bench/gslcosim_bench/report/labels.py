"""Success by the labels of cases, beside that in the core: it tells which change of one axis breaks a method."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gslcosim.base.untrusted_input import JsonObject, parse_json
from gslcosim_bench.cases.models import LABELS, select_labels
from gslcosim_bench.report.leaderboard import sampling_units
from gslcosim_bench.report.report_data import Flags, ReportData, TrialRows
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate
from gslcosim_bench.statistics.rates import rate_over_units, subtract_rates


@dataclass(frozen=True, kw_only=True)
class LevelSuccess:
    """An entry's success at a level of an axis, over runs with gas.

    Attributes:
        entry: Index of the entry.
        is_core: Whether the core has this level.
        success: Over all cases with the level.
        alone: Success over the cases that differ from the core in this axis alone; of the core's level, over the core.
        approach: Share of the runs of `alone` that came within 1 m of a source at any time, whatever the criterion.
        difference: Alone less the core, each with runs of its own, over whole rooms or plumes; undefined for the core
            and where no case is alone. It is not corrected for the number of levels.
    """

    axis: str
    level: str
    entry: int
    is_core: bool
    success: Estimate
    alone: Estimate
    approach: Estimate
    difference: Estimate


def compare_levels(material: ReportData) -> tuple[LevelSuccess, ...]:
    """Return the success of each entry at each level of the labelled axes: none where a suite labels nothing.

    The core has the level of each axis that most cases have.
    """
    rows = material.rows
    levels = _levels_by_axis(rows)
    if not levels or not any(len(set(found)) > 1 for found in levels.values()):
        return ()
    core = {axis: _most_common(rows, found) for axis, found in levels.items()}
    is_apart = {axis: np.array([level != core[axis] for level in found]) for axis, found in levels.items()}
    n_apart = np.sum(list(is_apart.values()), axis=0)
    found: list[LevelSuccess] = []
    for axis, of_rows in levels.items():
        for level in dict.fromkeys((core[axis], *of_rows)):
            here = np.array([each == level for each in of_rows])
            alone = here & (n_apart == (level != core[axis]))
            for entry in range(len(material.entries)):
                own = ~rows.is_control & (rows.entry == entry)
                if (own & here).any():
                    found.append(
                        _level_success(rows, axis, level, entry, own & here, own & alone, own & (n_apart == 0))
                    )
    return tuple(found)


def _level_success(
    rows: TrialRows, axis: str, level: str, entry: int, here: Flags, alone: Flags, core: Flags
) -> LevelSuccess:
    success = rows["success"]
    is_core = bool((alone & core).any())
    return LevelSuccess(
        axis=axis,
        level=level,
        entry=entry,
        is_core=is_core,
        success=_rate(rows, success, here),
        alone=_rate(rows, success, alone),
        approach=_rate(rows, np.isfinite(rows["time_within_1_m_s"]), alone),
        difference=_difference(rows, alone, core) if alone.any() and core.any() and not is_core else UNDEFINED,
    )


def _difference(rows: TrialRows, alone: Flags, core: Flags) -> Estimate:
    return subtract_rates(_rate(rows, rows["success"], alone), _rate(rows, rows["success"], core))


def _rate(rows: TrialRows, holds: Flags, within: Flags) -> Estimate:
    return rate_over_units(holds[within], sampling_units(rows, np.flatnonzero(within)))


# The level of each row by axis; empty where a case has no such label.
def _levels_by_axis(rows: TrialRows) -> Mapping[str, list[str]]:
    texts = rows["varied"].tolist()
    labels = {
        text: {
            path.removeprefix(LABELS): str(level)
            for path, level in select_labels(parse_json(text or "{}", JsonObject, place="trials: varied")).items()
        }
        for text in set(texts)
    }
    axes = dict.fromkeys(axis for text in texts for axis in labels[text])
    return {axis: [labels[text].get(axis, "") for text in texts] for axis in axes}


def _most_common(rows: TrialRows, levels: list[str]) -> str:
    of_case = dict(zip(rows["case"].tolist(), levels, strict=True))
    return Counter(of_case.values()).most_common(1)[0][0]
