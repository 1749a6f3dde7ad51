"""Program checks: whether the programs of agents and participants exist, and whether Python files can be parsed."""

import ast
import os
import shutil
import sys
import warnings
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import cast

from gslcosim.base.bundled import CARD_FILE, PROGRAM_ENDINGS, bundled_agents, find_bundled_agent
from gslcosim.base.errors import MethodError
from gslcosim.base.extensions import find_remedy, list_absent_modules
from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem
from gslcosim.base.scenario_keys import list_file_keys
from gslcosim.methods.card import MethodCard, load_card
from gslcosim.scenario.problems import child_path, did_you_mean

SCRIPT_ENDINGS = (".py", ".js", ".mjs", ".rb", ".pl", ".lua", ".jl", ".sh", ".m", ".jar", ".php", ".R")
"""Endings by which the second word of a command is recognised as a file."""

# Keys of a scenario whose texts, alone or in a list, name files or folders.
_PATH_KEYS = ("python", "command", "may_read", "may_write")
# Linux's limits, less room for the folder in front.
_MAX_NAME_BYTES, _MAX_PATH_LENGTH = 255, 3000
# First bytes of a program of Linux, and those with its kind of processor; some processors run another kind too.
_ELF, _MACHINE_AT = b"\x7fELF", slice(18, 20)
_ALSO = {b"\x3e\x00": b"\x03\x00", b"\xb7\x00": b"\x28\x00"}
# Folder with the registered interpreters of other kinds of files.
_TAKEN_ON = Path("/proc/sys/fs/binfmt_misc")
_EXECUTABLE_BITS = 0o111
# Linux reads no more of a first line.
_MAX_FIRST_LINE_BYTES = 256


def find_unusable_paths(values: object, path: str = "") -> Iterator[Problem]:
    """Yield the problem of each path in a scenario's plain values that no file can have.

    A search for such a file raises an error of the system instead of finding none.
    """
    if isinstance(values, list):
        for i, value in enumerate(cast("list[object]", values)):
            yield from find_unusable_paths(value, child_path(path, i))
    if not isinstance(values, dict):
        return
    for key, value in cast("dict[str, object]", values).items():
        place = child_path(path, key)
        if key not in _PATH_KEYS and key not in list_file_keys():
            # An agent's parameters have a meaning for the agent alone.
            if key != "parameters":
                yield from find_unusable_paths(value, place)
            continue
        listed = cast("list[object]", value) if isinstance(value, list) else []
        texts: list[tuple[str, object]] = [
            (place, cast("object", value)),
            *((child_path(place, i), item) for i, item in enumerate(listed)),
        ]
        for at, text in texts:
            is_argument = key == "command" and not at.endswith("[0]")
            if isinstance(text, str) and (found := _why_no_path(text, is_argument=is_argument)):
                yield Problem(where=at, expected="a path that a file can have", found=found)


def _why_no_path(text: str, *, is_argument: bool) -> str:
    if "\0" in text:
        return "one with the character U+0000"
    if is_argument and not text.endswith(SCRIPT_ENDINGS):
        return ""
    longest = max(len(part.encode(errors="replace")) for part in text.split("/"))
    if longest > _MAX_NAME_BYTES or len(text) > _MAX_PATH_LENGTH:
        return f"one of {len(text)} characters"
    try:
        Path(text).expanduser()
    except RuntimeError:
        return f"'{text[:_MAX_NAME_BYTES]}', the home of a user that there is not"
    return ""


