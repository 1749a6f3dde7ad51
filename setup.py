"""Packages of the wheel; all else is in pyproject.toml, which cannot find packages and rename folders at once."""

from setuptools import find_packages, setup

setup(
    packages=[
        *find_packages(include=["gslcosim", "gslcosim.*"]),
        "gslcosim_agents",
        "gslcosim_scenarios",
        "gslcosim_services",
        *(f"gslcosim_services.{name}" for name in find_packages("services")),
    ]
)
