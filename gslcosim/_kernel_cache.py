"""Where compiled numba kernels are kept: outside the checkout, and never stale."""

import hashlib
import os
from pathlib import Path

PACKAGE_DIR = Path(__file__).resolve().parent


def cache_root() -> Path:
    """Return the folder for everything gslcosim computes once and keeps.

    `GSLCOSIM_CACHE` overrides it; otherwise `$XDG_CACHE_HOME/gslcosim` or `~/.cache/gslcosim`.
    """
    if chosen := os.environ.get("GSLCOSIM_CACHE"):
        return Path(chosen).expanduser()
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "gslcosim"


def use_kernel_cache() -> None:
    """Point numba at a cache folder that changes whenever a shared kernel does.

    Numba keys a cached kernel by its own file only, so a kernel that calls one of another file would
    keep the old callee. Kernels that other modules call therefore live in files named
    `*_kernels.py`, and a hash of all of those is part of the folder's name.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(PACKAGE_DIR.rglob("*_kernels.py")):
        digest.update(path.relative_to(PACKAGE_DIR).as_posix().encode())
        digest.update(path.read_bytes())
    os.environ["NUMBA_CACHE_DIR"] = str(cache_root() / "numba" / digest.hexdigest())
