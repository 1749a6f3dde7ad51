"""Distributions of the project: the core and its extensions, and the ones that each needs.

`python tests/shared/distributions.py [--extra EXTRA] [EXTENSION …]` prints the arguments of pip that install the core
and the named extensions editable, with all that they need of the project; all extensions where none is named.
"""

# ruff: noqa: T201 - this is a script

import argparse
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CORE = "gslcosim"


def read_projects() -> dict[str, dict[str, Any]]:
    """Return the table `project` of each distribution by its name, the core first."""
    files = [ROOT / "pyproject.toml", *sorted(ROOT.glob("extensions/*/pyproject.toml"))]
    projects = [tomllib.loads(path.read_text(encoding="utf-8"))["project"] for path in files]
    return {project["name"]: project for project in projects}


def find_folder(name: str) -> Path:
    """Return the folder of a distribution's `pyproject.toml`."""
    return ROOT if name == CORE else ROOT / "extensions" / name.removeprefix(f"{CORE}-")


def list_needed(names: Iterable[str], extras: Iterable[str] = ()) -> list[str]:
    """Return the named distributions and those that they and their extras need, in the order of `read_projects`."""
    projects = read_projects()
    needed: set[str] = {CORE}
    open_names = [(name, extra) for name in names for extra in (None, *extras)]
    seen: set[tuple[str, str | None]] = set()
    while open_names:
        name, extra = open_names.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        needed.add(name)
        project = projects[name]
        required = project["dependencies"] if extra is None else project["optional-dependencies"].get(extra, [])
        for text in required:
            found = re.match(r"([\w-]+)(?:\[([\w,-]+)\])?", text)
            if found is not None and found[1] in projects:
                open_names += [(found[1], each) for each in (None, *(found[2] or "").split(",")) if each != ""]
    return [name for name in projects if name in needed]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--extra", help="dev, docs, check or test-all")
    parser.add_argument("extensions", nargs="*", metavar="EXTENSION", help="folders of extensions/")
    asked = parser.parse_args()
    projects = read_projects()
    names = [f"{CORE}-{extension}" for extension in asked.extensions] or list(projects)
    if unknown := [name for name in names if name not in projects]:
        known = ", ".join(name.removeprefix(f"{CORE}-") for name in projects if name != CORE)
        parser.error(f"expected extensions of {known}, was {unknown[0].removeprefix(f'{CORE}-')}")
    for name in list_needed(names, [asked.extra] if asked.extra else []):
        extra = asked.extra if name == CORE or asked.extra != "docs" else "dev"
        folder = "." if name == CORE else f"./{find_folder(name).relative_to(ROOT)}"
        # Without extras, too: pip before 23.3 finds a distribution for those that need it only so.
        print(f"--editable {folder}", *([f"--editable {folder}[{extra}]"] if extra else []))


if __name__ == "__main__":
    main()
