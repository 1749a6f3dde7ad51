"""Names of search methods in lists, tables and titles, from what starts an agent."""

from collections.abc import Iterable, Sequence
from pathlib import PurePath

ATTACHED = "attached"
_GENERIC = frozenset({"agent", "main", "method"})
# Folders on the way from a project to what was built of it.
_BUILD_FOLDERS = frozenset({"bin", "build", "debug", "dist", "release", "src", "target"})
_SCRIPTS = frozenset({".jar", ".java", ".jl", ".js", ".lua", ".m", ".mjs", ".pl", ".py", ".r", ".rb", ".sh", ".ts"})


def name_method(*, python: str | None = None, command: Sequence[str] = (), method: str | None = None) -> str:
    """Return the name of the method of an agent that is started so, or attaches itself.

    A bundled agent has its own name and a program that of its file, without its ending. Files called `agent` or `main`
    and cards are named after their folder. An interpreter with a script has the name of the script.
    """
    if method:
        return method
    if python:
        return _name_file(python)
    return _name_file(_find_program(command)) if command else ATTACHED


def join_methods(methods: Iterable[str]) -> str:
    """Return the methods of several agents, each once, with `+` between them."""
    return "+".join(dict.fromkeys(method for method in methods if method))


def _find_program(command: Sequence[str]) -> str:
    first, *arguments = command
    return next((word for word in arguments if PurePath(word).suffix.lower() in _SCRIPTS), first)


def _name_file(file: str) -> str:
    path = PurePath(file)
    if path.stem not in _GENERIC:
        return path.stem
    folders = (folder.name for folder in path.parents)
    return next((name for name in folders if name and name not in _GENERIC | _BUILD_FOLDERS | {".."}), path.stem)
