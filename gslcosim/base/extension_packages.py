"""Packages of installed extensions, by import name: reading entry points would take a tenth of each start."""

import sys
from functools import cache
from pathlib import Path

PACKAGE_PREFIX = "gslcosim_"
# Packages of the core's own distribution with such names.
_CORE_PACKAGES = ("gslcosim_services", "gslcosim_agents", "gslcosim_scenarios")


@cache
def find_extension_packages() -> dict[str, Path]:
    """Return the folder of each extension's package by its import name, in alphabetical order, without imports."""
    found: dict[str, Path] = {}
    for folder in sys.path:
        try:
            inside = [path for path in Path(folder or ".").iterdir() if path.name.startswith(PACKAGE_PREFIX)]
        except OSError:
            continue
        for path in inside:
            if path.name not in _CORE_PACKAGES and path.name.isidentifier() and (path / "__init__.py").is_file():
                found.setdefault(path.name, path.resolve())
    return dict(sorted(found.items()))
