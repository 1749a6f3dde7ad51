"""Environments made: from a scenario's few lines to a folder with room, wind, scene and picture, cached."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim.generation.batch import MadeEnvironment, Order, generate_many, orders_of
    from gslcosim.generation.making import generate_environment, save_with_views
    from gslcosim.generation.preparing import made_environment, prepare_environment
    from gslcosim.generation.winds import Progress

__all__ = [
    "MadeEnvironment",
    "Order",
    "Progress",
    "generate_environment",
    "generate_many",
    "made_environment",
    "orders_of",
    "prepare_environment",
    "save_with_views",
]

_HOMES = {
    "MadeEnvironment": "batch",
    "Order": "batch",
    "Progress": "winds",
    "generate_environment": "making",
    "generate_many": "batch",
    "made_environment": "preparing",
    "orders_of": "batch",
    "prepare_environment": "preparing",
    "save_with_views": "making",
}


# Who wants an environment that was made before needs none of what makes one: numba, and the solvers of the wind.
def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
