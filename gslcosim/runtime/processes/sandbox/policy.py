"""Policy of a sandbox: the files and sockets that one process may see and change."""

import contextlib
import os
import shutil
import site
import stat
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import gslcosim
from gslcosim.base.bundled import bundled_agents, bundled_folder
from gslcosim.base.extension_packages import find_extension_packages
from gslcosim.base.files import user_state_folder
from gslcosim.base.kernel_cache import NUMBA_VARIABLE, get_cache_root, get_key_path
from gslcosim.runtime.status import get_status_folder

# Read-only for every agent, where they exist.
SYSTEM_FOLDERS = (
    "/usr",
    "/bin",
    "/sbin",
    "/lib",
    "/lib32",
    "/lib64",
    "/libx32",
    "/etc",
    "/opt",
    "/nix",
    "/sys/devices/system",
)
_OPTIONAL = "/opt"
# Folders in which the system and installed programs keep files that not every user may read, such as keys.
_CONFIGURED = ("/etc", "/usr/local", _OPTIONAL)
# Libraries of programs, thousands of files that every user may read; these folders are searched only in /etc.
_LIBRARIES = frozenset(("bin", "sbin", "lib", "lib32", "lib64", "libexec", "include", "share", "src", "pkgs"))


@dataclass(frozen=True, kw_only=True)
class SandboxPolicy:
    """Files and sockets that one process may see and change.

    The paths `hidden` lie within `reads`, and are not visible. `sockets` are the unix sockets of the transport,
    `tcp_port` is its TCP port. `scratch` is a private folder on the disk for sandboxes that have none in memory.
    """

    directory: Path
    reads: tuple[Path, ...]
    hidden: tuple[Path, ...] = ()
    writes: tuple[Path, ...] = ()
    sockets: tuple[Path, ...] = ()
    tcp_port: int | None = None
    scratch: Path


def find_own_folders(command: Sequence[str], directory: Path) -> list[Path]:
    """Return the folders that a command line names, and those of the files that it names, its program among them.

    A program in a `bin` brings the folder around it, where its libraries are.
    """
    return list(find_named_files(command, directory))


def find_named_files(command: Sequence[str], directory: Path) -> dict[Path, list[Path]]:
    """Return the files that a command line names, by the folders of `find_own_folders`."""
    found: dict[Path, list[Path]] = {}
    program = shutil.which(command[0]) if "/" not in command[0] else str(directory / command[0])
    for place in _add_link_target(Path(program)) if program is not None else ():
        folder = place.parent
        is_installed = folder.name == "bin" and folder.parent not in (Path.home(), Path("/"))
        found.setdefault(folder.parent if is_installed else folder, []).append(place)
    for word in command[1:]:
        # `--option=path` names one too, and `-cp here:there` several.
        for text in dict.fromkeys((word, word.partition("=")[2], *word.split(os.pathsep))):
            name = text.removesuffix("/*")  # so Java names all archives of a folder
            place = directory / name if name and len(name) < 4096 and "\0" not in name else None
            if place is not None and _is_file(place):
                for each in _add_link_target(place):
                    found.setdefault(each.parent, []).append(each)
            elif place is not None and _is_separate_folder(place):
                for each in _add_link_target(place):
                    found.setdefault(each, [])
    return {folder: named for folder, named in found.items() if not is_system_path(folder)}


