"""Search as a task for learning: environments of Gymnasium and PettingZoo, and thousands of searches at a time.

`import gslcosim.training` registers `gslcosim/Search-v0` with Gymnasium where that is installed.
"""

from gslcosim.training.registration import register_environments

register_environments()
