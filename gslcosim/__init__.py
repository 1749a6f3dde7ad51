"""Co-simulation framework for gas source localization (GSL): see README.md and ARCHITECTURE.md."""

from gslcosim._kernel_cache import use_kernel_cache

__version__ = "0.1.0"

use_kernel_cache()
