"""Checksums of the files in a folder, by which readers refuse files that were changed or damaged.

`checksums.json` has a BLAKE2b hash of each file, a hash of itself, and a signature with the key of the cache (see
`kernel_cache`). The hashes find damage in a folder of any origin. The signature distinguishes a folder of this cache
from a foreign one, whose content proves nothing about its origin.
"""

import contextlib
import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import cast

from gslcosim.base.errors import describe_os_error
from gslcosim.base.files import open_regular_file, replace_file
from gslcosim.base.kernel_cache import is_signed, sign
from gslcosim.base.untrusted_input import FROM_A_COPY, JsonObject, MalformedFileError, read_json

CHECKSUMS_FILE = "checksums.json"
_DIGEST_BYTES = 16
_MAX_BYTES = 1_000_000
_BLOCK_BYTES = _MIN_KEPT_BYTES = 1 << 20


def write_checksums(folder: Path, *names: str, place: str = "", written: Mapping[str, Path] | None = None) -> None:
    """Write the checksums of files, beside the existing ones of others.

    Args:
        folder: Folder of the files.
        names: Names of the files.
        place: The folder's final name, if it has a temporary one now.
        written: Paths of files that are about to be moved to one of `names`.
    """
    path, files, place = folder / CHECKSUMS_FILE, dict[str, str](), place or folder.name
    is_ours = True
    # A damaged file of checksums is replaced, and those of other files are lost.
    with contextlib.suppress(MalformedFileError):
        if path.is_file():
            files, signature = _read(path)
            # Foreign hashes get no signature of ours.
            is_ours = is_signed(place, _body_of(files), signature, path)
    for name in names:
        found = _hash_file((written or {}).get(name, folder / name))
        # The machine may stop between writing this file and that one, so the previous hash stays valid.
        files[name] = " ".join([found, *files.get(name, "").split()][:2])
    body = _body_of(files)
    content = {
        "files": files,
        "check": _hash(body),
        "signature": ((sign(place, body) if is_ours else None) or b"").hex(),
    }
    replace_file(folder, CHECKSUMS_FILE, (json.dumps(content, indent=1) + "\n").encode())


def check_files(folder: Path, *names: str) -> bool:
    """Compare files with the checksums of their folder, if it has any.

    Args:
        folder: Folder of the files.
        names: Names of the files; missing ones do not count.

    Returns:
        True if all have a checksum, and the checksums are signed with the key of the cache.
    """
    path = folder / CHECKSUMS_FILE
    if not path.is_file():
        return False
    files, signature = _read(path)
    present = [name for name in names if (folder / name).is_file()]
    for name in present:
        try:
            is_as_written = name not in files or _hash_file(folder / name) in files[name].split()
        except OSError as error:
            raise MalformedFileError(
                f"{folder.name}/{name}: expected a file that can be read, was {describe_os_error(error)}. {FROM_A_COPY}"
                f"\nFile: {folder / name}"
            ) from error
        if not is_as_written:
            raise _build_error(folder / name)
    return files.keys() >= set(present) and is_signed(folder.name, _body_of(files), signature, path)


def _read(path: Path) -> tuple[dict[str, str], bytes]:
    content = read_json(path, JsonObject, max_bytes=_MAX_BYTES)
    files = content.get("files")
    try:
        signature = bytes.fromhex(str(content.get("signature")))
    except ValueError as error:
        raise _build_error(path) from error
    if not isinstance(files, dict) or _hash(_body_of(files)) != content.get("check"):
        raise _build_error(path)
    return {name: str(found) for name, found in cast("dict[str, object]", files).items()}, signature


def _build_error(path: Path) -> MalformedFileError:
    return MalformedFileError(
        f"{path.parent.name}/{path.name}: expected the file as it was written, was changed since. "
        f"Take it from a copy, or remove {CHECKSUMS_FILE} to read it as it is.\nFile: {path}"
    )


def _body_of(files: Mapping[str, object]) -> bytes:
    return json.dumps(files, sort_keys=True).encode()


def _hash(body: bytes) -> str:
    return hashlib.blake2b(body, digest_size=_DIGEST_BYTES).hexdigest()


# A process that reads a large room repeatedly hashes it once, until the file changes.
def _hash_file(path: Path) -> str:
    status = path.stat()
    if status.st_size < _MIN_KEPT_BYTES:
        return _hash_content(path)
    return _hash_once(path, status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)


@lru_cache(maxsize=1024)
def _hash_once(path: Path, *_: int) -> str:
    return _hash_content(path)


def _hash_content(path: Path) -> str:
    with open_regular_file(path) as file:
        digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
        while block := file.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()
