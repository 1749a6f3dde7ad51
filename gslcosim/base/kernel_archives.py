"""Archives of compiled kernels in our packages: made when a wheel is built, moved into the cache on first use.

An archive has the files of one package for one version of Python and one level of processors. Its name has the
hash of the kernels, so that a package whose code was changed since has none. Its contents are not signed: it is as
trustworthy as the code beside it.
"""

import contextlib
import io
import os
import sys
import tarfile
from pathlib import Path

from gslcosim.base.extension_packages import find_extension_packages
from gslcosim.base.files import hold_lock
from gslcosim.base.kernel_cache import (
    NUMBA_VARIABLE,
    PROCESSOR_VARIABLE,
    get_code_roots,
    get_extensions_hash,
    get_mark_path,
    is_trusted,
    read_signed,
    write_signed,
)

_FOLDER = "compiled"


def get_archive_path(package: str) -> Path:
    """Return the place of a package's archive for this Python, this level of processors, and its code as it is."""
    core = Path(os.environ[NUMBA_VARIABLE]).name.partition("-")[0]
    level = os.environ.get(PROCESSOR_VARIABLE, "native")
    name = ".".join(filter(None, (core, get_extensions_hash(package), sys.implementation.cache_tag, level, "tar.xz")))
    return get_code_roots()[package] / _FOLDER / name


def has_all_archives() -> bool:
    """Return whether the kernels of all our packages that have some came from archives."""
    return all(_get_mark(package).exists() for package in _list_packages())


def unpack_archives() -> None:
    """Move the kernels of all archives into the cache, signed, unless that was done before.

    Kernels that are there already stay. A cache that cannot be written is left as it is.
    """
    for package in _list_packages():
        archive, mark = get_archive_path(package), _get_mark(package)
        if not archive.is_file() or mark.exists():
            continue
        with contextlib.suppress(OSError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            with hold_lock(mark.with_suffix(".lock")):
                if not mark.exists() and is_trusted(archive.stat()):
                    _unpack(archive, mark.parents[1])
                    mark.touch()


def _list_packages() -> list[str]:
    extensions = find_extension_packages()
    return [name for name in get_code_roots() if name not in extensions or get_extensions_hash(name)]


def _get_mark(package: str) -> Path:
    return get_mark_path(package, get_extensions_hash(package))


def _unpack(archive: Path, folder: Path) -> None:
    with tarfile.open(archive) as members:
        for member in members:
            place = folder / member.name
            if (content := members.extractfile(member)) is None or place.exists():
                continue
            place.parent.mkdir(exist_ok=True)
            write_signed(str(place), content.read())


def pack_archives() -> list[Path]:
    """Write the archive of each of our packages with kernels from what the cache has of them, and return all.

    Other archives for this Python and this level of processors are removed.
    """
    return [_pack(package) for package in _list_packages()]


def _pack(package: str) -> Path:
    folder, archive = Path(os.environ[NUMBA_VARIABLE]), get_archive_path(package)
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
