"""Compiled kernels for wheels: `make dist` writes an archive into each package, for each level of processors.

Each level has a cache of its own, in which the kernels of all bundled scenarios and agents are compiled by flying them;
so a level that this processor lacks is left out, with a line that says so.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from gslcosim.base.kernel_archives import pack_archives
from gslcosim.base.kernel_cache import (
    EXTENSIONS_VARIABLE,
    NUMBA_VARIABLE,
    OWNER_VARIABLE,
    PROCESSOR_LEVELS,
    PROCESSOR_VARIABLE,
    build_processor_variables,
)

OURS = (NUMBA_VARIABLE, OWNER_VARIABLE, EXTENSIONS_VARIABLE)


def build_archives(level: str) -> None:
    """Compile all kernels for a level in a cache of its own, and let a process there pack them."""
    plain = {name: text for name, text in os.environ.items() if name not in OURS}
    with tempfile.TemporaryDirectory() as cache:
        variables = plain | build_processor_variables(level) | {"GSLCOSIM_CACHE": cache}
        for command in (("-m", "gslcosim", "cache", "compile"), (__file__, "pack")):
            subprocess.run([sys.executable, *command], env=variables, check=True)


def pack() -> None:
    """Write the archive of each package that has kernels, and print its size."""
    for archive in pack_archives():
        print(f"{archive.relative_to(Path.cwd())}: {archive.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    if sys.argv[1:] == ["pack"]:
        pack()
    else:
        levels = list(PROCESSOR_LEVELS)
        here = levels.index(os.environ[PROCESSOR_VARIABLE]) if os.environ.get(PROCESSOR_VARIABLE) in levels else -1
        for missing in levels[here + 1 :]:
            print(f"{missing}: left out, this processor lacks it; wheels compile its kernels on first use")
        for each in levels[: here + 1]:
            build_archives(each)
