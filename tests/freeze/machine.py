"""Type of machine on which the last bits of results depend: processor features, C library and package versions."""

import platform
from importlib.metadata import PackageNotFoundError, version

import llvmlite.binding as llvm
import numpy as np

PACKAGES = (
    "numpy", "numba", "llvmlite", "mujoco", "msgpack", "msgspec", "pydantic", "pyyaml", "pyarrow", "gymnasium",
)  # fmt: skip


def machine_type() -> dict[str, str]:
    """Return what decides the last bits of a result on this machine, by name.

    numba compiles for the processor that LLVM names and its features, numpy chooses its loops by the features that it
    finds, and the C library has the elementary functions.
    """
    features = sorted(name for name, is_there in llvm.get_host_cpu_features().items() if is_there)
    loops = np.show_config(mode="dicts")["SIMD Extensions"]  # type: ignore[call-overload,index]
    return {
        "platform": f"{platform.system()} {platform.machine()}",
        "c_library": " ".join(platform.libc_ver()),
        "python": platform.python_version(),
        "processor": llvm.get_host_cpu_name(),
        "processor_features": " ".join(features),
        "numpy_loops": " ".join([*loops["baseline"], *loops.get("found", ())]),
        **{name: _version(name) for name in PACKAGES},
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def differing(frozen: dict[str, str], here: dict[str, str]) -> str:
    """Return how two types of machine differ in a few words, empty where they do not."""
    found = []
    for name in sorted({*frozen, *here}):
        then, now = frozen.get(name, "none"), here.get(name, "none")
        if then == now:
            continue
        words = set(then.split()) ^ set(now.split())
        shown = f"{then}, here {now}" if len(then) + len(now) < 80 else f"without or with {' '.join(sorted(words))}"
        found.append(f"{name} {shown}")
    return "; ".join(found)
