"""Data that runs have left: read back as arrays, summarised, filtered, exported, drawn and filmed."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim_data.run import open_run

__all__ = ["open_run"]


# `open_run` needs what reads recordings, which the command line's own modules do not.
def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.run"), name)
