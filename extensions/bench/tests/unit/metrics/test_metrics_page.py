"""docs/benchmark/metrics.md names every figure, and columns that there are."""

import importlib
import inspect
import pkgutil
import re
from dataclasses import fields
from pathlib import Path

import pytest

from gslcosim_bench import metrics
from gslcosim_bench.metrics.beliefs import BeliefFigures
from gslcosim_bench.metrics.path_metrics import DeclarationFigures
from gslcosim_bench.store import TRACK_COLUMNS, TRIAL_COLUMNS

PAGE = (Path(__file__).parents[5] / "docs" / "benchmark" / "metrics.md").read_text()
MODULES = [name for _, name, _ in pkgutil.iter_modules(metrics.__path__) if name != "series"]


@pytest.mark.parametrize("name", MODULES)
def test_every_figure_is_on_the_page(name):
    module = importlib.import_module(f"gslcosim_bench.metrics.{name}")
    assert f"`{module.__name__}`" in PAGE
    own = [f.__name__ for _, f in inspect.getmembers(module, inspect.isfunction) if f.__module__ == module.__name__]
    assert [f for f in own if not f.startswith("_") and f"`{f}`" not in PAGE] == []


def test_every_part_of_the_figures_is_on_the_page():
    parts = [part.name for kind in (BeliefFigures, DeclarationFigures) for part in fields(kind)]
    assert [part for part in parts if f"`{part}`" not in PAGE] == []


def test_columns_on_the_page_are_columns():
    """In each row of a table the cell under `column` names columns of the tables, or none."""
    names = {column.name for column in (*TRIAL_COLUMNS, *TRACK_COLUMNS)} | {"tracks.parquet"}
    place, named = None, []
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if "column" in cells:
            place = cells.index("column")
        elif not line.startswith("|"):
            place = None
        elif place is not None:
            named += re.findall(r"`([\w.]+)`", cells[place])
    assert len(named) > 20
    assert set(named) <= names
