"""Output and shared options of `gslcosim bench sweep` and `gslcosim bench tune`."""

import argparse
import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.cli.terminal import table
from gslcosim_bench.commands.workers import add_worker_arguments, add_yes_option

if TYPE_CHECKING:
    from gslcosim_bench.statistics.estimates import Estimate
    from gslcosim_bench.statistics.settings import SettingFigures
    from gslcosim_bench.studies.sweep import SweepResult
    from gslcosim_bench.studies.tuning import EvaluatedSetting, TuningProgress, TuningResult

RESULTS_DIR = Path("results")
_BEST_SHOWN = 5
# Bootstrap intervals of the mean of fewer runs than this cover clearly less than they say.
_FEW = 10


def add_target_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is run by whom, and where it is kept."""
    parser.add_argument("suite", metavar="SUITE", help="a suite or a scenario: a file, or the name of a bundled one")
    parser.add_argument(
        "--entry", required=True, metavar="NAME", help="method: an entry of the suite, a bundled one, or a .py file"
    )
    add_worker_arguments(parser)
    parser.add_argument("--results", type=Path, metavar="DIR", help="results folder (default: below results/)")
    add_yes_option(parser)


def format_stage(stage: "TuningProgress") -> str:
    """Return the state of a search in one line."""
    best = stage.best
    return (
        f"{stage.n_settings} of {stage.most_settings} settings, {stage.n_flights} of {stage.budget} flights; best "
        f"so far {best.setting.name} with score {format_estimate(best.figures.score, 2)}"
        f"{_values_text(best.setting.parameters)}"
    )


def format_sweep(sweep: "SweepResult", folder: Path, page: Path | None) -> str:
    """Return a sweep as a table, and where its files and its report are."""
    names = list(sweep.varied)
    heads = [*(name.upper() for name in names), "N", "SUCCESS %", "MEAN SCORE", "MEAN TIME s", "SCORE DIFFERENCE"]
    rows = [
        [
            *(_value(point.setting.parameters[name]) for name in names),
            *_figure_words(point.figures),
            "reference" if point.difference is None else format_estimate(point.difference, 2, sign=True),
        ]
        for point in sweep.points
    ]
    reference = "the default" if sweep.is_reference_default else "the first setting"
    n_lost = sum(point.figures.n_without_result for point in sweep.points)
    lines = [
        f"{sweep.entry} in {sweep.suite}, 95 % intervals; time: failures count the limit; difference: paired, from "
        f"{reference}",
        table(heads, rows),
    ]
    if n_lost:
        lines.append(f"{n_lost} flights without result count as failures: see status and fault in the rows.")
    if sweep.points[0].figures.n < _FEW:
        lines.append(
            f"Intervals of scores from fewer than {_FEW} flights are too narrow; more --repetitions mend that."
        )
    report = page or f"gslcosim bench report {shlex.quote(str(folder))}"
    return "\n".join([*lines, f"Results: {folder} (sweep.csv, sweep.json)", f"Report: {report}"])


def format_tuning(tuning: "TuningResult", folder: Path, pages: Sequence[Path], parameters: str) -> str:
    """Return the result of a tuning as text.

    Args:
        pages: Reports of training and, where there was one, of validation.
    """
    budget = tuning.budget
    n_used = tuning.n_search + tuning.n_validation
    n_same = tuning.n_asked - (len(tuning.tried) - 1)
    lines = [
        f"Budget: {budget.flights} flights, used {n_used}: {len(tuning.tried)} settings of {budget.per_setting} in "
        f"training, "
        + (
            f"2 of {budget.per_validation} in validation."
            if tuning.validation is not None
            else "none in validation, for the best is the default."
        )
    ]
    if n_same:
        lines.append(f"{n_same} settings were asked for that had been flown already; they cost nothing.")
    if n_lost := sum(tried.figures.n_without_result for tried in tuning.tried):
        lines.append(f"{n_lost} flights without result count as failures: see status and fault in the rows.")
    if tuning.n_flown_before:
        lines.append(f"{tuning.n_flown_before} of these flights were there already.")
    return "\n".join(
        [
            f"{tuning.entry} in {tuning.suite}; searched: {', '.join(str(each) for each in tuning.ranges)}",
            *lines,
            f"Seeds: training {tuning.training_seed}"
            + (f", validation {tuning.validation.seed}" if tuning.validation is not None else "")
            + "; no seed of a run, its gas or a drawn room is one of this suite's or of a bundled suite's.",
            _tried_table(tuning),
            *_verdict_lines(tuning),
            f"parameters: {parameters}" if tuning.validation is not None else "",
            f"Results: {folder} (tuning.json, tuning.csv, study.log)",
            *(f"Report of {page.parent.name}: {page}" for page in pages),
        ]
    ).replace("\n\n", "\n")


# The best by training score, and the default wherever it stands.
def _tried_table(tuning: "TuningResult") -> str:
    ranked = sorted(tuning.tried, key=lambda tried: -tried.figures.score.value)
    best = ranked[:_BEST_SHOWN]
    is_apart = tuning.default not in best
    shown = [*best, tuning.default] if is_apart else best
    heads = ["SETTING", "N", "SUCCESS %", "MEAN SCORE", "MEAN TIME s", "PARAMETERS"]
    rows = [[each.setting.name, *_figure_words(each.figures), _parameters(each)] for each in shown]
    return f"In training, the best {len(best)} of {len(ranked)}{' and the default' * is_apart}:\n{table(heads, rows)}"


def _parameters(tried: "EvaluatedSetting") -> str:
    return ", ".join(f"{name} {_value(value)}" for name, value in tried.setting.parameters.items()) or "as entered"


def _verdict_lines(tuning: "TuningResult") -> list[str]:
    best, checked = tuning.best, tuning.validation
    if checked is None or tuning.difference is None:
        return ["No setting had a higher score than the default. Keep it, or search other ranges with more flights."]
    n = len(tuning.tried)
    verdict = (
        "No difference from the default is shown. More flights may show one."
        if not checked.is_shown
        else "It is better than the default."
        if checked.difference.value > 0
        else "It is worse than the default: keep the default."
    )
    return [
        f"Best in training: {best.setting.name}, mean score {format_estimate(best.figures.score, 2)}, over the "
        f"default on the same flights {format_estimate(tuning.difference, 2, sign=True)}.",
        f"The best of {n} looks better there than it is, because it was chosen there. On validation seeds that none of "
        f"them had met:",
        f"  {best.setting.name} {format_estimate(checked.best.score, 2)}, default "
        f"{format_estimate(checked.default.score, 2)}, paired difference "
        f"{format_estimate(checked.difference, 2, sign=True)}, n {checked.best.n}, p {checked.p:.2g} (signs flipped).",
        verdict,
    ]


def format_estimate(estimate: "Estimate", digits: int, *, factor: float = 1.0, sign: bool = False) -> str:
    """Return a figure with its interval, as in 0.62 (0.50 to 0.71)."""

    def word(value: float) -> str:
        return f"{factor * value:{'+' if sign else ''}.{digits}f}"

    if not math.isfinite(estimate.value):
        return "-"
    if not (math.isfinite(estimate.low) and math.isfinite(estimate.high)):
        return word(estimate.value)
    return f"{word(estimate.value)} ({word(estimate.low)} to {word(estimate.high)})"


def _figure_words(figures: "SettingFigures") -> list[str]:
    return [
        str(figures.n),
        format_estimate(figures.success, 0, factor=100.0),
        format_estimate(figures.score, 2),
        format_estimate(figures.time_s, 1),
    ]


def _values_text(parameters: Any) -> str:
    return "".join(f", {name} {_value(value)}" for name, value in parameters.items())


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
