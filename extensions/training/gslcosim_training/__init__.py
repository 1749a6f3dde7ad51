"""Search as a task for learning: environments of Gymnasium and PettingZoo, and thousands of searches at a time.

`import gslcosim_training` registers `gslcosim/Search-v0` with Gymnasium where that is installed.
"""

import importlib.util

SEARCH = "gslcosim/Search-v0"
REMEDY = "pip install 'gslcosim-training[gym]'"


def register_environments() -> None:
    """Register the environments with Gymnasium, once; do nothing where it is not installed."""
    if importlib.util.find_spec("gymnasium") is None:
        return
    from gymnasium.envs.registration import register, registry

    if SEARCH not in registry:
        register(id=SEARCH, entry_point="gslcosim_training.search_env:SearchEnv")


register_environments()
