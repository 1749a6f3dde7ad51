"""List what a user can do with a version of gslcosim as sorted lines, and compare two versions.

Run with `make capabilities BASE=COMMIT`, which prints what differs between that commit and this checkout, or:

    python tests/freeze/capabilities.py list [COMMIT] > capabilities.txt
    python tests/freeze/capabilities.py compare BEFORE [AFTER] [--named FILE]

BEFORE and AFTER are commits or files that `list` wrote; without one it is this checkout. A line is a command with an
argument of it from `--help`, a name or a setting that `gslcosim list` prints, a page that the docs' index names, a key
of a scenario, a property of a message, an entry point, an extra, or a public name of Python.
FILE has lines as `compare` prints them: differences that are meant, which then do not count.
"""

# ruff: noqa: T201 - this is a script

import argparse
import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "benchmarks"))

from bench_against import Code, base_code  # noqa: E402 # pyright: ignore[reportMissingImports]

# What else calls a command of now, as JSON: old names, and families whose default part needs no name.
ALIASES = """
import json
try:
    from gslcosim.cli.arguments import CommandFamily, iterate_commands
    from gslcosim.cli.main import list_groups
except ImportError:
    print("{}")
else:
    GROUPS = list_groups()
    each = [command for group in GROUPS for command in group.commands]
    aliases = {command.old_name: " ".join(path) for path, command in iterate_commands(GROUPS) if command.old_name}
    aliases |= {it.name: f"{it.name} {it.default}" for it in each if isinstance(it, CommandFamily) and it.default}
    print(json.dumps(aliases))
"""
PUBLIC = """
import importlib, sys
module = importlib.import_module(sys.argv[1])
print(*getattr(module, "__all__", ()), sep="\\n")
"""
PUBLIC_PACKAGES = ("gslcosim.agent_kit", "gslcosim_search", "gslcosim_training", "gslcosim_data.run")
_SECTION = re.compile(r"^(\S.*):$", re.MULTILINE)


def list_capabilities(code: Code) -> list[str]:
    """Return what a version can do, in sorted lines without repetition."""
    parts = (_commands, _names, _pages, _keys, _messages, _packaging, _public_names)
    return sorted({line for part in parts for line in part(code)})


def _call(code: Code, *words: str) -> str:
    # Wide, so that no name is wrapped.
    environment = {**os.environ, "COLUMNS": "400"}
    call = [str(code.python), *words]
    return subprocess.run(call, cwd=code.folder, env=environment, capture_output=True, text=True, check=True).stdout


def _commands(code: Code) -> Iterator[str]:
    found = dict(_commands_below(code, ()))
    for old, now in json.loads(_call(code, "-c", ALIASES)).items():
        for path, arguments in list(found.items()):
            if f"{path} ".startswith(f"{now} "):
                called = f"{old}{path[len(now) :]}"
                found[called] = [*found.get(called, []), *arguments]
    for path, arguments in found.items():
        yield f"command {path}".rstrip()
        yield from (f"command {path} {argument}" for argument in arguments)


def _commands_below(code: Code, path: tuple[str, ...]) -> Iterator[tuple[str, list[str]]]:
    text = _call(code, "-m", "gslcosim", *path, "--help")
    titles = [*_SECTION.finditer(text)]
    arguments: list[str] = []
    for title, after in zip(titles, [*titles[1:], None], strict=True):
        section = text[title.end() : after.start() if after else None]
        if title[1] in ("commands", "actions"):
            for name in re.findall(r"^    ([a-z][\w-]*)(?:  |$)", section, re.MULTILINE):
                yield from _commands_below(code, (*path, name))
        elif title[1] in ("options", "positional arguments"):
            # Without the short name of an option.
            arguments += re.findall(r"^  (?:-\w, )?(\S.*?)(?:  |$)", section, re.MULTILINE)
    yield " ".join(path), arguments


def _names(code: Code) -> Iterator[str]:
    for kind, rows in json.loads(_call(code, "-m", "gslcosim", "list", "--json")).items():
        for row in rows:
            yield f"name {kind} {row['name']}"
            yield from (f"name {kind} {row['name']} {setting['key']}" for setting in row.get("settings", ()))
    for suite in json.loads(_call(code, "-m", "gslcosim", "bench", "list", "--json")):
        yield f"name suites {suite['name'] if isinstance(suite, dict) else suite}"