def find_python_problem(name_or_file: str, *, directory: Path, path: str) -> Problem | None:
    """Return the problem of `start.python`, or None if the agent's file exists and is Python, or a card."""
    file = (directory / name_or_file).resolve()
    if file.is_file():
        return _find_syntax_problem(file, name_or_file, path) or _find_absent_import(file, name_or_file, path)
    if (bundled := find_bundled_agent(name_or_file)) is not None:
        return _find_absent_import(bundled, name_or_file, path)
    if "/" in name_or_file or name_or_file.endswith(PROGRAM_ENDINGS):
        return Problem(where=path, expected="a Python file", found=f"'{name_or_file}'", remedy=f"There is no {file}.")
    beside = f"{name_or_file}.py"
    is_beside = (directory / beside).is_file()
    return Problem(
        where=path,
        expected="a bundled agent (`gslcosim list` names them) or a file like ./my_agent.py",
        found=f"'{name_or_file}'",
        remedy=f"Did you mean ./{beside}?" if is_beside else did_you_mean(name_or_file, bundled_agents()),
    )


def find_command_problem(command: tuple[str, ...], *, directory: Path, path: str) -> Problem | None:
    """Return the problem of `start.command`, or None if its program, and the script that it may name, exist.

    Args:
        command: Program and arguments; a program with a slash is relative to `directory`, others are on the PATH.
        directory: The scenario's folder, where the program starts.
        path: The place in the scenario.
    """
    found = f"'{command[0]}'"
    place = child_path(path, 0)
    if "/" not in command[0]:
        if (where := shutil.which(command[0])) is None:
            is_beside = (directory / command[0]).is_file()
            remedy = f"Did you mean ./{command[0]}?" if is_beside else "Is it installed?"
            expected = "a program on the PATH, or a path like ./my_agent"
            return Problem(where=place, expected=expected, found=found, remedy=remedy)
        file = Path(where)
    elif not (file := (directory / command[0]).resolve()).is_file():
        return Problem(where=place, expected="a program", found=found, remedy=f"There is no {file}.")
    elif not os.access(file, os.X_OK):
        is_mounted_so = file.stat().st_mode & _EXECUTABLE_BITS != 0
        remedy = f"The file system of {file} is mounted noexec." if is_mounted_so else f"Run: chmod +x {file}"
        return Problem(where=place, expected="a program that may be executed", found=found, remedy=remedy)
    return _problem_of_interpreter(file, directory, place, found) or _problem_of_script(command, directory, path)


def find_neighbour_problems(card: MethodCard, directory: Path) -> Iterator[Problem]:
    """Yield a problem for each Python file beside a method's card that cannot be parsed."""
    del card
    for file in sorted(directory.glob("*.py")):
        if problem := _find_syntax_problem(file.resolve(), file.name, ""):
            yield problem


# A script names its interpreter in its first line; without it the system reports only "no such file".
def _problem_of_interpreter(file: Path, directory: Path, place: str, found: str) -> Problem | None:
    try:
        with file.open("rb") as program:
            line = program.readline(_MAX_FIRST_LINE_BYTES)
    except OSError:
        return None  # an executable file need not be readable
    if not line.startswith(b"#!"):
        return _problem_of_format(file, line, place, found)
    words = line[2:].strip(b" \t\n").decode(errors="replace").split()
    interpreter = words[0] if words else ""
    missing, remedy = interpreter, f"Install it, or correct the first line of {file}."
    if interpreter.endswith("/env") and os.access(interpreter, os.X_OK):
        asked = next((word for word in words[1:] if not word.startswith("-") and "=" not in word), "")
        missing = "" if not asked or shutil.which(asked) else asked
    elif (directory / interpreter).is_file() and os.access(directory / interpreter, os.X_OK):
        missing = ""
    elif not interpreter:
        missing, remedy = "nothing", f"Name one in the first line of {file}, for example #!/bin/sh."
    if line.endswith(b"\r\n"):
        missing = missing or interpreter
        remedy = f"The lines of {file} end as on Windows; run: sed -i 's/\\r$//' {file}"
    if not missing:
        return None
    expected = "a script whose interpreter is there"
    return Problem(where=place, expected=expected, found=f"{found} with #!{' '.join(words)}", remedy=remedy)


