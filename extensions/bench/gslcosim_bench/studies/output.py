"""Sweeps and tunings as JSON and CSV, and parameters as YAML to paste."""

import json
import math
from collections.abc import Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.settings import SettingFigures
from gslcosim_bench.store import write_at_once
from gslcosim_bench.studies.sweep import SweepResult
from gslcosim_bench.studies.tuning import BATCH, EvaluatedSetting, TuningResult
from gslcosim_data.text_tables import write_csv

SWEEP_SCHEMA, TUNING_SCHEMA = "gslcosim/sweep/1", "gslcosim/tuning/1"


def sweep_to_json(sweep: SweepResult) -> dict[str, Any]:
    """Return a sweep as JSON has it: equal for equal runs."""
    return {
        "schema": SWEEP_SCHEMA,
        "suite": sweep.suite,
        "entry": sweep.entry,
        "seed": sweep.seed,
        "varied": {name: [_plain(value) for value in values] for name, values in sweep.varied.items()},
        "units": dict(sweep.units),
        "reference": sweep.reference.name,
        "is_reference_default": sweep.is_reference_default,
        "points": [
            {
                "entry": point.setting.name,
                "parameters": _values(point.setting.parameters),
                **_figure_fields(point.figures),
                "difference": _estimate_fields(point.difference),
            }
            for point in sweep.points
        ],
    }


def sweep_to_csv(sweep: SweepResult) -> str:
    """Return a line for each setting of a sweep: its values, and figures with the ends of their intervals."""
    names = list(sweep.varied)
    rows = (
        [
            point.setting.name,
            *(_cell(point.setting.parameters[name]) for name in names),
            *_figure_cells(point.figures),
            *_ends(point.difference),
        ]
        for point in sweep.points
    )
    return _csv(["entry", *names, *_FIGURE_HEADS, *_heads("difference")], rows)


def tuning_to_json(tuning: TuningResult) -> dict[str, Any]:
    """Return a tuning as JSON has it: equal for equal calls, whatever the workers and interruptions."""
    budget, checked = tuning.budget, tuning.validation
    return {
        "schema": TUNING_SCHEMA,
        "suite": tuning.suite,
        "entry": tuning.entry,
        "seed": tuning.seed,
        "sampler": {"name": "TPE", "batch": BATCH},
        "ranges": [
            {"parameter": r.name, "low": r.low, "high": r.high, "whole": r.is_whole, "log": r.is_log}
            for r in tuning.ranges
        ],
        "budget": {
            "flights": budget.flights,
            "per_setting": budget.per_setting,
            "per_validation": budget.per_validation,
            "search": tuning.n_search,
            "validation": tuning.n_validation,
            "used": tuning.n_search + tuning.n_validation,
        },
        "n_asked": tuning.n_asked,
        "training_seed": tuning.training_seed,
        "best": _tried_fields(tuning.best) | {"difference": _estimate_fields(tuning.difference)},
        "default": _tried_fields(tuning.default),
        "validation": None
        if checked is None
        else {
            "seed": checked.seed,
            "best": _figure_fields(checked.best),
            "default": _figure_fields(checked.default),
            "difference": _estimate_fields(checked.difference),
            "p": checked.p,
        },
        "parameters": parameters_to_paste(tuning),
        "settings": [_tried_fields(tried) for tried in tuning.tried],
    }


def tuning_to_csv(tuning: TuningResult) -> str:
    """Return a line for each setting that was run in training; the default's values are those it was entered with."""
    names = [each.name for each in tuning.ranges]
    rows = (
        [
            tried.setting.name,
            *(_cell(tried.setting.parameters.get(name, tuning.parameters.get(name, ""))) for name in names),
            *_figure_cells(tried.figures),
        ]
        for tried in tuning.tried
    )
    return _csv(["setting", *names, *_FIGURE_HEADS], rows)


def parameters_to_paste(tuning: TuningResult) -> dict[str, Any]:
    """Return the parameters of the best setting, with those that the entry had and that were not searched."""
    return _values({**tuning.parameters, **tuning.best.setting.parameters})


def to_inline_yaml(parameters: Mapping[str, Any]) -> str:
    """Return parameters as a YAML map in one line."""
    return "{" + ", ".join(f"{name}: {json.dumps(_plain(value))}" for name, value in parameters.items()) + "}"


def write_text(path: Path, text: str) -> None:
    """Write a file of the results in one go."""
    write_at_once(path, lambda beside: beside.write_text(text, encoding="utf-8"))


def write_fields(path: Path, fields: Mapping[str, Any]) -> None:
    """Write a JSON file of the results in one go."""
    write_text(path, json.dumps(fields, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def _tried_fields(tried: EvaluatedSetting) -> dict[str, Any]:
    return {
        "setting": tried.setting.name,
        "parameters": _values(tried.setting.parameters),
        **_figure_fields(tried.figures),
    }


def _figure_fields(figures: SettingFigures) -> dict[str, Any]:
    return {
        "n": figures.n,
        "n_without_result": figures.n_without_result,
        "success": _estimate_fields(figures.success),
        "score": _estimate_fields(figures.score),
        "time_s": _estimate_fields(figures.time_s),
    }


def _estimate_fields(estimate: Estimate | None) -> dict[str, float | None] | None:
    if estimate is None:
        return None
    return {key: value for key, value in estimate.to_fields().items() if key != "n"}


def _heads(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high"]


_FIGURE_HEADS = ["n", "n_without_result", *_heads("success"), *_heads("score"), *_heads("time_s")]


def _figure_cells(figures: SettingFigures) -> list[Any]:
    estimates = (figures.success, figures.score, figures.time_s)
    return [figures.n, figures.n_without_result, *(end for each in estimates for end in _ends(each))]


def _ends(estimate: Estimate | None) -> list[float | str]:
    if estimate is None:
        return ["", "", ""]
    return [end if math.isfinite(end) else "" for end in (estimate.value, estimate.low, estimate.high)]


def _cell(value: Any) -> Any:
    return json.dumps(_plain(value)) if isinstance(value, bool | tuple | list) else value


def _values(parameters: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _plain(value) for name, value in parameters.items()}


def _plain(value: Any) -> Any:
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value


def _csv(heads: list[str], rows: Iterable[list[Any]]) -> str:
    text = StringIO()
    write_csv(text, [heads, *rows], line_end="\n")
    return text.getvalue()
