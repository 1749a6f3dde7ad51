"""Hashes of code: comments, docstrings and layout of the text do not count."""

import ast
import contextlib
import hashlib
from collections.abc import Sequence
from pathlib import Path

from gslcosim.base.extensions import RESULT_CODE_GROUP, list_registered
from gslcosim.base.files import replace_file
from gslcosim.base.kernel_cache import get_cache_root, get_code_roots

_CORE = ("gslcosim", "gslcosim_services")
# Packages beside gslcosim's own whose code computes the results of runs.
COMPUTING_PACKAGES = ("numpy", "numba", "llvmlite", "mujoco", "pydantic", "msgpack", "msgspec")
# Code that shows runs, or counts over them, decides no result.
_IRRELEVANT_FOLDERS = (
    "gslcosim/cli",
    "gslcosim/recordings",
    "gslcosim_services/recorder",
)
_DIGEST_BYTES = 16


def hash_result_code() -> str:
    """Return a hash that changes with any code that decides the results of a run."""
    own = [path for path in list_package_files(*_CORE) if not _name_in_package(path).startswith(_IRRELEVANT_FOLDERS)]
    return hash_code([*own, *list_registered_files()])


def list_registered_files() -> list[Path]:
    """Return the modules that extensions register as deciding results: their models, but not their figures."""
    return list_package_files(*(point.value.replace(".", "/") for point in list_registered(RESULT_CODE_GROUP)))


def _name_in_package(path: Path) -> str:
    for package, root in get_code_roots().items():
        if path.is_relative_to(root):
            return f"{package}/{path.relative_to(root).as_posix()}"
    raise ValueError(f"expected a file of {' or '.join(get_code_roots())}, was {path}")


def list_package_files(*parts: str) -> list[Path]:
    """Return the modules in folders, with all below them, and files; each part begins with a package's name.

    A folder with a trailing `/*` counts without the folders below it.
    """
    paths: list[Path] = []
    for part in parts:
        package, _, rest = part.removesuffix("/*").partition("/")
        path = get_code_roots()[package] / rest
        if path.is_dir():
            paths += sorted(path.glob("*.py") if part.endswith("/*") else path.rglob("*.py"))
        else:
            paths.append(path)
    return paths


def hash_code(paths: Sequence[Path]) -> str:
    """Return 32 hexadecimal digits that change with the code of any of the given modules of our packages.

    Parsing code takes a while, so the answer is cached for files with the same bytes.

    Args:
        paths: Python files in our packages; their order counts.
    """
    contents = [(_name_in_package(path), path.read_bytes()) for path in paths]
    raw = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for name, content in contents:
        raw.update(f"{name}:{len(content)}:".encode())
        raw.update(content)
    kept = get_cache_root() / "code" / raw.hexdigest()
    try:
        answer, check = kept.read_text(encoding="ascii").split()
        if check == _check_answer(kept.name, answer):
            return answer
    except (OSError, ValueError):
        pass
    answer = _hash_syntax(contents)
    # Without a writable cache only time is lost.
    with contextlib.suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        replace_file(kept.parent, kept.name, f"{answer} {_check_answer(kept.name, answer)}".encode())
    return answer


def _check_answer(question: str, answer: str) -> str:
    return hashlib.blake2b(f"{question} {answer}".encode(), digest_size=_DIGEST_BYTES).hexdigest()


def _hash_syntax(contents: Sequence[tuple[str, bytes]]) -> str:
    digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for name, content in contents:
        digest.update(name.encode())
        digest.update(ast.dump(_drop_docstrings(ast.parse(content))).encode())
    return digest.hexdigest()


def _drop_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
            node.body = node.body[1:]
    return tree
