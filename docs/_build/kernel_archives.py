"""Compiled kernels for wheels: `make dist` writes an archive into each package, for each level of processors.

Each level has a cache of its own, in which the kernels of all bundled scenarios and agents are compiled by flying them;
so a level that this processor lacks is left out, with a line that says so.
"""

import io
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from gslcosim.base import kernel_archives as archives
from gslcosim.base.kernel_cache import (
    EXTENSIONS_VARIABLE,
    NUMBA_VARIABLE,
    OWNER_VARIABLE,
    PROCESSOR_LEVELS,
    PROCESSOR_VARIABLE,
    build_processor_variables,
    get_extensions_hash,
    read_signed,
)

OURS = (NUMBA_VARIABLE, OWNER_VARIABLE, EXTENSIONS_VARIABLE)


def build_archives(level: str) -> None:
    """Compile all kernels for a level in a cache of its own, and let a process there pack them."""
    plain = {name: text for name, text in os.environ.items() if name not in OURS}
    with tempfile.TemporaryDirectory() as cache:
        variables = plain | build_processor_variables(level) | {"GSLCOSIM_CACHE": cache}
        for command in (("-m", "gslcosim", "cache", "compile"), (__file__, "pack")):
            subprocess.run([sys.executable, *command], env=variables, check=True)


def pack() -> list[Path]:
    """Write the archive of each package that has kernels from what the cache has of them, and return all.

    Other archives for this Python and this level of processors are removed.
    """
    return [_pack(package) for package in archives.list_packages()]


def _pack(package: str) -> Path:
    folder, archive = Path(os.environ[NUMBA_VARIABLE]), archives.get_archive_path(package)
    files = [path for path in sorted(folder.glob("*/*.nb[ic]")) if _is_of(package, path.parent.name)]
    _, _, kind = archive.name.partition(sys.implementation.cache_tag or "")
    for old in archive.parent.glob(f"*{sys.implementation.cache_tag}{kind}"):
        old.unlink()
    archive.parent.mkdir(exist_ok=True)
    with tarfile.open(archive, "w:xz") as members:
        for path in files:
            if (body := read_signed(str(path))) is not None:
                member = tarfile.TarInfo(str(path.relative_to(folder)))
                member.size = len(body)
                members.addfile(member, io.BytesIO(body))
    return archive


def _is_of(package: str, folder_name: str) -> bool:
    # As `get_kernels_folder_name` names it: PACKAGE.PART, with _HASH for an extension.
    ending = get_extensions_hash(package)
    plain = folder_name.removesuffix(f"_{ending}") if ending else folder_name
    return plain.split(".")[0] == package and (not ending or plain != folder_name)


if __name__ == "__main__":
    if sys.argv[1:] == ["pack"]:
        for packed in pack():
            print(f"{packed.relative_to(Path.cwd())}: {packed.stat().st_size / 1e6:.2f} MB")
    else:
        levels = list(PROCESSOR_LEVELS)
        here = levels.index(os.environ[PROCESSOR_VARIABLE]) if os.environ.get(PROCESSOR_VARIABLE) in levels else -1
        for missing in levels[here + 1 :]:
            print(f"{missing}: left out, this processor lacks it; wheels compile its kernels on first use")
        for each in levels[: here + 1]:
            build_archives(each)
