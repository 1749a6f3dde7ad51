"""Wind by OpenFOAM: find an installation, run its tools on a case, follow what they print, and read the result."""

import collections
import contextlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.base.files import remove_tree
from gslcosim.flow.patches import Patch
from gslcosim.flow.pressure import F32
from gslcosim.flow.solve import AIR_NU_M2_S, Turbulence
from gslcosim_formats.openfoam.case import COURANT, FoamCase, write_case

# Where packagers put it. Debian has the tools on the path and its settings, without a script that works, elsewhere.
DEBIAN_PROJECT_DIR = Path("/usr/share/openfoam")
PROJECT_DIRS = ("/opt/openfoam*", "/opt/OpenFOAM/OpenFOAM-*", "/usr/lib/openfoam/openfoam*")

# Open MPI refuses root (containers), more ranks than cores, and copies between processes that a container forbids.
_MPI = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    "OMPI_MCA_plm_rsh_agent": "",
}
_FIELD_TYPE = NDArray[np.float32]
_TIME = re.compile(r"^Time = ([0-9.eE+-]+)s?$")
_N_LAST_LINES = 15


@dataclass(frozen=True, kw_only=True)
class Installation:
    """An OpenFOAM that can run here: its project folder and the environment of its tools."""

    project_dir: Path
    environment: dict[str, str]

    def tool(self, name: str) -> str:
        """Return the path of one of its tools."""
        path = shutil.which(name, path=self.environment["PATH"])
        if path is None:
            raise FlowError(
                f"OpenFOAM in {self.project_dir}: expected its tool {name}, found none on its path. "
                f"Install the whole of it."
            )
        return path


def find_installation(*, project_dirs: tuple[str, ...] = PROJECT_DIRS) -> Installation:
    """Return the OpenFOAM of this machine: the one on the path, else $WM_PROJECT_DIR's, else the newest installed one.

    Args:
        project_dirs: Patterns of folders to look in.
    """
    candidates = [*_from_variable(), *_from_folders(project_dirs)]
    if shutil.which("pimpleFoam"):
        named = os.environ.get("WM_PROJECT_DIR")
        return Installation(
            project_dir=Path(named) if named else DEBIAN_PROJECT_DIR,
            environment={**_MPI, "WM_PROJECT_DIR": str(DEBIAN_PROJECT_DIR), **os.environ},
        )
    for project_dir in candidates:
        environment = _environment_of(project_dir)
        if shutil.which("pimpleFoam", path=environment.get("PATH", "")):
            return Installation(project_dir=project_dir, environment={**_MPI, **environment})
    raise FlowError(
        f"OpenFOAM: expected pimpleFoam on the path, or a folder with etc/bashrc and pimpleFoam in "
        f"$WM_PROJECT_DIR or {' or '.join(project_dirs)}, found none. "
        f"Install it, on Debian with `apt-get install --no-install-recommends openfoam`, "
        f"or use the built-in solver, which needs nothing."
    )


def _from_variable() -> list[Path]:
    named = os.environ.get("WM_PROJECT_DIR")
    return [Path(named)] if named and (Path(named) / "etc" / "bashrc").is_file() else []


# Newest first, by the numbers in the folder's name.
def _from_folders(project_dirs: tuple[str, ...]) -> list[Path]:
    found = [
        path
        for pattern in project_dirs
        for path in Path("/").glob(pattern.lstrip("/"))
        if (path / "etc" / "bashrc").is_file()
    ]
    return sorted(found, key=lambda path: [int(digits) for digits in re.findall(r"\d+", path.name)], reverse=True)


# What etc/bashrc sets; in a function, because it would take the arguments of the shell for settings.
def _environment_of(project_dir: Path) -> dict[str, str]:
    script = 'settings() { . "$bashrc"; }; settings >/dev/null 2>&1; env -0'
    variables = {**os.environ, "bashrc": str(project_dir / "etc" / "bashrc")}
    result = subprocess.run(["bash", "-c", script], env=variables, capture_output=True, check=True)
    pairs = (entry.split("=", 1) for entry in result.stdout.decode(errors="replace").split("\0") if "=" in entry)
    return dict(pairs)  # pyright: ignore[reportArgumentType]


def read_wind(case: FoamCase) -> _FIELD_TYPE:
    """Return the wind of a case that has been run, (nx, ny, nz, 3) at cell centres [m/s], zero in solids."""
    cells = np.full((case.mesh.n_cells, 3), np.nan)
    for part in _parts(case):
        values = _read_vectors(_last_time(part) / case.field)
        cells[_cell_numbers(part, len(values))] = values
    if not np.isfinite(cells).all():
        raise FlowError(
            f"{case.folder}: expected a finite {case.field} in every cell, was missing or infinite in some."
        )
    velocity_m_s = np.zeros((*case.mesh.air.shape, 3), np.float32)
    velocity_m_s[case.mesh.air] = cells
    return velocity_m_s


def _parts(case: FoamCase) -> list[Path]:
    parts = [case.folder / f"processor{rank}" for rank in range(case.n_ranks)]
    return parts if case.n_ranks > 1 else [case.folder]


def _last_time(part: Path) -> Path:
    times = {float(path.name): path for path in part.iterdir() if re.fullmatch(r"[0-9.]+(e[+-]?\d+)?", path.name)}
    latest = max(times, default=0.0)
    if latest <= 0:
        raise FlowError(f"{part}: expected a folder named by the end of the solve [s], found none.")
    return times[latest]


