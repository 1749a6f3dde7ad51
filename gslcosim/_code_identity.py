"""What code says, as a hash: comments, docstrings and layout of the text do not count."""

import ast
import hashlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from gslcosim._kernel_cache import PACKAGE_DIR, cache_root

# Beside gslcosim's own code, what computes flights.
COMPUTING_PACKAGES = ("numpy", "numba", "llvmlite", "mujoco", "pydantic", "msgpack", "msgspec")
# Code that shows flights, or counts over them, decides none.
_NO_MATTER = (
    "cli",
    "benchmark/report",
    "benchmark/statistics",
    "benchmark/tuning",
    "recording",
    "conformance",
    "contract/publish",
)
_DIGEST_BYTES = 16


def deciding_code_hash() -> str:
    """Return what changes when any code of the package does that decides what comes of a flight."""
    return code_hash([path for path in sorted(PACKAGE_DIR.rglob("*.py")) if not _is_idle(path)])


def _is_idle(path: Path) -> bool:
    return path.relative_to(PACKAGE_DIR).as_posix().startswith(_NO_MATTER)


def package_files(*parts: str) -> list[Path]:
    """Return the modules of the package in folders, with all below them, and files; each part from the package on.

    A folder with a trailing `/*` counts without the folders below it.
    """
    paths: list[Path] = []
    for part in parts:
        path = PACKAGE_DIR / part.removesuffix("/*")
        if path.is_dir():
            paths += sorted(path.glob("*.py") if part.endswith("/*") else path.rglob("*.py"))
        else:
            paths.append(path)
    return paths


def code_hash(paths: Sequence[Path]) -> str:
    """Return 32 hexadecimal digits that change when the code of any of some modules of the package does.

    Reading the text of code takes a while, so the answer is kept for files with the same bytes.

    Args:
        paths: Files of Python in the package; their order counts.
    """
    contents = [(path.relative_to(PACKAGE_DIR).as_posix(), path.read_bytes()) for path in paths]
    raw = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for name, content in contents:
        raw.update(f"{name}:{len(content)}:".encode())
        raw.update(content)
    kept = cache_root() / "code" / raw.hexdigest()
    try:
        return kept.read_text(encoding="ascii")
    except OSError:
        said = _said(contents)
        _keep(kept, said)
        return said


def _said(contents: Sequence[tuple[str, bytes]]) -> str:
    digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for name, content in contents:
        digest.update(name.encode())
        digest.update(ast.dump(_without_docstrings(ast.parse(content))).encode())
    return digest.hexdigest()


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
            node.body = node.body[1:]
    return tree


# Whole or not at all; a cache that cannot be written to costs time and nothing else.
def _keep(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "w", encoding="ascii") as file:
            file.write(text)
        Path(name).replace(path)
    except OSError:
        return
