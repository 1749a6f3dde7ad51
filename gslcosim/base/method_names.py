"""Names of search methods in lists, tables and titles, from the start of an agent."""

from collections.abc import Iterable, Sequence
from pathlib import PurePath

ATTACHED = "attached"
_GENERIC = frozenset({"agent", "main", "method"})
# Folders between a project and its build products.
_BUILD_FOLDERS = frozenset({"bin", "build", "debug", "dist", "release", "src", "target"})
_SCRIPTS = frozenset({".jar", ".java", ".jl", ".js", ".lua", ".m", ".mjs", ".pl", ".py", ".r", ".rb", ".sh", ".ts"})


def name_method(*, python: str | None = None, command: Sequence[str] = (), method: str | None = None) -> str:
    """Return the name of an agent's method from the start of the agent; `attached` if there is none.

    A bundled agent has its own name and a program that of its file, without its ending. Files called `agent` or `main`
    and cards are named after their folder. An interpreter with a script has the name of the script.
    """
    if method:
        return method
    if python:
        return _name_file(python)
    if not command:
        return ATTACHED
    scripts = (word for word in command[1:] if PurePath(word).suffix.lower() in _SCRIPTS)
    return _name_file(next(scripts, command[0]))


def join_methods(methods: Iterable[str]) -> str:
    """Return the methods of several agents, each once, with `+` between them."""
    return "+".join(dict.fromkeys(method for method in methods if method))


def _name_file(file: str) -> str:
    path = PurePath(file)
    if path.stem not in _GENERIC:
        return path.stem
    folders = (folder.name for folder in path.parents)
    return next((name for name in folders if name and name not in _GENERIC | _BUILD_FOLDERS | {".."}), path.stem)
