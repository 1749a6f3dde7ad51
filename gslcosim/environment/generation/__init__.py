"""Generation of environments: from a scenario's few lines to a cached folder with geometry, wind, scene and picture."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gslcosim.environment.generation.builder import generate_environment, save_with_scene_and_picture
    from gslcosim.environment.generation.cache import find_environment, prepare_environment
    from gslcosim.environment.generation.wind import Progress

__all__ = [
    "Progress",
    "find_environment",
    "generate_environment",
    "prepare_environment",
    "save_with_scene_and_picture",
]

_HOMES = {
    "Progress": "wind",
    "find_environment": "cache",
    "generate_environment": "builder",
    "prepare_environment": "cache",
    "save_with_scene_and_picture": "builder",
}


# Who wants an environment that was made before needs none of what makes one: numba, and the solvers of the wind.
def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
