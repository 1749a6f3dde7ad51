"""Co-simulation framework for gas source localization (GSL): see README.md and ARCHITECTURE.md."""

import importlib
from typing import TYPE_CHECKING, Any

from gslcosim.base.kernel_cache import use_kernel_cache

if TYPE_CHECKING:
    from gslcosim.simulation.simulation import Simulation as Simulation

__version__ = "0.2.0"


def _unpack_kernels() -> None:
    from gslcosim.base.kernel_archives import unpack_archives

    unpack_archives()


use_kernel_cache(_unpack_kernels)


# Public names by their modules, which are imported on first use, so that a start stays short.
_CALLABLES = {"Simulation": "gslcosim.simulation.simulation"}
_MODULES = ("agent_kit",)


def __getattr__(name: str) -> Any:
    if name in _CALLABLES:
        return getattr(importlib.import_module(_CALLABLES[name]), name)
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module 'gslcosim' has no attribute '{name}'{_describe_home(name)}")


def _describe_home(name: str) -> str:
    if name.startswith("_"):
        return ""
    from gslcosim.base.extensions import find_name_remedy

    remedy = find_name_remedy(name)
    return f". {remedy}" if remedy else ""


def __dir__() -> list[str]:
    return sorted(["__doc__", "__file__", "__name__", "__path__", "__version__", *_CALLABLES, *_MODULES])