def list_python_folders() -> list[Path]:
    """Return the folders from which this Python imports, gslcosim's own and those of its extensions."""
    paths = sysconfig.get_paths()
    named = [sys.prefix, sys.base_prefix, *(paths[key] for key in ("stdlib", "platstdlib", "purelib", "platlib"))]
    named += [*site.getsitepackages(), site.getusersitepackages()]
    named += [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    # Beside packages stand folders that a .pth file has added; the working directory is none of them.
    named += [entry for entry in sys.path if Path(entry).name in ("site-packages", "dist-packages")]
    folders = [Path(name) for name in named]
    folders += [Path(gslcosim.__file__).parent, *find_extension_packages().values()]
    folders += [path.parent.parent for path in bundled_agents().values()]
    for folder in (Path(sys.prefix), Path(sys.base_prefix)):
        folders += [place.parent.parent for place in _add_link_target(folder / "bin" / "python3") if place.exists()]
    return [folder for folder in dict.fromkeys(folders) if folder.is_dir() and not is_system_path(folder)]


def list_code_folders() -> list[Path]:
    """Return the folders from which processes of every run read code, which no agent may change."""
    kernels = [Path(os.environ[NUMBA_VARIABLE])] if NUMBA_VARIABLE in os.environ else []
    return [
        *list_python_folders(),
        *_list_caches(),
        *kernels,
        *(Path(folder) for folder in SYSTEM_FOLDERS if folder != _OPTIONAL),
    ]


def list_hidden_folders() -> list[Path]:
    """Return the folders that no agent sees, wherever they lie.

    Bundled scenarios, the cache, the user's state, and the folders of sockets at which only processes outside of
    sandboxes may send requests.
    """
    return [bundled_folder("."), *_list_caches(), user_state_folder(), get_status_folder()]


# The process that started this one may keep its kernels in another cache, with the key that signs them.
def _list_caches() -> list[Path]:
    return list(dict.fromkeys((get_cache_root(), get_key_path().parent)))


@cache
def list_private_system_paths(folders: Sequence[str] = _CONFIGURED) -> tuple[Path, ...]:
    """Return the paths of the system that this user, such as root, may read, but not every user: no agent sees them."""
    found: list[Path] = []
    unseen = [Path(folder) for folder in folders]
    while unseen:
        folder = unseen.pop()
        with contextlib.suppress(OSError):
            for entry in os.scandir(folder):
                is_folder = entry.is_dir(follow_symlinks=False)
                needed = stat.S_IROTH | stat.S_IXOTH if is_folder else stat.S_IROTH
                if entry.is_symlink() or (folder.parts[1] != "etc" and entry.name in _LIBRARIES):
                    continue
                if entry.stat(follow_symlinks=False).st_mode & needed == needed:
                    unseen += [Path(entry.path)] if is_folder else []
                elif os.access(entry.path, os.R_OK) or os.access(entry.path, os.X_OK):
                    found.append(Path(entry.path))
    return tuple(found)


def is_system_path(path: Path) -> bool:
    """Return whether a place is part of the system, which every agent reads; people keep their own things in /opt."""
    return any(path.is_relative_to(folder) for folder in SYSTEM_FOLDERS if folder != _OPTIONAL)


def split_readable_paths(cell: SandboxPolicy) -> tuple[list[Path], list[Path]]:
    """Return what may be read, and what may be listed, where nothing within a folder can be taken from it again.

    A folder with something hidden in it is read by its other entries. Only names can be seen then. All are real places,
    for what is allowed is the place to which a link leads: a link in such a folder is none.
    """
    reads: list[Path] = []
    lists: list[Path] = []
    hidden = {path.resolve() for path in cell.hidden}
    for folder in dict.fromkeys(path.resolve() for path in cell.reads):
        _add_readable_paths(folder, [path for path in hidden if path.is_relative_to(folder)], reads, lists)
    # Python finds a package by the names in the folder that has it, and a module too: packages of an editable
    # installation and files of a shared folder stand alone.
    alone = [package for package in find_extension_packages().values() if package in reads]
    alone += [path for path in reads if path.is_file()]
    return reads, list(dict.fromkeys((*lists, *(path.parent for path in alone))))


def _add_readable_paths(folder: Path, hidden: list[Path], reads: list[Path], lists: list[Path]) -> None:
    if folder in hidden:
        return
    if not hidden:
        reads.append(folder)
        return
    lists.append(folder)
    for entry in sorted(entry for entry in folder.iterdir() if not entry.is_symlink()):
        _add_readable_paths(entry, [path for path in hidden if path.is_relative_to(entry)], reads, lists)


def _add_link_target(path: Path) -> list[Path]:
    return list(dict.fromkeys((path.absolute(), path.resolve())))


# A word such as `/` or `..` is no place that an agent was given.
def _is_separate_folder(path: Path) -> bool:
    try:
        around = (Path.home(), *Path.home().parents, *Path.cwd().parents, *Path(tempfile.gettempdir()).parents)
        return path.is_dir() and path.resolve() not in (*around, Path(tempfile.gettempdir()))
    except (OSError, RuntimeError):
        return False


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False
