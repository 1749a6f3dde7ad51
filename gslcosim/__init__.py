"""Co-simulation framework for gas source localization (GSL): see README.md and ARCHITECTURE.md."""

import importlib
from typing import TYPE_CHECKING, Any

from gslcosim.base.kernel_cache import use_kernel_cache
from gslcosim.base.old_names import support_old_names

if TYPE_CHECKING:
    from gslcosim.data.run import open_run as open_run

__version__ = "0.1.0"

use_kernel_cache()
support_old_names()


# By name, so that nothing is imported before it is used, and the rooms below do not know of it.
def __getattr__(name: str) -> Any:
    if name == "open_run":
        return importlib.import_module("gslcosim.data.run").open_run
    raise AttributeError(f"module 'gslcosim' has no attribute '{name}'")
