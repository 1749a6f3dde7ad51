"""Checks of `gslcosim doctor`: the requirements of a run on this machine, one by one."""

import importlib.metadata
import json
import os
import queue
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from gslcosim.base.code_identity import COMPUTING_PACKAGES
from gslcosim.base.extensions import list_registrations
from gslcosim.base.processes import build_python_command

if TYPE_CHECKING:
    from gslcosim.bus.interface import Bus

Level = Literal["OK", "WARN", "FAIL"]

MIN_PYTHON = (3, 11)
MIN_MEMORY_GB, GOOD_MEMORY_GB = 0.5, 2.0
MIN_DISK_GB, GOOD_DISK_GB = 0.2, 2.0
PROBE_LIMIT_S = 30.0
# The computing packages have compiled code, and are imported by the name of the distribution.
COMPILED_MODULES = (*COMPUTING_PACKAGES, "zenoh", "rerun")
ROUND_TRIPS = 50
ROUND_TRIP_LIMIT_S = 5.0


@dataclass(frozen=True, kw_only=True)
class CheckResult:
    """Finding of one check: `WARN` limits the possibilities, `FAIL` prevents a run."""

    name: str
    level: Level
    text: str
    remedy: str = ""


def run_checks() -> Iterator[CheckResult]:
    """Run all checks one after the other; a check that itself fails is a finding too."""
    for name, check in CHECKS.items():
        try:
            yield from check()
        except Exception as error:  # the doctor must reach the end, whatever is broken
            yield CheckResult(
                name=name, level="FAIL", text=f"the check failed: {error!r}", remedy="Please report this."
            )


def check_python() -> Iterator[CheckResult]:
    """Check Python's version."""
    version = sys.version_info[:3]
    text = f"{'.'.join(map(str, version))} at {sys.executable}"
    yield _graded("Python", "OK" if version >= MIN_PYTHON else "FAIL", text, "Install Python 3.11 or newer.")


def check_packages(requirements: list[str] | None = None) -> Iterator[CheckResult]:
    """Check that each required package is installed in a compatible version.

    Args:
        requirements: Texts like `numpy>=2.0`; by default those of the installed gslcosim.
    """
    if requirements is None:
        requirements = importlib.metadata.requires("gslcosim") or []
    for requirement in map(Requirement, requirements):
        # Required by an extra only.
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        name, bounds = requirement.name, requirement.specifier
        remedy = f'Run: {sys.executable} -m pip install "{name}{bounds}"'
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            yield CheckResult(name=name, level="FAIL", text=f"missing, needs {bounds or 'any version'}", remedy=remedy)
            continue
        fits = version_fits(version, bounds)
        yield _graded(name, "OK" if fits else "WARN", version if fits else f"{version}, needs {bounds}", remedy)


def check_extensions() -> Iterator[CheckResult]:
    """Check that each installed extension has the packages that it requires."""
    for name in sorted({point.distribution for point in list_registrations()} - {"gslcosim"}):
        required = check_packages(importlib.metadata.requires(name) or [])
        unmet = [finding for finding in required if finding.level != "OK"]
        text = "; ".join(f"{finding.name}: {finding.text}" for finding in unmet) or importlib.metadata.version(name)
        yield _graded(name, "WARN" if unmet else "OK", text, ". ".join(finding.remedy for finding in unmet))


def check_imports() -> Iterator[CheckResult]:
    """Check that the packages with compiled code can be loaded, in a separate process."""
    call = build_python_command("-c", f"import {', '.join(COMPILED_MODULES)}")
    loading = subprocess.run(call, capture_output=True, text=True, timeout=PROBE_LIMIT_S, check=False)
    lines = loading.stderr.strip().splitlines()
    text = lines[-1] if loading.returncode and lines else f"{', '.join(COMPILED_MODULES)} can be loaded"
    remedy = "Reinstall the package that the message names."
    yield _graded("compiled packages", "FAIL" if loading.returncode else "OK", text, remedy)


def version_fits(version: str, bounds: SpecifierSet) -> bool:
    """Return whether a version lies within bounds; a pre-release counts as its release."""
    return Version(version).base_version in bounds


def check_cores() -> Iterator[CheckResult]:
    """Check the number of CPU cores that this process may use."""
    n_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    remedy = "A run is six processes; with one core `gslcosim up --in-process` is faster."
    yield _graded("CPU cores", "OK" if n_cores > 1 else "WARN", f"{n_cores}", remedy)


def check_memory() -> Iterator[CheckResult]:
    """Check the free memory."""
    free_gb = free_memory_gb()
    level = _level(free_gb, MIN_MEMORY_GB, GOOD_MEMORY_GB)
    yield _graded(
        "free memory", level, f"{free_gb:.1f} GB", f"A run needs about {GOOD_MEMORY_GB:g} GB: close programs."
    )


def check_cache() -> Iterator[CheckResult]:
    """Check that the cache is writable and that its disk has room."""
    from gslcosim.base.kernel_cache import get_cache_root

    root = get_cache_root()
    remedy = "Set GSLCOSIM_CACHE to a folder that can be written and has room."
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            pass
    except OSError as error:
        yield CheckResult(name="cache", level="FAIL", text=f"{root} cannot be written: {error.strerror}", remedy=remedy)
        return
    yield CheckResult(name="cache", level="OK", text=f"{root} can be written")
    free_gb = shutil.disk_usage(root).free / 1e9
    yield _graded("free disk", _level(free_gb, MIN_DISK_GB, GOOD_DISK_GB), f"{free_gb:.1f} GB in the cache", remedy)