def _pages(code: Code) -> Iterator[str]:
    index = (code.folder / "docs" / "README.md").read_text(encoding="utf-8")
    yield from (f"page {target}" for target in re.findall(r"\]\(([^)#]+)", index))


# The page is made from the models; a test holds it to them.
def _keys(code: Code) -> Iterator[str]:
    heading = ""
    for line in (code.folder / "docs" / "scenario.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            heading = line[3:]
        elif found := re.match(r"\| `([^`]+)` \|", line):
            yield f"key {heading} {found[1]}"


def _messages(code: Code) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        _call(code, "-m", "gslcosim", "schema", "export", folder)
        for path in Path(folder).rglob("*"):
            if path.is_file():
                yield f"contract {path.relative_to(folder)}"
        for path in Path(folder).glob("schemas/*.json"):
            yield from _properties(f"message {path.stem}", json.loads(path.read_text(encoding="utf-8")))


def _properties(name: str, schema: dict[str, Any]) -> Iterator[str]:
    yield from (f"{name} {key}" for key in schema.get("properties", ()))
    for part, inner in schema.get("$defs", {}).items():
        yield from _properties(f"{name} {part}", inner)


def _packaging(code: Code) -> Iterator[str]:
    for file in (code.folder / "pyproject.toml", *code.folder.glob("extensions/*/pyproject.toml")):
        project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
        yield from (f"script {name}" for name in project.get("scripts", ()))
        yield from (f"extra {name}" for name in project.get("optional-dependencies", ()))
        for group, points in project.get("entry-points", {}).items():
            yield from (f"entry point {group} {name}" for name in points)
    for path in (*code.folder.glob("gslcosim/**/*.py"), *code.folder.glob("extensions/*/gslcosim_*/**/*.py")):
        groups = re.findall(
            r'^\w+(?:_ENTRY_POINTS|_GROUP) = "([\w.]+)"', path.read_text(encoding="utf-8"), re.MULTILINE
        )
        yield from (f"entry point {group}" for group in groups)


def _public_names(code: Code) -> Iterator[str]:
    for package in PUBLIC_PACKAGES:
        with contextlib.suppress(subprocess.CalledProcessError):
            yield from (f"python {package} {name}" for name in _call(code, "-c", PUBLIC, package).split())


def compare(before: list[str], after: list[str], named: list[str]) -> list[str]:
    """Return lines that are in one of two lists alone, with `- ` or `+ ` before them, without those that are named."""
    lines = [
        *(f"- {line}" for line in before if line not in after),
        *(f"+ {line}" for line in after if line not in before),
    ]
    return sorted((line for line in lines if line not in named), key=lambda line: (line[2:], line))


def read_capabilities(source: str | None) -> list[str]:
    """Return the lines of a file, those of a commit, or those of this checkout."""
    if source is None:
        return list_capabilities(Code(name="this", python=Path(sys.executable), folder=ROOT))
    if Path(source).is_file():
        return Path(source).read_text(encoding="utf-8").splitlines()
    with base_code(source) as code:
        return list_capabilities(code)


def main() -> int:
    """List or compare, and return 1 where versions differ in what is not named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    actions = parser.add_subparsers(dest="action", required=True)
    listing = actions.add_parser("list")
    listing.add_argument("source", nargs="?", metavar="COMMIT")
    comparing = actions.add_parser("compare")
    comparing.add_argument("before", metavar="BEFORE")
    comparing.add_argument("after", nargs="?", metavar="AFTER")
    comparing.add_argument("--named", type=Path, metavar="FILE")
    options = parser.parse_args()
    if options.action == "list":
        print("\n".join(read_capabilities(options.source)))
        return 0
    named = options.named.read_text(encoding="utf-8").splitlines() if options.named else []
    differences = compare(read_capabilities(options.before), read_capabilities(options.after), named)
    print("\n".join(differences) or "No capability differs but for what is named.")
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
