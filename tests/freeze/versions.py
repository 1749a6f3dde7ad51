"""Versions of what computes results: on two machines where they are equal, results are too, whatever the processor."""

import sys
from importlib.metadata import PackageNotFoundError, version

PACKAGES = (
    "numpy", "numba", "llvmlite", "mujoco", "msgpack", "msgspec", "pydantic", "pyyaml", "pyarrow", "gymnasium",
)  # fmt: skip


def installed_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results depend on, by name."""
    return {"python": "{}.{}".format(*sys.version_info), **{name: _version(name) for name in PACKAGES}}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def differing(frozen: dict[str, str], here: dict[str, str]) -> str:
    """Return in which versions two machines differ, empty where they do not."""
    pairs = {name: (frozen.get(name, "none"), here.get(name, "none")) for name in sorted({*frozen, *here})}
    return "; ".join(f"{name} {then}, here {now}" for name, (then, now) in pairs.items() if then != now)
