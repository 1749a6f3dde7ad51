"""OpenFOAM installations on this machine, however packaged."""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import FlowError

TOOLS = ("pimpleFoam", "decomposePar", "mpirun")

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

    Raises:
        FlowError: there is none; the message says where it was looked for and how to install it.
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
