"""Digests of the bundled scenarios on several kinds of processor, and a table of where they differ: `make one-digest`.

A processor is a set of environment variables that cut down what glibc, numpy, OpenBLAS and numba find, a C library
whose elementary functions are off by a unit in the last place, a model of `qemu-x86_64` (Debian's package qemu-user),
whose child processes run on this machine's own, or what `tests/freeze/aarch64.sh` has installed. Each has a cache of
its own, so that it also solves the wind of its rooms and compiles its kernels. MuJoCo's wheel needs AVX: no older
processor can run it.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.base.kernel_cache import build_processor_variables

ROOT = Path(__file__).parents[2]
QEMU = "qemu-x86_64"
QUICK = ("tiny_room", "warehouse_empty", "event_door")
LAYOUTS = ("one", "separate")
# Those of the caller are not inherited.
_OWN_VARIABLES = ("GLIBC_TUNABLES", "LD_PRELOAD", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE")
_NUMBA_PREFIX = "NUMBA_"
_OTHER_C_LIBRARY = Path(__file__).with_name("other_c_library.c")
_TIMEOUT_S = 3600.0


@dataclass(frozen=True)
class Processor:
    """A kind of processor that this machine can stand for.

    Args:
        name: Its name in the table.
        variables: Environment variables that hide features of this machine.
        emulated: Command that runs Python on it; empty for this machine's own.
    """

    name: str
    variables: Mapping[str, str] = field(default_factory=dict)
    emulated: tuple[str, ...] = ()


_GLIBC = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F"}
_NUMPY = {
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR AVX2 FMA3"
}
_BLAS = {"OPENBLAS_CORETYPE": "Prescott"}
_NUMBA = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}
# LLVM would read this machine's features.
_GENERIC = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
PROCESSORS = (
    Processor("this machine"),
    Processor("glibc without FMA", _GLIBC),
    Processor("numpy without AVX2", _NUMPY),
    Processor("BLAS for SSE3", _BLAS),
    Processor("numba for x86-64", _NUMBA),
    Processor("all of these", _GLIBC | _NUMPY | _BLAS | _NUMBA),
)
# Processes under qemu-user read this machine's features in /proc/cpuinfo, so that each model names its level.
_LEVELS = {"SandyBridge": "x86-64-v2", "Haswell": "x86-64-v3", "Skylake-Server": "x86-64-v3", "EPYC": "x86-64-v3"}
EMULATED = tuple(
    Processor(f"qemu {model}", build_processor_variables(level), (QEMU, "-cpu", model, sys.executable))
    for model, level in _LEVELS.items()
)


@dataclass(frozen=True)
class Case:
    """A run of which every processor must give the same digest."""

    scenario: str
    seed: int
    layout: str

    def __str__(self) -> str:
        return f"{self.scenario} seed {self.seed} {self.layout}"


def run_case(case: Case, processor: Processor, folder: Path) -> str:
    """Return the digest of a case on a processor, or the last line of its error."""
    place = folder / processor.name.replace(" ", "_")
    interpreter = processor.emulated or (sys.executable,)
    command = [
        *interpreter, "-m", "gslcosim", "up", str(ROOT / "scenarios" / f"{case.scenario}.yaml"), "--json",
        "--seed", str(case.seed), "--processes", case.layout, "--runs-dir", str(place / "runs"),
    ]  # fmt: skip
    inherited = {
        name: value
        for name, value in os.environ.items()
        if name not in _OWN_VARIABLES and not name.startswith(_NUMBA_PREFIX)
    }
    try:
        ended = subprocess.run(
            command, env={**inherited, **processor.variables, "GSLCOSIM_CACHE": str(place / "cache")},
            cwd=ROOT, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no result in {_TIMEOUT_S:g} s"
    try:
        result = json.loads(ended.stdout)
        return str(result["digest"] or result["end_reason"])
    except (ValueError, KeyError):
        return (ended.stderr.strip().splitlines() or [f"exit {ended.returncode}"])[-1]


def build_other_c_library(folder: Path) -> Processor:
    """Return this machine with a C library whose elementary functions give other bits, compiled into a folder."""
    library = folder / "other_c_library.so"
    options = ("-O1", "-fno-builtin", "-shared", "-fPIC")
    subprocess.run(["cc", *options, "-o", str(library), str(_OTHER_C_LIBRARY), "-ldl", "-lm"], check=True)
    return Processor("another C library", {"LD_PRELOAD": str(library)})


def build_cases(scenarios: Sequence[str], n_seeds: int, layouts: Sequence[str]) -> list[Case]:
    """Return each scenario with each seed in one process, and with its first seed in the other layouts."""
    return [
        Case(scenario, seed, layout)
        for scenario in scenarios
        for seed in range(1, n_seeds + 1)
        for layout in layouts
        if layout == layouts[0] or seed == 1
    ]


def write_table(digests: Mapping[tuple[Case, str], str], names: Sequence[str]) -> str:
    """Return a Markdown table with a row for each scenario and seed: the digest, or where others differ from it."""
    lines = [f"| run | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for case in dict.fromkeys(case for case, _ in digests):
        first = digests.get((case, names[0]), "")
        cells = []
        for name in names:
            found = digests.get((case, name), "not tried")
            cells.append(found[:12] if found == first or found == "not tried" else f"**{found[:40]}**")
        lines.append(f"| {case} | {' | '.join(cells)} |")
    return "\n".join(lines)


def find_differing(digests: Mapping[tuple[Case, str], str]) -> list[str]:
    """Return a line for each scenario and seed that has more than one digest, over all processors and layouts."""
    found: dict[tuple[str, int], set[str]] = {}
    for (case, _), digest in digests.items():
        found.setdefault((case.scenario, case.seed), set()).add(digest)
    return [f"{name} seed {seed}: {' '.join(sorted(each))}" for (name, seed), each in found.items() if len(each) > 1]


def main() -> int:
    """Run the cases on all processors, print the table, and return 1 where a scenario has several digests."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=sorted(p.stem for p in (ROOT / "scenarios").glob("*.yaml")))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--layouts", nargs="+", default=list(LAYOUTS))
    parser.add_argument("--processors", nargs="+", help="names, or parts of names (default: all)")
    parser.add_argument("--aarch64", type=Path, metavar="FOLDER", help="folder that aarch64.sh has filled")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="folder of caches and runs, kept (default: a temporary one)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        aarch64 = [Processor("qemu aarch64", _GENERIC, (str(args.aarch64 / "python"),))] if args.aarch64 else []
        known = (*PROCESSORS, build_other_c_library(folder), *EMULATED, *aarch64)
        wanted = [each for each in known if args.processors is None or any(p in each.name for p in args.processors)]
        digests: dict[tuple[Case, str], str] = {}

        def run_all(processor: Processor) -> None:
            scenarios = [n for n in args.scenarios if n in QUICK] if processor.emulated else args.scenarios
            seeds, layouts = (1, args.layouts[:1]) if processor.emulated else (args.seeds, args.layouts)
            for case in build_cases(scenarios, seeds, layouts):
                digests[case, processor.name] = found = run_case(case, processor, folder)
                sys.stderr.write(f"{processor.name}: {case}: {found}\n")

        if shutil.which(QEMU) is None:
            sys.stderr.write(f"Without {QEMU} (apt-get install qemu-user): no emulated processors.\n")
            wanted = [each for each in wanted if QEMU not in each.emulated]
        with ThreadPoolExecutor(args.jobs) as pool:
            list(pool.map(run_all, wanted))
    sys.stdout.write(write_table(digests, [each.name for each in wanted]) + "\n")
    differing = find_differing(digests)
    lines = differing or [f"One digest each on {len(wanted)} processors."]
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
