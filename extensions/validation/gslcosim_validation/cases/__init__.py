"""Cases of `gslcosim reality`: the table `cases.yaml`, and a module for each that computes its figures."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import yaml

from gslcosim.base.errors import UsageError
from gslcosim.base.yaml_core import CoreLoader
from gslcosim_validation.results import Case

TABLE = Path(__file__).parent / "cases.yaml"


@cache
def read_cases() -> dict[str, Case]:
    """Return all cases by name, in the order of the page."""
    blocks = yaml.load(TABLE.read_text(encoding="utf-8"), Loader=CoreLoader)
    return {name: Case(name=name, **block) for name, block in blocks.items()}


def load_case(name: str) -> Case:
    """Return a case by its name."""
    cases = read_cases()
    if name not in cases:
        raise UsageError(f"--only: expected cases among {', '.join(cases)}, was {name}.")
    return cases[name]


def load_cases(names: Sequence[str] = ()) -> tuple[Case, ...]:
    """Return the cases of these names in the page's order, by default all."""
    chosen = [load_case(name) for name in names]
    return tuple(case for case in read_cases().values() if not names or case in chosen)
