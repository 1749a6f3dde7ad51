"""Comparison of models and methods with measurements: readers of data, cases, and the page of `make reality`."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim_validation.readers.columns import MeasuredDataError as MeasuredDataError
    from gslcosim_validation.readers.folder import MeasuredData as MeasuredData
    from gslcosim_validation.readers.folder import MeasuredSet as MeasuredSet
    from gslcosim_validation.readers.folder import read_measured as read_measured

_HOMES = {
    "MeasuredData": "readers.folder",
    "MeasuredDataError": "readers.columns",
    "MeasuredSet": "readers.folder",
    "read_measured": "readers.folder",
}
__all__ = ["MeasuredData", "MeasuredDataError", "MeasuredSet", "read_measured"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