def check_zenoh() -> Iterator[CheckResult]:
    """Check a query and its answer through a real router and a second session, as in a run."""
    try:
        median_s = zenoh_round_trip_s()
    except Exception as error:
        remedy = "Reinstall eclipse-zenoh; `gslcosim up --in-process` works without it."
        yield CheckResult(name="Zenoh round trip", level="FAIL", text=f"{error}", remedy=remedy)
        return
    yield CheckResult(name="Zenoh round trip", level="OK", text=f"{1e3 * median_s:.2f} ms through a router")


def check_rendering() -> Iterator[CheckResult]:
    """Check that pictures can be drawn without a display."""
    call = build_python_command("-m", "gslcosim.cli.rendering_probe")
    try:
        probe = subprocess.run(call, capture_output=True, text=True, timeout=PROBE_LIMIT_S, check=True)
        found = json.loads(probe.stdout)
    except (subprocess.SubprocessError, json.JSONDecodeError) as error:
        found = {key: {"is_there": False, "text": f"the driver crashed ({error})"} for key in ("vulkan", "egl")}
    vulkan, egl = found["vulkan"], found["egl"]
    text = ", ".join(vulkan["text"]) if vulkan["is_there"] else vulkan["text"]
    remedy = "`gslcosim view --screenshot` needs it. On Debian: apt-get install mesa-vulkan-drivers"
    yield _graded("Vulkan", "OK" if vulkan["is_there"] else "WARN", text, remedy)
    remedy = "Off-screen cameras need it. On Debian: apt-get install libegl1 libgl1-mesa-dri, or libosmesa6"
    yield _graded("GL (EGL)", "OK" if egl["is_there"] else "WARN", egl["text"], remedy)


def check_sandbox() -> Iterator[CheckResult]:
    """Check the strongest sandbox for agents on this machine."""
    from gslcosim.runtime.processes.sandbox.selection import find_strongest_sandbox, list_open_gaps, unavailable_reason

    kind = find_strongest_sandbox()
    reasons = [unavailable_reason("bubblewrap"), unavailable_reason("landlock")] if kind == "none" else []
    reasons += [unavailable_reason("bubblewrap")] if kind == "landlock" else []
    text = f"{kind}, as {' and '.join(reasons)}" if reasons else kind
    gaps = [*list_open_gaps(kind), *(["sockets of other programs that have a path"] if kind == "landlock" else [])]
    text += f"; open: {', '.join(gaps)}" if gaps else ""
    remedy = "Agents see less in bubblewrap. On Debian: apt-get install bubblewrap"
    yield _graded("sandbox of agents", "OK" if kind == "bubblewrap" and not gaps else "WARN", text, remedy)


CHECKS: dict[str, Callable[[], Iterator[CheckResult]]] = {
    "Python": check_python,
    "packages": check_packages,
    "extensions": check_extensions,
    "compiled packages": check_imports,
    "CPU cores": check_cores,
    "free memory": check_memory,
    "cache": check_cache,
    "Zenoh round trip": check_zenoh,
    "sandbox": check_sandbox,
    "rendering": check_rendering,
}


def free_memory_gb() -> float:
    """Return the memory available to a new process [GB]."""
    info = Path("/proc/meminfo")
    if info.exists():
        match = re.search(r"^MemAvailable:\s+(\d+) kB", info.read_text(), re.MULTILINE)
        if match:
            return int(match[1]) * 1024 / 1e9
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9


def zenoh_round_trip_s() -> float:
    """Return the median time [s] from a query to its answer through a router on a private socket."""
    from gslcosim.base.files import ScratchFolder
    from gslcosim.bus.interface import JoinData
    from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, ZenohBus, generate_password

    password = generate_password()
    answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with ScratchFolder.for_sockets() as scratch:
        folder = scratch.path
        endpoint, namespace = f"unixsock-stream/{folder}/router.sock", "gsl/doctor"
        router = ZenohBus.open_router(
            endpoints=[endpoint], namespace=namespace, service_password=password, agents=[], secrets_dir=Path(folder)
        )
        member = None
        try:
            router.answer("rpc/doctor", lambda question: [question])
            join = JoinData(
                name="doctor", endpoint=endpoint, namespace=namespace, user=SERVICE_ACCOUNT, password=password
            )
            member = ZenohBus.open_member(join)
            return statistics.median(_round_trip_s(member, answers) for _ in range(ROUND_TRIPS))
        finally:
            if member is not None:
                member.close()
            router.close()


def _round_trip_s(member: "Bus", answers: "queue.SimpleQueue[bytes]") -> float:
    began = time.perf_counter()
    member.ask("rpc/doctor", b"?", lambda _, payload: answers.put(payload))
    try:
        answers.get(timeout=ROUND_TRIP_LIMIT_S)
    except queue.Empty:
        raise TimeoutError(f"expected an answer within {ROUND_TRIP_LIMIT_S:g} s, none came") from None
    return time.perf_counter() - began


def _graded(name: str, level: Level, text: str, remedy: str) -> CheckResult:
    return CheckResult(name=name, level=level, text=text, remedy="" if level == "OK" else remedy)


def _level(value: float, minimum: float, good: float) -> Level:
    return "OK" if value >= good else "WARN" if value >= minimum else "FAIL"
