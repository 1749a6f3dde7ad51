"""Elementary functions of `gslcosim.base.elementary_kernels`, which are loaded with numba when the first is used.

Models import this module in processes that compute nothing, such as the supervisor of a run.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim.base.elementary_kernels import *  # noqa: F403 - all of them


def __getattr__(name: str) -> Any:
    from gslcosim.base import elementary_kernels

    globals()[name] = function = getattr(elementary_kernels, name)
    return function
