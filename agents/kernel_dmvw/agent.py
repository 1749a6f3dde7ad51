"""Kernel DM+V/W: maps mean and variance of the gas, with readings stretched along the wind.

After Reggente and Lilienthal. README.md beside this file has the rules, method.yaml the parameters.
"""

from gslcosim.agent_kit import run
from gslcosim_search.maps.map_agents import KernelMapAgent


class KernelDmvw(KernelMapAgent):
    """A search by kernel maps whose readings count along the wind."""

    program = __file__
    has_wind = True


if __name__ == "__main__":
    run(KernelDmvw)
