"""What a decision of each bundled policy costs: processor time of one thread, the least and the median of many [us]."""

import sys
import time

import numpy as np

from gslcosim.base.bundled import bundled_agents
from gslcosim_search.learned.policy_agent import bundled_policies
from gslcosim_search.learned.policy_files import load_policy

LIMIT_US = 100.0
N_DECISIONS = 2000


def main() -> None:
    """Print a line for each policy."""
    agents = bundled_agents()["learned"].parents[1]
    for name, path in bundled_policies(agents).items():
        policy = load_policy(path)
        size = (N_DECISIONS, 1, len(policy.observation_names))
        seen = np.random.default_rng(1).uniform(-1, 1, size).astype(np.float32)
        memory, taken_us = policy.memory(1), []
        for one in seen:
            began_ns = time.thread_time_ns()
            _, memory = policy.act(one, memory)
            taken_us.append((time.thread_time_ns() - began_ns) / 1e3)
        least, median = min(taken_us), float(np.median(taken_us))
        verdict = "PASS" if least <= LIMIT_US else "MISS"
        sys.stdout.write(f"{name:<24} least {least:7.1f}  median {median:7.1f}  limit {LIMIT_US:g} us  {verdict}\n")


if __name__ == "__main__":
    main()