# Programs that the system cannot execute, by their first bytes, unless interpreters of other kinds are registered.
def _problem_of_format(file: Path, beginning: bytes, place: str, found: str) -> Problem | None:
    if sys.platform != "linux" or {*_names_in(_TAKEN_ON)} - {"register", "status"}:
        return None
    if not beginning.startswith(_ELF):
        expected = "a program, or a script that names its interpreter"
        remedy = f"Name that in the first line of {file}, for example #!/bin/sh, or before it in the command."
        return Problem(where=place, expected=expected, found=found, remedy=remedy)
    kind = beginning[_MACHINE_AT]
    with Path("/proc/self/exe").open("rb") as program:
        own = program.read(_MACHINE_AT.stop)[_MACHINE_AT]
    if kind == own or kind == _ALSO.get(own):
        return None
    return Problem(
        where=place,
        expected=f"a program for this machine's processor ({os.uname().machine})",
        found=found,
        remedy=f"{file} was built for another one: build it here.",
    )


def _names_in(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in folder.iterdir()]
    except OSError:
        return []


def _problem_of_script(command: tuple[str, ...], directory: Path, path: str) -> Problem | None:
    program, script = (*command, "")[:2]
    if not script.endswith(SCRIPT_ENDINGS):
        return None
    if (file := (directory / script).resolve()).is_file():
        found = shutil.which(program) if "/" not in program else str(directory / program)
        # Other versions of Python have other grammars.
        is_this_python = found is not None and Path(found).resolve() == Path(sys.executable).resolve()
        is_parsed = script.endswith(".py") and is_this_python
        return _find_syntax_problem(file, script, child_path(path, 1)) if is_parsed else None
    remedy = f"There is no {(directory / script).resolve()}."
    return Problem(where=child_path(path, 1), expected="a file", found=f"'{script}'", remedy=remedy)


def _find_syntax_problem(file: Path, written: str, path: str) -> Problem | None:
    try:
        stat = file.stat()
        found = _describe_syntax_error(file, stat.st_mtime_ns, stat.st_size)
    except (OSError, MethodError):
        return None  # the agent's process may be allowed to read what the user is not; another check reads cards
    if not found:
        return None
    expected = "a card that names a program" if file.name == CARD_FILE else "a Python file that can be parsed"
    return Problem(where=path, expected=expected, found=f"'{written}'", remedy=found)


def _find_absent_import(file: Path, written: str, path: str) -> Problem | None:
    absent = list_absent_modules()
    if not absent:
        return None
    try:
        imported = _list_imports(file, file.stat().st_mtime_ns)
    except (OSError, SyntaxError, ValueError, MethodError):
        return None  # another check reports it
    module = next((module for module in absent if module in imported), None)
    if module is None:
        return None
    return Problem(
        where=path,
        expected="an agent whose imports are installed",
        found=f"'{written}', which imports {module}",
        remedy=find_remedy("modules", module) or "",
    )


@lru_cache(maxsize=256)
def _list_imports(file: Path, changed_ns: int) -> frozenset[str]:
    del changed_ns
    if file.name == CARD_FILE:
        return frozenset({(load_card(file).program or "").partition(":")[0].partition(".")[0]})
    nodes = list(ast.walk(ast.parse(read_regular_file(file), str(file))))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module and not node.level]
    return frozenset(name.partition(".")[0] for name in names)


# A suite starts the same few files in thousands of trials.
@lru_cache(maxsize=256)
def _describe_syntax_error(file: Path, changed_ns: int, n_bytes: int) -> str:
    del changed_ns, n_bytes
    if file.name == CARD_FILE:
        return "" if load_card(file).program else f"Add program: module:Class to {file}."
    try:
        with warnings.catch_warnings(action="ignore"):
            ast.parse(read_regular_file(file), str(file))
    except SyntaxError as error:
        place = f"{file}:{error.lineno}" if error.lineno else str(file)
        return f"Correct {place}: {error.msg}."
    except (ValueError, RecursionError, MemoryError) as error:
        return f"Correct {file}: {error or 'it is nested too deeply'}."
    return ""
