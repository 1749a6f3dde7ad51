"""Benchmark of search methods: suites of runs, their rows, statistics and reports.

`suite` turns a file into trials, `execution` flies them, `store` keeps their rows, `metrics` are figures of one run,
`statistics` are figures of many rows, `report` shows them on a page and `site` on many. Nothing below this package
knows of it.

For one's own studies there are `load_suite`, `run`, `Results` and `compare`; docs/benchmark/python.ipynb uses them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim_bench.cases.suite_files import load_suite
    from gslcosim_bench.execution.runner import run
    from gslcosim_bench.results import Comparison, Results, compare

__all__ = ["Comparison", "Results", "compare", "load_suite", "run"]

_HOMES = {
    "Comparison": "results",
    "Results": "results",
    "compare": "results",
    "load_suite": "cases.suite_files",
    "run": "execution.runner",
}


# The parts import each other through this package: loading all of them here would go round in a circle.
def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
