# ruff: noqa: T201 - a script that prints
"""Bring the tables of old import names up to date with a map that `rename.py` has applied: `old_names.py MAP.yaml`.

Only names that a module had in 0.1.0, or right before the first maps were applied, stay importable.
"""

import ast
import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import yaml
from rename import module_path

RELEASES = ("9693e5e", "fade373")
TABLES = Path("gslcosim/base/old_names")


@cache
def names_then(module: str) -> frozenset[str] | None:
    """Return the names of a module in the releases; None where it was in none of them."""
    found: set[str] = set()
    was_there = False
    for release in RELEASES:
        for is_package in (False, True):
            call = ["git", "show", f"{release}:{module_path(module, package=is_package)}"]
            shown = subprocess.run(call, capture_output=True, text=True, check=False)
            if shown.returncode == 0:
                was_there = True
                found |= _bound_in(ast.parse(shown.stdout))
    return frozenset(found) if was_there else None


def _bound_in(tree: ast.Module) -> set[str]:
    found: set[str] = set()
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)}
        elif isinstance(node, ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
    return found


def update(file: Path) -> None:
    """Write both tables again."""
    plan = yaml.safe_load(file.read_text())
    modules: dict[str, str] = plan.get("modules") or {}
    names: dict[str, dict[str, str]] = {}
    for key, new in (plan.get("names") or {}).items():
        module, _, name = key.partition(":")
        names.setdefault(module, {})[name] = new
    tables = ("moved_modules", "renamed_in_place")
    moved, in_place = (json.loads((TABLES / f"{name}.json").read_text()) for name in tables)
    for table in (moved, in_place):
        for old, entry in table.items():
            now, renamed = entry["module"], entry.get("names", {})
            for name, new in names.get(now, {}).items():
                before = [key for key, value in renamed.items() if value == name]
                renamed |= dict.fromkeys(before or ({name} & (names_then(old) or frozenset())), new)
            entry["module"] = modules.get(now, now)
            if renamed:
                entry["names"] = renamed
    for module in sorted({*names, *modules}):
        then = names_then(module)
        if then is None:
            continue
        now = modules.get(module, module)
        entry = in_place.pop(module, None) or moved.get(module) or {}
        renamed = {name: new for name, new in names.get(module, {}).items() if name in then} | entry.get("names", {})
        if now != module or renamed:
            (in_place if now == module else moved)[module] = {"module": now} | ({"names": renamed} if renamed else {})
    for name, table in zip(tables, (moved, in_place), strict=True):
        lines = (f"  {json.dumps(module)}: {json.dumps(table[module])}" for module in sorted(table))
        (TABLES / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")
        print(f"{name}: {len(table)} modules")


if __name__ == "__main__":
    for each in sys.argv[1:]:
        update(Path(each))
