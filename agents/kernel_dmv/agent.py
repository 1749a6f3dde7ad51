"""Kernel DM+V: maps mean and variance of the gas, and looks for the source where it varies most.

After Lilienthal and others. README.md beside this file has the rules, method.yaml the parameters.
"""

from gslcosim.agent_kit import run
from gslcosim_search.maps.map_agents import KernelMapAgent


class KernelDmv(KernelMapAgent):
    """A search by kernel maps whose readings count equally far to all sides."""

    program = __file__


if __name__ == "__main__":
    run(KernelDmv)