# Which cells of the whole mesh the rows of a part are.
def _cell_numbers(part: Path, n: int) -> NDArray[np.int64]:
    path = part / "constant" / "polyMesh" / "cellProcAddressing"
    return _read_numbers(path, r"\n(\d+)\s*\(", np.int64) if path.is_file() else np.arange(n)


def _read_vectors(path: Path) -> NDArray[np.float64]:
    return _read_numbers(path, r"internalField\s+nonuniform\s+List<vector>\s+(\d+)\s*\(", np.float64, width=3)


# The list of numbers after its length, which `opening` finds, in text; parentheses around vectors are left out.
def _read_numbers(path: Path, opening: str, dtype: type, *, width: int = 1) -> NDArray:
    if not path.is_file():
        raise FlowError(f"{path}: expected OpenFOAM to have written it, was missing.")
    text = path.read_text(encoding="ascii", errors="replace")
    match = re.search(opening, text)
    if match is None:
        raise FlowError(f"{path}: expected a list in text (writeFormat ascii), found none.")
    n = int(match[1])
    end = text.find(")\n)" if width > 1 else ")", match.end())
    body = text[match.end() : end]
    numbers = np.fromstring(body.translate({ord("("): " ", ord(")"): " "}), dtype=dtype, sep=" ")
    if numbers.size != n * width:
        raise FlowError(f"{path}: expected {n * width} numbers, found {numbers.size}.")
    return numbers if width == 1 else numbers.reshape(n, width)


def run_case(case: FoamCase, installation: Installation, *, on_time: Callable[[float], None]) -> None:
    """Solve a case: cut its mesh into parts and let pimpleFoam run on them.

    Args:
        case: A written case that was not run yet.
        installation: OpenFOAM.
        on_time: Receives the flow's time [s] at each step.
    """
    solver = [installation.tool("pimpleFoam"), "-case", str(case.folder)]
    if case.n_ranks > 1:
        _run(case, installation, [installation.tool("decomposePar"), "-case", str(case.folder)])
        solver = [installation.tool("mpirun"), "-np", str(case.n_ranks), *solver, "-parallel"]
    _run(case, installation, solver, on_time=on_time)


def _run(
    case: FoamCase,
    installation: Installation,
    command: Sequence[str],
    *,
    on_time: Callable[[float], None] | None = None,
) -> None:
    name = "decomposePar" if on_time is None else "pimpleFoam"
    log = case.folder / f"log.{name}"
    last_lines: collections.deque[str] = collections.deque(maxlen=_N_LAST_LINES)
    process = subprocess.Popen(
        command,
        env=installation.environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    with _ended(process), log.open("w", encoding="utf-8") as lines:
        assert process.stdout is not None, "it is a pipe"
        for line in process.stdout:
            lines.write(line)
            last_lines.append(line)
            if on_time is not None and (match := _TIME.match(line)):
                on_time(float(match[1]))
        status = process.wait()
    if status != 0:
        raise FlowError(
            f"{name} failed with exit status {status}. The end of its log:\n{''.join(last_lines).rstrip()}\nLog: {log}"
        )


# Leaves no process behind, whatever ends the block: mpirun passes the signal on to its ranks.
@contextlib.contextmanager
def _ended(process: "subprocess.Popen[str]"):  # noqa: ANN202
    try:
        yield
    finally:
        if process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def solve_wind_openfoam(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    *,
    end_time_s: float,
    average_from_s: float | None = None,
    case_dir: Path | None = None,
    n_ranks: int = 2,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    courant: float = COURANT,
    progress: Callable[[float], None] | None = None,
) -> F32:
    """Compute the wind in a room with pimpleFoam; arguments not named here are those of `gslcosim.flow.solve_wind`.

    Args:
        free: (nx, ny, nz) True is air.
        cell_m: Edge of the cubic cells [m]; they are the cells of OpenFOAM's mesh.
        patches: Inlets of fixed velocity, outlets, moving and frictionless walls.
        end_time_s: How long the flow develops [s].
        average_from_s: Return the mean from this time on [s]; absent: the field at the end.
        case_dir: Where to write and keep the case, a new or empty folder; absent: a temporary one, removed when all
            went well.
        n_ranks: How many processes solve it.
        turbulence: k_epsilon or rng_k_epsilon with wall functions, smagorinsky or laminar.
        nu_m2_s: Kinematic viscosity [m2/s].
        courant: Largest Courant number of a step.
        progress: Called at each step with the fraction done, 0 to 1.

    Returns:
        (nx, ny, nz, 3) velocities at cell centres [m/s], float32, zero in solids.
    """
    installation = find_installation()
    folder = case_dir or Path(tempfile.mkdtemp(prefix="gslcosim-openfoam-"))
    try:
        case = write_case(
            free,
            cell_m,
            patches,
            folder,
            end_time_s=end_time_s,
            average_from_s=average_from_s,
            n_ranks=n_ranks,
            turbulence=turbulence,
            nu_m2_s=nu_m2_s,
            courant=courant,
        )
    except FlowError:
        if case_dir is None:
            remove_tree(folder)
        raise
    run_case(case, installation, on_time=lambda time_s: progress and progress(min(time_s / end_time_s, 1.0)))
    velocity_m_s = read_wind(case)
    if case_dir is None:
        remove_tree(folder)
    return velocity_m_s
